"""A body with a tool path and the reference for its forces: the round sphere, or the closest point of the full mesh.

The closest point is found from distances to triangles of the full mesh, without rays and proxy, so that it does not
depend on the method under test. Coarser meshes are compared with the same reference.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from trimesh import triangles

from hapscene.constants import TICK_S
from hapscene.fidelity.coarser_mesh import coarser_mesh
from hapscene.motion.hand_path import explore
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import PLAIN
from hapscene.touch import open_scene

from ..bench.case import RADIUS_M, slide_path, sphere

Array = NDArray[np.float64]

DEMO: Final = str(Path(__file__).resolve().parents[2] / "assets" / "demo.scene.json")

SPHERE: Final = "sphere"
"""Name of the icosphere of 82 k triangles and 50 mm radius, whose reference is the round sphere."""

TICKS: Final = 3000
"""Length of the path over the sphere [count]; the path over a body is that of a simulated hand that explores it."""

LOOKS_DOWN: Final = -0.1
"""Vertical component of the normal below which a face is ignored [1]: the back of a thin plate can be closer to a
pressed tool than its front."""

NEAR_M: Final = 4e-3
"""Depth that an exploring hand never reaches [m]."""

BODY_FACES_MIN: Final = 1000
"""Smallest number of faces of a body that is reduced [count]."""

BODY_MAX: Final = 3
"""Largest number of bodies of a scene that are reduced, the largest ones first [count]."""


@dataclass(frozen=True)
class Touched:
    """A body alone, a path over it, and the reference for each tick.

    Attributes:
        body: the body with its full mesh and its pose in the scene.
        p_WT_m: tool positions (n, 3).
        into_m: vectors (n, 3) from the tool to the closest point; 0 if the tool is outside. Times the stiffness it is
            the force.
    """

    body: Body
    p_WT_m: Array
    into_m: Array

    def scene(self, mesh: Mesh) -> Scene:
        """Return a scene of the body with another mesh and one swatch; borders between swatches are ignored."""
        scene = Scene()
        scene.add(mesh, name=self.body.name, pose=self.body.X_WB, two_sided=self.body.two_sided, swatch=PLAIN)
        return scene


def bodies_of(scene_file: str | None) -> list[str]:
    """Return the names of the bodies of a scene that are reduced, largest first; a shared mesh counts once."""
    bodies = sorted(_scene(scene_file or DEMO).bodies, key=lambda body: -len(body.mesh.faces))
    meshes: dict[int, str] = {}
    for body in bodies:
        if len(body.mesh.faces) >= BODY_FACES_MIN:
            meshes.setdefault(id(body.mesh), body.name)
    return list(meshes.values())[:BODY_MAX]


@cache
def _scene(scene_file: str) -> Scene:
    return open_scene(scene_file)


@cache
def touched(scene_file: str | None, body: str, ticks: int = TICKS) -> Touched:
    """Return the sphere, or a body of a scene, with a path and its reference."""
    if body == SPHERE:
        scene = Scene()
        made = scene.add(sphere(6), name=SPHERE)
        path = slide_path(ticks)
        distance_m = np.linalg.norm(path, axis=1, keepdims=True)
        into_m = np.where(distance_m < RADIUS_M, (RADIUS_M - distance_m) / distance_m * path, 0.0)
        return Touched(made, path, into_m)
    one = _scene(scene_file or DEMO).body(body)
    scene = Scene()
    scene.add(one.mesh, name=body, pose=one.X_WB, two_sided=one.two_sided)
    path = explore(scene, TICK_S)
    R_WB, p_WB = one.X_WB[:3, :3], one.X_WB[:3, 3]
    tool_B = (path - p_WB) @ R_WB
    normal = one.mesh.normals
    up = np.flatnonzero(normal @ R_WB[2] > LOOKS_DOWN)
    at_B, face = closest_points(one.mesh, tool_B, up, NEAR_M)
    inside = np.einsum("ni,ni->n", at_B - tool_B, normal[face]) > 0.0
    into_m = np.where(inside[:, None], at_B - tool_B, 0.0) @ R_WB.T
    return Touched(one, path, into_m)


def closest_points(
    mesh: Mesh, points_m: Array, among: NDArray[np.int64] | None = None, near_m: float = np.inf
) -> tuple[Array, NDArray[np.int64]]:
    """Return the points (n, 3) [m] of a mesh that are closest to points (n, 3), and their faces (n,).

    Exact for points closer than `near_m`: a face is skipped only if its centroid is farther than the best point so far
    plus the radius of the face. With `among` only those faces are searched.
    """
    closest_point: Any = triangles.closest_point
    corners = mesh.triangles_m
    middle = corners.mean(axis=1)
    reach_m = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    faces = np.arange(len(corners)) if among is None else among
    best_m, nearest = (np.asarray(found) for found in cKDTree(middle[faces]).query(points_m))
    face, at_m = faces[nearest], middle[faces[nearest]]  # a centroid is on its face
    size = np.ceil(np.log2(np.maximum(reach_m[faces], 1e-12)))
    for one in np.unique(size):  # grouped by size: otherwise one large face would make each point search all small ones
        tree, of = cKDTree(middle[faces[size == one]]), faces[size == one]
        for part in np.array_split(np.arange(len(points_m)), max(len(points_m) // 200, 1)):
            within = tree.query_ball_point(points_m[part], np.minimum(best_m[part], near_m) + reach_m[of].max())
            point = np.repeat(part, [len(some) for some in within])
            candidate = of[np.concatenate([*within, []]).astype(np.int64)]
            found = closest_point(corners[candidate], points_m[point])
            away_m = np.linalg.norm(found - points_m[point], axis=1)
            order = np.lexsort((away_m, point))
            first = order[np.unique(point[order], return_index=True)[1]]
            closer = first[away_m[first] < best_m[point[first]]]
            best_m[point[closer]], at_m[point[closer]] = away_m[closer], found[closer]
            face[point[closer]] = candidate[closer]
    return at_m, face


@cache
def reduced(scene_file: str | None, body: str, divisor: int, ticks: int = TICKS) -> Mesh:
    """Return the mesh of a body with 1/divisor of its faces, reduced as `hapscene tune` does."""
    body_of = touched(scene_file, body, ticks).body
    if divisor == 1:
        return body_of.mesh
    plain = replace(body_of, face_swatch=np.zeros_like(body_of.face_swatch))  # borders between swatches are ignored
    return coarser_mesh(plain, len(body_of.mesh.faces) // divisor, (PLAIN.name,)) or body_of.mesh
