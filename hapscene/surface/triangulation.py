"""The plane of normal force and slip speed, closed and cut into triangles around a texture's models."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SwatchError

Array = NDArray[np.float64]

NEAR: Final = 0.02
"""Distance within which no second model is added along a side when the plane is closed, as a share of that side [1].
Smaller makes slivers between models that stand almost above each other."""


def close(force_N: Array, speed_m_s: Array) -> tuple[Array, Array, NDArray[np.intp], Array]:
    """Adds what closes the rectangle: force, speed, the model copied from, and 0 where it is silent, 1 elsewhere.

    Each model throws a silent copy onto the two axes, so that its spectrum keeps its shape while the level falls.
    Onto the two sides of largest force and speed it throws a copy of whatever model is nearest there: without it, a
    place beyond the last model of its own speed would be blended from models of other speeds.
    """
    force_N, speed_m_s = np.asarray(force_N, dtype=np.float64), np.asarray(speed_m_s, dtype=np.float64)
    if force_N.shape != speed_m_s.shape or not np.all((force_N > 0.0) & (speed_m_s > 0.0)):
        raise SwatchError("texture: each model needs a force_N and a speed_m_s above 0")
    place = np.stack([force_N / force_N.max(), speed_m_s / speed_m_s.max()], axis=1)
    x, y = np.sort(place, axis=0)[::-1].T
    count = len(place)
    for axis in (0, 1):
        for side in (0.0, 1.0):
            along = [1.0, 0.0]  # the corners first
            for at in (y, x)[axis]:
                if np.abs(np.array(along) - at).min() > NEAR:
                    along.append(float(at))
            thrown = np.insert(np.array(along)[:, None], axis, side, axis=1)
            there = (np.abs(thrown[:, None] - place).max(axis=2) < 1e-9).any(axis=1)
            place = np.vstack([place, thrown[~there]])
    away = np.linalg.norm(place[:, None] - place[None, :count], axis=2)
    sounding = (place.min(axis=1) > 0.0).astype(np.float64)
    # A silent copy looks like the model that threw it: the one at its own speed or force, not the nearest.
    beside = np.where(sounding[:, None] > 0.0, away, _beside(place, place[:count]))
    top = np.array([force_N.max(), speed_m_s.max()])
    force, speed = (place * top).T
    force[:count], speed[:count] = force_N, speed_m_s  # to the bit
    return force, speed, np.argmin(beside, axis=1), sounding


def _beside(place: Array, model: Array) -> Array:
    """How far (k, m) each model is along the axis that each place lies on, and a little how far off it."""
    off = np.abs(place[:, None] - model)
    on_force_axis = (place[:, 1] == 0.0)[:, None]
    along, across = np.where(on_force_axis, off[..., 0], off[..., 1]), np.where(on_force_axis, off[..., 1], off[..., 0])
    return np.asarray(along + 0.01 * across)


def triangulate(force_N: Array, speed_m_s: Array) -> NDArray[np.int32]:
    """Delaunay triangles (t, 3) over the plane scaled to 1 × 1, without flat ones."""
    from scipy.spatial import Delaunay

    x, y = force_N / force_N.max(), speed_m_s / speed_m_s.max()
    # Four models on a rectangle can be cut along either diagonal. Stretched across the diagonal a little, Delaunay
    # takes the one from silence to full level, along which the level does not sag.
    triangles = Delaunay(np.stack([x + y, 1.001 * (x - y)], axis=1)).simplices
    corner = np.stack([x, y], axis=1)[triangles]
    side = corner[:, 1:] - corner[:, :1]
    area = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
    return _opened(np.asarray(triangles[area > 1e-6], dtype=np.int32), np.minimum(x, y) == 0.0)


def _opened(triangles: NDArray[np.int32], silent: NDArray[np.bool_]) -> NDArray[np.int32]:
    """No triangle has three silent corners: one at the origin is joined to what sounds beyond it instead."""
    opened = [list(map(int, corners)) for corners in triangles]
    for dead in [corners for corners in opened if silent[corners].all()]:
        for other in opened:
            edge = [corner for corner in dead if corner in other]
            if other is not dead and len(edge) == 2 and not silent[other].all():
                (origin,), (beyond,) = set(dead) - set(edge), set(other) - set(edge)
                dead[:], other[:] = [origin, edge[0], beyond], [origin, beyond, edge[1]]
                break
    return np.asarray(opened, dtype=np.int32)
