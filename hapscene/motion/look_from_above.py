"""View of a scene from above: heights, bodies and swatches, and the best lines for a stroke."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.topology import normals_of

if TYPE_CHECKING:
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    from hapscene.scene.mesh import Mesh
    from hapscene.scene.scene import Scene

__all__ = [
    "UNSEEN",
    "Line",
    "Look",
    "TopView",
    "between",
    "caster_of",
    "look_from_above",
    "places_to_feel",
    "window_of",
]

Line = tuple[tuple[float, float], tuple[float, float]]
"""Start and end in x and y [m]."""

WINDOW_M: Final = 0.2
"""Largest extent of the explored part of a body [m]: about the reach of a hand without moving the arm."""

GRID: Final = 25
"""Points along each side of the grid on which a body is sampled [count]."""

SIDE_M: Final = 1e-3
"""Margin around the bounding box of a body within which rays are cast [m], above the error of float32."""

UNSEEN: Final = (
    "no body has an outer face that points upwards, so nothing can be touched from above; if faces point inwards "
    "(see `hapscene check`), use --two-sided"
)
"""Error message for a scene that cannot be touched from above."""


@dataclass(frozen=True)
class TopView:
    """The surface as seen from above at k positions."""

    z_m: NDArray[np.float64]
    """(k,) height of the surface [m]; NaN without a surface."""
    body: NDArray[np.int64]
    """(k,) index of the body, −1 without a surface; `swatch` likewise."""
    swatch: NDArray[np.int64]


Look = Callable[[NDArray[np.float64], NDArray[np.float64]], TopView]
"""A function that returns the `TopView` at x_m (k,), y_m (k,)."""


def look_from_above(scene: "Scene") -> Look:
    """Create a function that looks down on the scene. Inner faces are ignored, except on two-sided bodies.

    It uses trimesh's rays in float32, which are accurate to a micrometre at the size of a scene, enough for a target.
    """
    top_m = max(float(body.bounds_W_m[1, 2]) for body in scene.bodies) + 1.0
    casters = {id(body.mesh): caster_of(body.mesh) for body in scene.bodies}

    def look(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> TopView:
        count = len(x_m)
        z_m, seen_body, swatch = np.full(count, np.nan), np.full(count, -1), np.full(count, -1)
        start_m = np.column_stack((x_m, y_m, np.full(count, top_m)))
        for index, body in enumerate(scene.bodies):
            low_m, high_m = body.bounds_W_m[:, :2] + np.array([[-SIDE_M], [SIDE_M]])
            if not ((start_m[:, :2] > low_m) & (start_m[:, :2] < high_m)).all(axis=1).any():
                continue  # a ray costs up to a millisecond
            R_WB, p_WB = body.X_WB[:3, :3], body.X_WB[:3, 3]
            down_B = np.tile(-R_WB[2], (count, 1))
            at_m, ray, face = casters[id(body.mesh)].intersects_location(
                (start_m - p_WB) @ R_WB, down_B, multiple_hits=False
            )
            up = normals_of(body.mesh.vertices_m[body.mesh.faces[face]]) @ R_WB[2]
            height_m = at_m @ R_WB[2] + p_WB[2]
            better = ((up > 0.05) | body.two_sided) & ~(height_m <= z_m[ray])
            ray = ray[better]
            z_m[ray], seen_body[ray] = height_m[better], index
            swatch[ray] = body.face_swatch[face[better]]
        return TopView(z_m, seen_body, swatch)

    return look


def caster_of(mesh: "Mesh") -> "RayMeshIntersector":
    """A `trimesh` object that casts rays in the frame of the body, with the search structure of Embree."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    return RayMeshIntersector(trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False))


def window_of(bounds_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The explored part of a body's bounding box in x and y (2, 2) [m]."""
    middle_m, half_m = bounds_m[:, :2].mean(axis=0), np.ptp(bounds_m[:, :2], axis=0) / 2
    half_m = np.minimum(half_m * 0.96, WINDOW_M / 2)
    return np.array([middle_m - half_m, middle_m + half_m])


def lines_of(look: Look, body: int, window_m: NDArray[np.float64]) -> list[Line]:
    """The best line for a stroke along x and the best along y; fewer if the body is not visible."""
    x_m, y_m = (np.linspace(window_m[0, k], window_m[1, k], GRID) for k in (0, 1))
    X_m, Y_m = np.meshgrid(x_m, y_m)
    view = look(X_m.ravel(), Y_m.ravel())
    seen = (view.body == body).reshape(GRID, GRID)
    swatch = view.swatch.reshape(GRID, GRID)
    lines = []
    for mask, colour, along_x in ((seen, swatch, True), (seen.T, swatch.T, False)):
        runs = [_longest_run(row) for row in mask]
        scores = [_score(colour[k, a:b], k) if b - a > 2 else -1.0 for k, (a, b) in enumerate(runs)]
        best = int(np.argmax(scores))
        if scores[best] < 0:
            continue
        a, b = runs[best]
        inset = 1 if b - a > 6 else 0  # not from the edge itself
        ends = (a + inset, b - 1 - inset)
        start, end = [(float(x_m[k]), float(y_m[best])) if along_x else (float(x_m[best]), float(y_m[k])) for k in ends]
        lines.append((start, end))
    return lines


def places_to_feel(scene: "Scene", look: Look) -> Iterator[tuple[list[Line], float]]:
    """For each body that can be touched from above: its best lines along x and y, and the explored size [m]."""
    for index, body in enumerate(scene.bodies):
        window_m = window_of(body.bounds_W_m)
        lines = lines_of(look, index, window_m)
        if len(lines) == 2:
            yield lines, float(np.min(window_m[1] - window_m[0]))


def _score(swatch: NDArray[np.int64], row: int) -> float:
    """Score of a line: number of borders between swatches, then length, then distance from the middle."""
    return 10.0 * np.count_nonzero(np.diff(swatch)) + len(swatch) / GRID - abs(row - GRID // 2) / GRID


def _longest_run(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Start and end of the longest contiguous run of True."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if not len(edges):
        return 0, 0
    start, end = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    return int(start), int(end)


def between(start_m: tuple[float, float], end_m: tuple[float, float], share: float) -> tuple[float, float]:
    """The point at a fraction of a line, 0 … 1."""
    x_m, y_m = np.add(start_m, share * np.subtract(end_m, start_m))
    return float(x_m), float(y_m)
