"""The contact patch: distributes the force of a round tip over the vertices of a body.

A point load on a discretised soft body is ill-posed: the displacement under it grows without bound as the mesh is
refined. The pressure under a ball of radius r, pressed d deep into an elastic body, is √(1 − ρ²/a²) within the radius
a = √(r d) (Hertz 1882), and zero outside. Each vertex gets the integral of the pressure times its shape function, which
is linear on each face. A correction keeps the moment exactly, as in the RBE3 element of Nastran.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["spread_force"]

Array = NDArray[np.float64]

SAMPLES: Final = 4
"""Least samples along the radius of the patch [count]; with 2, the weights of a coarse mesh are 5 % off."""

CUTS_MAX: Final = 16
"""Most parts into which an edge is cut [count]. It bounds the time on a face that is much larger than the patch."""


def spread_force(
    vertices_m: Array, faces: NDArray[np.integer], face: int, *, p_m: Array, f_N: Array, radius_m: float
) -> Array:
    """Distribute a force `f_N` (3,) at `p_m` (3,) on `face` over vertices (N, 3); returns their forces (N, 3) [N].

    Sum and moment are exact. If the shape has moved on since the contact, the force acts at the nearest point of the
    face. A patch that no sample hits loads the corners of the face.
    """
    triangle = vertices_m[faces[face]]
    edges = triangle[1:] - triangle[0]
    bary = np.linalg.lstsq(edges.T, p_m - triangle[0], rcond=None)[0]
    bary = np.clip([1.0 - bary.sum(), *bary], 0.0, None)
    bary /= bary.sum()
    p_m = bary @ triangle
    count = len(vertices_m)
    weight = _pressure(vertices_m, faces, p_m, np.cross(*edges), radius_m)
    if not weight.any():
        weight[faces[face]] = bary
    used = np.flatnonzero(weight)
    w = weight[used] / weight.sum()
    arm = vertices_m[used] - w @ vertices_m[used]
    inertia = np.einsum("i,ij,ij", w, arm, arm) * np.eye(3) - np.einsum("i,ij,ik->jk", w, arm, arm)
    turn = np.linalg.lstsq(inertia, np.cross(p_m - w @ vertices_m[used], f_N), rcond=1e-12)[0]
    force = np.zeros((count, 3))
    force[used] = w[:, None] * (f_N + np.cross(turn, arm))
    return force


def _pressure(vertices_m: Array, faces: NDArray[np.integer], p_m: Array, out: Array, radius_m: float) -> Array:
    """Return the integral (N,) of pressure times shape function of each vertex, over the faces on the same side."""
    away = vertices_m - p_m
    beyond = (away > radius_m) @ (1, 2, 4) + (away < -radius_m) @ (8, 16, 32)  # sides of the cube around the patch
    faces = faces[np.bitwise_and.reduce(beyond[faces.T]) == 0]
    corner = vertices_m[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    front = normal @ out > 0.0
    faces, corner, normal = faces[front], corner[front], normal[front]
    if radius_m <= 0.0 or len(faces) == 0:
        return np.zeros(len(vertices_m))
    longest_m = float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max())
    shape = _centroids(int(np.clip(np.ceil(SAMPLES * longest_m / radius_m), 1, CUTS_MAX)))
    distance = np.linalg.norm(shape @ corner - p_m, axis=2) / radius_m
    pressure = np.sqrt(np.maximum(1.0 - distance**2, 0.0)) * (np.linalg.norm(normal, axis=1) / len(shape))[:, None]
    return np.asarray(np.bincount(faces.ravel(), (pressure @ shape).ravel(), len(vertices_m)), np.float64)


def _centroids(cuts: int) -> Array:
    """Return the barycentric coordinates (cuts², 3) of the centroids of the parts of a face with its edges cut."""
    i, j = (axis.ravel() for axis in np.mgrid[:cuts, :cuts])
    up, down = i + j < cuts, i + j < cuts - 1
    u = np.r_[i[up] + 1 / 3, i[down] + 2 / 3] / cuts
    v = np.r_[j[up] + 1 / 3, j[down] + 2 / 3] / cuts
    return np.column_stack((u, v, 1.0 - u - v))
