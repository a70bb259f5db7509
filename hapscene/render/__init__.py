"""Rendering: the haptic tick, the renderer that runs it, and what it returns."""
