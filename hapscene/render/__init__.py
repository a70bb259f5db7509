"""Rendering: one haptic tick, the renderer that drives it, what it returns."""
