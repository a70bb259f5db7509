"""A surface that a tool is led over, and the truth of it: closed form on a sphere, else the closest point of the mesh.

The closest point is found by distances to triangles of the finest mesh, with no ray and no proxy: neither the search
structure nor the constraint of the method under test has a part in it. Coarser meshes are compared with the same truth.
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
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.touch import open_scene

from ..bench.case import RADIUS_M, slide_path, sphere

Array = NDArray[np.float64]

DEMO: Final = str(Path(__file__).resolve().parents[2] / "assets" / "demo.scene.json")

SPHERE: Final = "sphere"
"""What stands in the place of a body's name for the icosphere of 82 k triangles, of 50 mm radius, whose truth is
round."""

TICKS: Final = 3000
"""Length of the path over the sphere [count]; over a body it is what a hand that explores it makes."""

LOOKS_DOWN: Final = -0.1
"""Upward part of a face's normal below which a hand from above does not feel it [1]: the back of a thin plate is closer
to a tool that was pressed into it than its front."""

NEAR_M: Final = 4e-3
"""Deeper than a hand that explores presses [m]."""

BODY_FACES_MIN: Final = 1000
"""Faces from which a body is worth reducing [count]."""

BODY_MAX: Final = 3
"""Most bodies of a scene that are asked about, the largest [count]."""


@dataclass(frozen=True)
class Touched:
    """A body by itself, a path over it, and what is true at each tick.

    Attributes:
        body: as it is in its scene, with its finest mesh.
        p_WT_m: (n, 3) of the tool.
        into_m: (n, 3) from the tool to the closest point of the surface; 0 where the tool is outside. Times the
            stiffness it is the force.
        swatch: the one that most of the touched ticks are on.
    """

    body: Body
    p_WT_m: Array
    into_m: Array
    swatch: Swatch

    def scene(self, mesh: Mesh, swatch: Swatch = PLAIN) -> Scene:
        """A scene of the body with another mesh, all of one swatch: where borders lie is not asked here."""
        scene = Scene()
        scene.add(mesh, name=self.body.name, pose=self.body.X_WB, two_sided=self.body.two_sided, swatch=swatch)
        return scene


def bodies_of(scene_file: str | None) -> list[str]:
    """Names of the bodies of a scene that are large enough to be reduced, no two of one mesh, the largest first."""
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
    """The sphere, or a body of a scene, with a path over it and what is true there."""
    if body == SPHERE:
        scene = Scene()
        made = scene.add(sphere(6), name=SPHERE)
        path = slide_path(ticks)
        distance_m = np.linalg.norm(path, axis=1, keepdims=True)
        into_m = np.where(distance_m < RADIUS_M, (RADIUS_M - distance_m) / distance_m * path, 0.0)
        return Touched(made, path, into_m, PLAIN)
    whole = _scene(scene_file or DEMO)
    one = whole.body(body)
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
    worn = np.bincount(one.face_swatch[face[inside]], minlength=len(whole.swatches))
    return Touched(one, path, into_m, whole.swatches[int(np.argmax(worn))])


def closest_points(
    mesh: Mesh, points_m: Array, among: NDArray[np.int64] | None = None, near_m: float = np.inf
) -> tuple[Array, NDArray[np.int64]]:
    """The points (n, 3) [m] of a mesh that are closest to points (n, 3), and their faces (n,).

    Exact, but for points that are farther than `near_m`: a face whose middle is farther than the best point found and
    its own reach cannot be closer. With `among`, of those faces alone.
    """
    closest_point: Any = triangles.closest_point
    corners = mesh.triangles_m
    middle = corners.mean(axis=1)
    reach_m = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    faces = np.arange(len(corners)) if among is None else among
    best_m, nearest = (np.asarray(found) for found in cKDTree(middle[faces]).query(points_m))
    face, at_m = faces[nearest], middle[faces[nearest]]  # a middle is on its face
    size = np.ceil(np.log2(np.maximum(reach_m[faces], 1e-12)))
    for one in np.unique(size):  # by size: else one large face has each point look at all the small ones
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
    """The mesh of a body with that part of its faces, as `hapscene tune` reduces it, as far as its borders let it."""
    body_of = touched(scene_file, body, ticks).body
    if divisor == 1:
        return body_of.mesh
    plain = replace(body_of, face_swatch=np.zeros_like(body_of.face_swatch))  # where borders lie is not asked here
    return coarser_mesh(plain, len(body_of.mesh.faces) // divisor, (PLAIN.name,)) or body_of.mesh
