"""Where a wall is stable, and where it is not: found by simulation through the real tick, and held to theory.

`critical_stiffness` (`critical`) is the stiffest wall at which a device comes to rest; `closed_form` what theory says;
`rig` the sheet, mass and hand that every wall is tried with.

| module | does |
|---|---|
| `study` | everything about walls into a folder: `hapscene lab stability` |
| `wall_case` | cases with known answers, W1 to W8; an `answer` is one of them, judged |
| `random_limit` | limits of random devices at random walls, simulated against predicted |
| `z_width` | the stable region of a device, and swatches placed in it |
| `wall_chart` | the charts of all that |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
