"""Surface properties: swatches, effects, and the mixer that sums what effects render."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
