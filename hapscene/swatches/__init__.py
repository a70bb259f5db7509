"""Swatch libraries: search, add, download and publish swatches; descriptions, sounds and pictures of swatches."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
