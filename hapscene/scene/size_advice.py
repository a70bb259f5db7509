"""Whether a scene or mesh has a size for a hand, asked wherever one is opened; if not, the unit or scale that mends it.

The unit of a file may be told wrong, or be none; what is then seen is right, and what is felt is nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, log10
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import printable
from hapscene.scene.mesh import UNIT_M, Mesh

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["HAND_M", "LIKELY_M", "REACH_M", "dimensions", "size_advice"]

HAND_M: Final = (1e-3, 10.0)
"""Sizes that a hand's tool can feel, smallest and largest [m]: the Omni counts steps of 55 µm, a tick of a fast stroke
is as long."""

LIKELY_M: Final = (5e-3, 2.0)
"""Sizes that another unit is proposed for, smallest and largest [m]."""

REACH_M: Final[Mapping[str, tuple[float, float, float]]] = {
    "omni": (0.16, 0.07, 0.12),
    "phantom-1.0": (0.254, 0.127, 0.178),
    "premium-1.5": (0.381, 0.191, 0.267),
}
"""Where a device is at its best: width, depth and height by its data sheet [m]."""

AMPLE: Final = 3.0
"""How many reaches a scene may be across before that is told [1]: a hand feels it piece by piece."""

COMMON: Final = ("mm", "m", "cm", "in", "ft", "um")
"""Units of mesh files, the most common first."""

PRECISE: Final = (".step", ".stp", ".glb", ".gltf")
"""Formats that say their unit: one of the wrong size is scaled."""


@dataclass(frozen=True)
class SizeAdvice:
    """What is said of a size.

    Attributes:
        size_m: along x, y and z [m].
        size: the same in words: "156 × 153 × 121 mm".
        words: what is odd about it and what mends it, in a sentence; empty where nothing is.
        unit: that the numbers of a mesh's file are likely in, where that mends it; else None.
        scale: how many times larger it should be, by that unit or to what the device reaches [1]; None as `words`.
        option: the same for the command line: "--unit m" or "--scale 0.05"; empty of a scene, and as `words`.
    """

    size_m: tuple[float, ...]
    size: str
    words: str = ""
    unit: str | None = None
    scale: float | None = None
    option: str = ""


def size_advice(what: "Scene | Mesh", device: str = "omni") -> SizeAdvice:
    """What to say of the size of a mesh, or of a scene as it stands.

    Args:
        what: it is.
        device: that touches it, by its name; one that is not in `REACH_M` reaches everywhere.
    """
    mesh = what if isinstance(what, Mesh) else None
    low, high = _bounds_m(what) if mesh is None else mesh.bounds_m  # type: ignore[arg-type]
    size_m = high - low
    sizes = tuple(size_m.tolist()), dimensions(size_m)
    diagonal_m = float(np.linalg.norm(size_m))
    reach_m = np.array(REACH_M.get(device, (HAND_M[1],) * 3))
    is_small = diagonal_m < LIKELY_M[0]
    if diagonal_m == 0.0 or (not is_small and (size_m <= (AMPLE if device in REACH_M else 1.0) * reach_m).all()):
        return SizeAdvice(*sizes)
    name = "the scene" if mesh is None else "the mesh" if mesh.path is None else printable(mesh.path.name)
    said = f"{name} is {sizes[1]} in size"
    if is_small:
        said += ", too small to feel much of it"
    elif device in REACH_M:
        said += f"; the {device} reaches {dimensions(reach_m)} of it at a time"
    else:
        said += ", more than a hand reaches"
    scale = _round(float((reach_m / np.maximum(size_m, 1e-3 * diagonal_m)).min()))
    if mesh is None:
        return SizeAdvice(
            *sizes, f"{said}; {scale:.10g} times as large it is {dimensions(size_m * scale)}", None, scale
        )
    unit, option, why = None, f"--scale {scale * mesh.scale:.10g}", ""
    if units := _likely(mesh, diagonal_m):
        unit, scale, option = units[0], UNIT_M[units[0]] / UNIT_M[mesh.unit], f"--unit {units[0]}"
        why = f"its numbers are probably in {' or '.join(units)}, not {mesh.unit}: "
    return SizeAdvice(*sizes, f"{said}; {why}{option} makes it {dimensions(size_m * scale)}", unit, scale, option)


def dimensions(size_m: NDArray[np.float64]) -> str:
    """Width, depth and height [m] in one unit, that of the largest: "156 × 153 × 121 mm"."""
    largest = float(max(size_m))
    unit, metres = next(((u, m) for u, m in (("m", 1.0), ("mm", 1e-3)) if largest >= m), ("µm", 1e-6))
    return " × ".join(f"{float(f'{v / metres:.3g}'):.10g}" for v in size_m.tolist()) + f" {unit}"


def _bounds_m(scene: "Scene") -> NDArray[np.float64]:
    """Corners (2, 3) of a box around all bodies, where they stand [m]: that of their own boxes."""
    corners = []
    for body in scene.bodies:
        box = np.stack(np.meshgrid(*body.mesh.bounds_m.T), axis=-1).reshape(-1, 3)
        corners.append(box @ body.X_WB[:3, :3].T + body.X_WB[:3, 3])
    found = np.concatenate(corners or [np.zeros((1, 3))])
    return np.array([found.min(axis=0), found.max(axis=0)])


def _likely(mesh: Mesh, diagonal_m: float) -> list[str]:
    """Two units in which a mesh of no likely size has one, the most common first; none where its file says its own."""
    told = mesh.path is None or mesh.path.suffix.lower() in PRECISE or mesh.scale != 1.0
    if told or LIKELY_M[0] <= diagonal_m <= LIKELY_M[1]:
        return []
    sizes_m = {unit: diagonal_m * UNIT_M[unit] / UNIT_M[mesh.unit] for unit in COMMON}
    return [unit for unit, size_m in sizes_m.items() if LIKELY_M[0] <= size_m <= LIKELY_M[1]][:2]


def _round(factor: float) -> float:
    """1, 2 or 5 times a power of ten, no more than a factor."""
    power = 10.0 ** floor(log10(factor))
    return float(f"{max(step for step in (1, 2, 5) if step * power <= factor * (1 + 1e-9)) * power:.10g}")
