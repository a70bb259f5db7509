"""Devices: their limits by name, and simulated ones with the hand that holds them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
