"""File access with limits and atomic writes; isolated readers; serial ports."""
