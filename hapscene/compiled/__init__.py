"""Compilation: numba's pipeline for inner functions and whole ones, the cache on disk, progress, arrays by pointer."""
