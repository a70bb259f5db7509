"""Errors of force and proxy on a sphere, against its facets and against the round surface."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hapscene.render.recording import Recording

from .case import RADIUS_M, Case
from .sheet import Sheet

Array = NDArray[np.float64]

DEPTH_MIN_M: Final = 1e-4
"""Penetration depth above which the direction is judged [m]."""

NEIGHBOURS: Final = 48
"""Facets with the nearest centroids that are searched in each tick [count]; the nearest plane is among them."""


def measure_accuracy(sheet: Sheet, case: Case, recording: Recording) -> None:
    """Measure the force against the sphere's normal, and the proxy against facets, closest point and round surface."""
    on = recording.touching & (recording.depth_m > DEPTH_MIN_M)
    tool, proxy, force = recording.p_WT_m[on], recording.p_WP_m[on], recording.f_W_N[on]
    sheet.add_spread(case.name, "force direction error", angle_deg(force, tool), "°")
    gap_m, lag_m = distances(case.mesh.triangles_m, proxy, tool)
    sheet.add_spread(case.name, "proxy to facets", np.abs(gap_m), "m")
    sheet.add_spread(case.name, "proxy to closest point", lag_m, "m")
    sheet.add_spread(case.name, "proxy to round surface", np.abs(RADIUS_M - np.linalg.norm(proxy, axis=1)), "m")


def angle_deg(a: Array, b: Array) -> Array:
    """Return the angles (n,) [°] between vectors (n, 3); for force and tool position on a sphere, the force's error."""
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, np.einsum("ni,ni->n", a, b))))


def distances(corners_m: Array, proxy_m: Array, tool_m: Array) -> tuple[Array, Array]:
    """Return the distances (n,) of proxies (n, 3) to a convex body, and to its point closest to the tool.

    The first is negative inside. Inside a convex body the distance to the surface is that to the nearest plane of a
    facet, and the closest point is the foot of the perpendicular on that plane.
    """
    middle = corners_m.mean(axis=1)
    n = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    offset = np.einsum("mi,mi->m", n, corners_m[:, 0])
    near = np.asarray(cKDTree(middle).query(proxy_m, k=min(NEIGHBOURS, len(middle)))[1])
    gap = (np.einsum("nki,ni->nk", n[near], proxy_m) - offset[near]).max(axis=1)
    height = np.einsum("nki,ni->nk", n[near], tool_m) - offset[near]
    best = height.argmax(axis=1)
    rows = np.arange(len(tool_m))
    foot = tool_m - height[rows, best, None] * n[near[rows, best]]
    return np.asarray(gap), np.asarray(np.linalg.norm(proxy_m - foot, axis=1))
