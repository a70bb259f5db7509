"""Recording from a probe, and time alignment of several recordings."""
