"""Compilation with numba: pipelines, disk cache, progress report, and arrays passed by pointer."""
