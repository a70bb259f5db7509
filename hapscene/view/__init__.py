"""What was felt, for the eye and the ear: plots, pictures, films, sound. Knows the core; the core knows none of it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
