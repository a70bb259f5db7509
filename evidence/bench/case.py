"""Cases of the benchmark: spheres of five sizes with a generated path, and meshes and paths of the zoo if present."""

import math
from dataclasses import dataclass, replace
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
"""Distance from the centre at which the path starts and ends [m]."""

PRESS_M: Final = 0.002
"""Mean depth of the slide [m]."""

WIGGLES: Final = ((3.0, 0.9e-3), (17.0, 0.3e-3))
"""Frequencies [Hz] and amplitudes [m] of the variation of the depth."""

SLIDE_M_S: Final = 0.1
"""Speed of the slide [m/s]."""

EASE_S: Final = 1.0
"""Duration of approach and of retreat [s]."""

TILT: Final = 0.3
"""Rotation of the great circle of the slide per revolution [1], so that no track is touched twice."""


BALL_M: Final = 0.002
"""Radius of the tip in the cases with a ball [m]."""


@dataclass(frozen=True)
class Case:
    """A mesh, and a path over it of a tip with a radius [m], 0 for a point."""

    name: str
    mesh: Mesh
    p_WT_m: Array
    tip_radius_m: float = 0.0

    def scene(self, swatch: Swatch | None = None) -> Scene:
        """Return a scene of the mesh."""
        scene = Scene()
        scene.add(self.mesh, name="body", swatch=swatch)
        return scene


def sphere(subdivisions: int) -> Mesh:
    """Return an icosphere of `RADIUS_M` about the origin with 20 · 4^subdivisions faces."""
    made = icosphere(subdivisions=subdivisions, radius=RADIUS_M)
    return Mesh(vertices_m=np.asarray(made.vertices), faces=np.asarray(made.faces, np.int32))


def slide_path(tick_count: int = 10_000) -> Array:
    """Return tool positions (n, 3) [m]: approach, press, slide at `SLIDE_M_S` with varying depth, retreat."""
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
    """Return directions (n, 3) at arc lengths (n,) [rad] along a slowly rotating great circle."""
    turn = np.linspace(0.0, angle_rad.max() + 1.0, 20_000)
    x, y, z = np.cos(turn), np.sin(turn) * math.sqrt(0.5), np.sin(turn) * math.sqrt(0.5)
    c, s = np.cos(TILT * turn), np.sin(TILT * turn)
    track = np.column_stack((c * x - s * y, s * x + c * y, z))
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))))
    directions = np.column_stack([np.interp(angle_rad, way, track[:, i]) for i in range(3)])
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


ZOO: Final = Path(__file__).resolve().parents[3] / "shared" / "zoo"
"""Folder of reference paths and meshes beside the checkout, used if present."""


def zoo_cases() -> list[Case]:
    """Return the cases of the zoo: its slide path over the sphere of 82 k triangles, and its bunny."""
    if not ZOO.is_dir():
        return []
    meshes: list[tuple[str, Mesh, str]] = [("zoo sphere 82 k", sphere(6), "slide_sph1k.npz")]
    with np.load(ZOO / "mesh_bunny.npz", allow_pickle=False) as arrays:
        bunny = Mesh(vertices_m=arrays["vertices_m"], faces=arrays["faces"])
    meshes.append(("zoo bunny 69 k", bunny, "slide_bunny.npz"))
    cases = []
    for name, mesh, path in meshes:
        with np.load(ZOO / path, allow_pickle=False) as arrays:
            cases.append(Case(name, mesh, np.ascontiguousarray(arrays["tool_m"])))
    return cases


def sphere_cases(subdivisions: tuple[int, ...], tick_count: int) -> list[Case]:
    """Return the sphere cases."""
    path = slide_path(tick_count)
    return [Case(f"sphere {short(20 * 4**k)}", sphere(k), path) for k in subdivisions]


def with_ball(case: Case) -> Case:
    """Return a sphere case with a ball of `BALL_M`, at the depths of the point."""
    distance_m = np.linalg.norm(case.p_WT_m, axis=1, keepdims=True)
    path = np.ascontiguousarray(case.p_WT_m * (1.0 + BALL_M / distance_m))
    return replace(case, name=f"{case.name} ball {1e3 * BALL_M:g} mm", p_WT_m=path, tip_radius_m=BALL_M)


def short(count: int) -> str:
    """Return a rounded count: "1 k" for 1280, "1.31 M" for 1310720."""
    return f"{count / 1e6:.2f} M" if count >= 1e6 else f"{round(count / 1e3)} k"
