"""Built-in effects, one per file."""
