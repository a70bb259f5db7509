"""Playing with what stands on the desk: what a terminal or a page shows while a device is felt."""
