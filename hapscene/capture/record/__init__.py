"""Live recording from a probe, its coverage, and the time alignment of several recordings."""
