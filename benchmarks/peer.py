"""Other renderers on the same kind of path: reference points, measured elsewhere, for the charts.

CHAI3D 3.3.0 (finger proxy, radius 0; "static" is its default, "dynamic" its moving-object mode) and HAPI 1.3.1
(god-object), C++ -O3, on a shared 2.5 GHz core; each tick's least time of 5 hot runs, a slide over icospheres of 50 mm.
"""

from dataclasses import dataclass
from typing import Final

CITED: Final = "measured on the same paths, C++ -O3, a shared 2.5 GHz core"

TRIANGLES: Final = (1280, 20480, 81920, 327680, 1310720)


@dataclass(frozen=True)
class Peer:
    """Contact time over `TRIANGLES` [µs]; error of the force's direction [°] and gap to the mesh [m] at 20 k."""

    name: str
    median_us: tuple[float, ...]
    p99_us: tuple[float, ...]
    direction_deg: tuple[float, float]
    """Median and p99 at 20,480 triangles."""
    gap_m: float
    build_ms: tuple[float, float]
    """At 1,280 and at 1,310,720 triangles."""


PEERS: Final = (
    Peer("CHAI3D static", (0.65, 0.86, 1.1, 1.8, 1.8), (1.2, 2.2, 3.0, 6.2, 5.9), (1.38, 7.8), 5e-6, (0.8, 2500)),
    Peer("CHAI3D dynamic", (2.1, 2.6, 3.2, 5.8, 5.1), (3.3, 4.8, 6.3, 15.0, 11.0), (0.59, 1.24), 5e-6, (0.8, 2500)),
    Peer("HAPI", (1.9, 1.4, 1.7, 2.0, 2.4), (2.9, 2.6, 3.4, 4.3, 5.3), (0.59, 1.24), 0.1e-6, (12, 6850)),
)


@dataclass(frozen=True)
class SideBySide:
    """A renderer in the run turn by turn: median and p99 of its contact over `TRIANGLES` [µs]."""

    name: str
    median_us: tuple[float, ...]
    p99_us: tuple[float, ...]


SIDE_BY_SIDE_SOURCE: Final = "turn by turn on two quiet cores, Zen 5, 2.6 GHz, 2026-11-22"

SIDE_BY_SIDE: Final = (
    SideBySide("hapscene, contact", (0.21, 0.23, 0.25, 0.37, 0.83), (0.67, 0.85, 1.00, 1.34, 1.55)),
    SideBySide("hapscene, whole tick", (0.35, 0.37, 0.38, 0.51, 0.98), (0.80, 1.02, 1.19, 1.52, 1.74)),
    SideBySide("CHAI3D static", (0.33, 0.45, 0.56, 0.71, 0.92), (0.58, 1.00, 1.62, 2.09, 3.87)),
    SideBySide("CHAI3D dynamic", (1.10, 1.38, 1.64, 2.00, 2.44), (1.63, 2.46, 3.02, 3.94, 5.38)),
    SideBySide("HAPI", (0.47, 0.59, 0.68, 0.85, 1.13), (0.80, 1.31, 1.94, 2.88, 4.12)),
)
"""Hot, the median of the rounds, same meshes, path and machine. What is unfair: hapscene's contact leaves out its
force, its whole tick adds description, limits, a row and ten samples of acceleration, so a fair figure lies between;
CHAI3D static solves one constraint a tick and gets 5 of 37 known cases right (dynamic 32, HAPI 28, hapscene 37)."""
