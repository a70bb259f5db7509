"""Effects: one small file each."""
