"""Swatches that come with hapscene: one file per material, with its provenance."""
