"""Where a wall is stable, and where it is not: found by simulation through the real tick, and held to theory.

`critical_stiffness` is the stiffest wall at which a device comes to rest; `closed_form` what theory says; `wall_case`
and `random_limit` hold one to the other; `z_width` draws the stable region of a device.
"""

from hapscene.stability.critical import critical_stiffness

__all__ = ["critical_stiffness"]
