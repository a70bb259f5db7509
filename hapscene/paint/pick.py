"""Where on a scene's surface a ray from the eye falls."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hapscene.paint.shape import Shape
from hapscene.scene.body import Body


@dataclass(frozen=True, eq=False)
class Hit:
    """A place on the surface.

    Attributes:
        body: index of the body.
        face: of its mesh.
        p_W_m, p_B_m: (3,) the place in W and in the body's frame [m].
        nhat_W: (3,) outward normal of the face.
        distance_m: from the ray's origin [m].
    """

    body: int
    face: int
    p_W_m: NDArray[np.float64]
    p_B_m: NDArray[np.float64]
    nhat_W: NDArray[np.float64]
    distance_m: float


def pick(
    bodies: Sequence[Body], shapes: Sequence[Shape], origin_W_m: NDArray[np.float64], direction_W: NDArray[np.float64]
) -> Hit | None:
    """The nearest place along a ray (3,), (3,), faces met from both sides; None where there is none, or no ray."""
    if not (np.isfinite(origin_W_m).all() and np.isfinite(direction_W).all() and direction_W.any()):
        return None
    best: Hit | None = None
    for index, (body, shape) in enumerate(zip(bodies, shapes, strict=True)):
        R, p = body.X_WB[:3, :3], body.X_WB[:3, 3]
        found = shape.pick((origin_W_m - p) @ R, direction_W @ R)
        if found is not None and (best is None or found[1] < best.distance_m):
            face, distance, p_B = found
            best = Hit(index, face, R @ p_B + p, p_B, R @ shape.normal[face], distance)
    return best


def middle(bodies: Sequence[Body], shapes: Sequence[Shape], body: int, face: int) -> Hit:
    """The middle of a face as a place."""
    shape, X_WB = shapes[body], bodies[body].X_WB
    p_B = shape.centroid_m[face]
    p_W = X_WB[:3, :3] @ p_B + X_WB[:3, 3]
    return Hit(body, face, p_W, p_B.copy(), X_WB[:3, :3] @ shape.normal[face], 0.0)


def drape(body: Body, shape: Shape, hit: Hit, p_W_m: NDArray[np.float64], reach_m: float) -> NDArray[np.float64]:
    """Places (n, 3) in the plane of a hit laid down on its body, along the hit's normal; as they are beside it.

    Each goes to the first face under or over it, from `reach_m` above the plane to as much below.
    """
    R, p = body.X_WB[:3, :3], body.X_WB[:3, 3]
    down_B = -hit.nhat_W @ R
    laid = np.array(p_W_m)
    for i, start_B_m in enumerate((p_W_m - p) @ R - reach_m * down_B):
        found = shape.pick(start_B_m, down_B)
        if found is not None and found[1] <= 2 * reach_m:
            laid[i] = R @ found[2] + p
    return laid
