"""Where the tool goes: recorded paths, a hand made from parts, gestures over what there is to touch."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
