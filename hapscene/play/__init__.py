"""Interactive sessions with a device: terminal monitor, first run, and the page of `hapscene play`."""
