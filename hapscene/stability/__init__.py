"""Where a wall is stable, and where it is not: found by simulation through the real tick, and held to theory.

`critical_stiffness` is the stiffest wall at which a device comes to rest; `closed_form` what theory says; `wall_case`
and `random_limit` hold one to the other; `z_width` draws the stable region of a device.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
