"""Swatch libraries: search, add, fetch and publish swatches; their words, sounds and pictures."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
