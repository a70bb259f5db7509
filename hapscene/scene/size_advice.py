"""Check of the size of a scene or mesh, with advice on the unit or scale if the size does not suit the device.

A wrong unit of a mesh file is easy to miss: the picture looks right, but the contact cannot be felt.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, log10
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import UNITLESS
from hapscene.errors import printable
from hapscene.scene.mesh import UNIT_M, Mesh

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["LIKELY_M", "dimensions", "size_advice"]

HAND_M: Final = (1e-3, 10.0)
"""Smallest and largest size that can be felt [m]: the position resolution of the Omni is 55 µm, which is also the
distance that a fast stroke covers in a tick."""

LIKELY_M: Final = (5e-3, 2.0)
"""Sizes that a suggested unit must give, smallest and largest [m]."""

REACH_M: Final[Mapping[str, tuple[float, float, float]]] = {
    "omni": (0.16, 0.07, 0.12),
    "phantom-1.0": (0.254, 0.127, 0.178),
    "premium-1.5": (0.381, 0.191, 0.267),
}
"""Nominal workspace of each device from its data sheet: width, depth and height [m]."""

AMPLE: Final = 3.0
"""Largest size of a scene that gives no advice, in workspaces [1]: it can be explored in parts."""

COMMON: Final = ("mm", "m", "cm", "in", "ft", "um")
"""Units of mesh files, most common first."""


@dataclass(frozen=True)
class SizeAdvice:
    """Advice on the size of a mesh or scene.

    Attributes:
        size: the extent along x, y and z as text: "156 × 153 × 121 mm".
        words: description of the problem and its correction; empty if there is no problem.
        scale: scale factor [1]: by the likely unit of the mesh file, or to the workspace of the device; None
            if `words` is empty.
    """

    size: str
    words: str = ""
    scale: float | None = None


def size_advice(what: "Scene | Mesh", device: str = "omni") -> SizeAdvice:
    """Check the size of a mesh or scene.

    Args:
        what: the mesh or scene.
        device: name of the haptic device; the workspace of devices that are not in `REACH_M` is unlimited.
    """
    mesh = what if isinstance(what, Mesh) else None
    boxes = [body.bounds_W_m for body in what.bodies] if not isinstance(what, Mesh) else [what.bounds_m]
    size_m = np.ptp(np.concatenate(boxes or [np.zeros((1, 3))]), axis=0)
    size = dimensions(size_m)
    diagonal_m = float(np.linalg.norm(size_m))
    reach_m = np.array(REACH_M.get(device, (HAND_M[1],) * 3))
    is_small = diagonal_m < LIKELY_M[0]
    if diagonal_m == 0.0 or (not is_small and (size_m <= (AMPLE if device in REACH_M else 1.0) * reach_m).all()):
        return SizeAdvice(size)
    name = "the scene" if mesh is None else "the mesh" if mesh.path is None else printable(mesh.path.name)
    words = f"{name} is {size} in size"
    if is_small:
        words += ", too small to be felt well"
    elif device in REACH_M:
        words += f"; the workspace of the {device} is {dimensions(reach_m)}"
    else:
        words += ", larger than the reach of a hand"
    scale = _round(float((reach_m / np.maximum(size_m, 1e-3 * diagonal_m)).min()))
    if mesh is None:
        return SizeAdvice(size, f"{words}; scaled by {scale:.10g} it is {dimensions(size_m * scale)}", scale)
    option, why = f"--scale {scale * mesh.scale:.10g}", ""
    if units := _likely(mesh, diagonal_m):
        scale, option = UNIT_M[units[0]] / UNIT_M[mesh.unit], f"--unit {units[0]}"
        why = f"its unit is probably  {' or '.join(units)}, not {mesh.unit}: "
    return SizeAdvice(size, f"{words}; {why}with {option} it is {dimensions(size_m * scale)}", scale)


def dimensions(size_m: NDArray[np.float64]) -> str:
    """Format width, depth and height [m] in one unit, chosen by the largest: "156 × 153 × 121 mm"."""
    largest = float(max(size_m))
    unit, metres = next(((u, m) for u, m in (("m", 1.0), ("mm", 1e-3)) if largest >= m), ("µm", 1e-6))
    return " × ".join(f"{float(f'{v / metres:.3g}'):.10g}" for v in size_m.tolist()) + f" {unit}"


def _likely(mesh: Mesh, diagonal_m: float) -> list[str]:
    """Return up to two units that give a mesh a likely size; empty if the size is likely or the file has a unit."""
    has_unit = mesh.path is None or mesh.path.suffix.lower()[1:] not in UNITLESS or mesh.scale != 1.0
    if has_unit or LIKELY_M[0] <= diagonal_m <= LIKELY_M[1]:
        return []
    sizes_m = {unit: diagonal_m * UNIT_M[unit] / UNIT_M[mesh.unit] for unit in COMMON}
    return [unit for unit, size_m in sizes_m.items() if LIKELY_M[0] <= size_m <= LIKELY_M[1]][:2]


def _round(factor: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** floor(log10(factor))
    return float(f"{max(step for step in (1, 2, 5) if step * power <= factor * (1 + 1e-9)) * power:.10g}")
