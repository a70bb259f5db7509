"""Files, written whole and read within bounds; readers in a process of their own; serial lines."""
