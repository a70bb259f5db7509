"""What the benchmark touches: spheres of five sizes and a path over them, both made; the zoo's, where it is there."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import icosphere

from hapscene.constants import TICK_S
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

Array = NDArray[np.float64]

RADIUS_M: Final = 0.05
"""Radius of the spheres [m]."""

SUBDIVISIONS: Final = (3, 5, 6, 7, 8)
"""Subdivisions of the icosahedron [count]: 1 k, 20 k, 82 k, 328 k and 1.31 M triangles."""

START_M: Final = 0.07
"""Distance from the centre at which a path starts and ends [m]."""

PRESS_M: Final = 0.002
"""Depth that the tool slides at [m], on average."""

WIGGLES: Final = ((3.0, 0.9e-3), (17.0, 0.3e-3))
"""Frequency [Hz] and amplitude [m] of what the depth does while it slides."""

SLIDE_M_S: Final = 0.1
"""Speed of the slide [m/s]."""

EASE_S: Final = 1.0
"""How long the approach takes, and the leaving [s]."""

TILT: Final = 0.3
"""Turns of the slide's great circle about the vertical in one round of it [1]: no track is felt twice."""


@dataclass(frozen=True)
class Case:
    """A mesh and a path over it. `round` is True where the mesh is the sphere of `RADIUS_M` about the origin."""

    name: str
    mesh: Mesh
    p_WT_m: Array
    round: bool

    def scene(self, swatch: Swatch | None = None) -> Scene:
        """A scene of the one body."""
        scene = Scene()
        scene.add(self.mesh, name="body", swatch=swatch)
        return scene


def sphere(subdivisions: int) -> Mesh:
    """Icosphere of `RADIUS_M` about the origin: 20 · 4^subdivisions faces."""
    made = icosphere(subdivisions=subdivisions, radius=RADIUS_M)
    return Mesh(vertices_m=np.asarray(made.vertices), faces=np.asarray(made.faces, np.int32))


def slide_path(tick_count: int = 10_000) -> Array:
    """Tool (n, 3) [m] over the sphere: approach, press, slide at `SLIDE_M_S` with wiggling depth, leave."""
    t_s = np.arange(tick_count) * TICK_S
    end_s = tick_count * TICK_S
    ease_s = min(EASE_S, end_s / 4)
    # 0 in the air, 1 pressed
    pressed = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(t_s, end_s - TICK_S - t_s) / ease_s, 0.0, 1.0))
    slid_s = np.clip(t_s - ease_s, 0.0, end_s - 2 * ease_s)
    depth_m = PRESS_M + sum(a * np.sin(2 * np.pi * f * slid_s) for f, a in WIGGLES)
    distance_m = START_M + pressed * (RADIUS_M - depth_m - START_M)
    return np.asarray(distance_m[:, None] * _around(SLIDE_M_S * slid_s / RADIUS_M))


def _around(angle_rad: Array) -> Array:
    """Directions (n, 3) after ways (n,) [rad] along a great circle that slowly turns."""
    turn = np.linspace(0.0, angle_rad.max() + 1.0, 20_000)
    x, y, z = np.cos(turn), np.sin(turn) * math.sqrt(0.5), np.sin(turn) * math.sqrt(0.5)
    c, s = np.cos(TILT * turn), np.sin(TILT * turn)
    track = np.column_stack((c * x - s * y, s * x + c * y, z))
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))))
    directions = np.column_stack([np.interp(angle_rad, way, track[:, i]) for i in range(3)])
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def zoo_cases(zoo: Path) -> list[Case]:
    """The zoo's own slide path over the sphere of 82 k triangles, and its bunny."""
    meshes: list[tuple[str, Mesh, str]] = [("zoo sphere 82 k", sphere(6), "slide_sph1k.npz")]
    with np.load(zoo / "mesh_bunny.npz", allow_pickle=False) as arrays:
        bunny = Mesh(vertices_m=arrays["vertices_m"], faces=arrays["faces"])
    meshes.append(("zoo bunny 69 k", bunny, "slide_bunny.npz"))
    cases = []
    for name, mesh, path in meshes:
        with np.load(zoo / path, allow_pickle=False) as arrays:
            cases.append(Case(name, mesh, np.ascontiguousarray(arrays["tool_m"]), mesh is not bunny))
    return cases


def sphere_cases(subdivisions: tuple[int, ...], tick_count: int) -> list[Case]:
    """The made cases."""
    path = slide_path(tick_count)
    return [Case(f"sphere {short(20 * 4**k)}", sphere(k), path, True) for k in subdivisions]


def short(count: int) -> str:
    """A count as it stands in a table: 1280 as "1 k", 1310720 as "1.31 M"."""
    return f"{count / 1e6:.2f} M" if count >= 1e6 else f"{round(count / 1e3)} k"
