"""Where a wall is stable, and where it is not: found by simulation through the real tick, and held to theory.

`critical_stiffness` (`critical`) is the stiffest wall at which a device comes to rest; `closed_form` what theory says;
`rig` the sheet, mass and hand that every wall is tried with.

| module | does |
|---|---|
| `study` | the Z-width of a device, written into a folder: `hapscene lab stability` |
| `z_width` | the stability region of a device, and swatches placed in it |
| `wall_chart` | its chart |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
