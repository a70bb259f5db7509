"""Stability of virtual walls on a device, found by simulation with the real haptic tick, and compared with theory.

`closed_form` has the theoretical limit of small motion; `rig` has the sheet, the mass and the hand of each trial.

| module | content |
|---|---|
| `study` | writes the Z-width of a device to a folder, with its chart: `hapscene lab stability` |
| `z_width` | the stability region of a device, and the stability of swatches |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
