"""The haptography handle: its plant, the compensators that drive it, and how well they do."""
