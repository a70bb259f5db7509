"""Faces of a mesh that cross each other, or overlap in one plane."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.scene.topology import Index, normals_of

__all__ = ["Crossing", "crossings", "overlapping"]

Points = NDArray[np.float64]

BATCH: Final = 1 << 19
"""Pairs of boxes that are examined at once [count]: some 100 MB."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """Pairs of faces.

    Attributes:
        crossing: (n, 2) faces that go through each other.
        lying: (m, 2) faces that overlap in one plane.
    """

    crossing: Index
    lying: Index


def crossings(triangles_m: Points, tolerance_m: float) -> Crossing:
    """Pairs of triangles (M, 3, 3) that reach into each other by more than a tolerance [m]; touching is not.

    Two triangles that do not lie in one plane cross where each has corners on both sides of the other's plane, and
    they share more than a point of the line in which the planes meet.
    """
    crossing, lying = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2), np.int64)]
    corner, normal = triangles_m[:, 0], normals_of(triangles_m)
    has_area = (normal != 0.0).any(axis=1)
    for pairs in overlapping(triangles_m.min(axis=1), triangles_m.max(axis=1)):
        pairs = pairs[has_area[pairs].all(axis=1)]
        first, second = pairs.T
        above = _heights(triangles_m[second], corner[first], normal[first])
        flat = pairs[(np.abs(above) <= tolerance_m).all(axis=1)]
        lying.append(flat[_overlap(triangles_m, normal, flat, tolerance_m)])
        through = _on_both_sides(above, tolerance_m)
        pairs, above = pairs[through], above[through]
        first, second = pairs.T
        below = _heights(triangles_m[first], corner[second], normal[second])
        through = _on_both_sides(below, tolerance_m)
        pairs, above, below = pairs[through], above[through], below[through]
        common_m = _common(triangles_m[pairs], above, below, normal[pairs])
        crossing.append(pairs[common_m > tolerance_m])
    return Crossing(np.concatenate(crossing), np.concatenate(lying))


def overlapping(low: Points, high: Points) -> Iterator[Index]:
    """All pairs (n, 2) of boxes (M, 3) that overlap, in batches: sort and sweep along one axis."""
    if not len(low):
        return
    # the axis along which a box overlaps the fewest others
    axis = int(np.argmin((high - low).sum(axis=0) / np.maximum(np.ptp(low, axis=0), 1e-300)))
    order = np.argsort(low[:, axis])
    lows, highs = (np.ascontiguousarray(np.roll(corners[order], -axis, axis=1)) for corners in (low, high))
    found = np.empty((BATCH, 2), np.int64)
    i, j = 0, 1
    while i < len(low):
        i, j, count = _sweep(lows, highs, i, j, found)
        yield order[found[:count]]


@native
def _sweep(low: Points, high: Points, i: int, j: int, found: Index) -> tuple[int, int, int]:
    """Continue from boxes `i` and `j`, sorted by the first axis, until `found` is full; returns both and the count."""
    count = 0
    while i < len(low):
        while j < len(low) and low[j, 0] <= high[i, 0]:
            apart = low[j, 1] > high[i, 1] or low[i, 1] > high[j, 1] or low[j, 2] > high[i, 2] or low[i, 2] > high[j, 2]
            if not apart:
                if count == len(found):
                    return i, j, count
                found[count, 0], found[count, 1] = i, j
                count += 1
            j += 1
        i += 1
        j = i + 1
    return i, j, count


def _heights(triangles_m: Points, origin: Points, normal: Points) -> Points:
    """Height (n, 3) of the corners of triangles over planes."""
    return np.asarray(np.einsum("nkj,nj->nk", triangles_m - origin[:, None], normal))


def _on_both_sides(height: Points, tolerance_m: float) -> NDArray[np.bool_]:
    return np.asarray((height.max(axis=1) > tolerance_m) & (height.min(axis=1) < -tolerance_m))


def _common(pair_m: Points, above: Points, below: Points, normal: Points) -> Points:
    """Length (n,) of the line that two triangles (n, 2, 3, 3) share, each on both sides of the other's plane.

    The planes meet in a line; each triangle covers an interval of it (Möller 1997, section 3).
    """
    line = np.cross(normal[:, 0], normal[:, 1])
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    low, high = np.full(len(pair_m), -np.inf), np.full(len(pair_m), np.inf)
    for corners, height in ((pair_m[:, 0], below), (pair_m[:, 1], above)):
        start, end = np.full(len(pair_m), np.inf), np.full(len(pair_m), -np.inf)
        for k in range(3):
            h0, h1 = height[:, k], height[:, (k + 1) % 3]
            meets = (h0 * h1 <= 0) & (h0 != h1)
            t = np.divide(h0, h0 - h1, out=np.zeros(len(pair_m)), where=meets)
            point = corners[:, k] + t[:, None] * (corners[:, (k + 1) % 3] - corners[:, k])
            along = np.einsum("ij,ij->i", point, line)
            start, end = np.where(meets, np.minimum(start, along), start), np.where(meets, np.maximum(end, along), end)
        low, high = np.maximum(low, start), np.minimum(high, end)
    return np.asarray(high - low)


def _overlap(triangles_m: Points, normal: Points, pairs: Index, tolerance_m: float) -> NDArray[np.bool_]:
    """Whether triangles in one plane overlap: no side of either has all of the other outside."""
    found = np.ones(len(pairs), np.bool_)
    for first, second in (pairs.T, pairs[:, ::-1].T):
        target, other = triangles_m[first], triangles_m[second]
        for k in range(3):
            side = target[:, (k + 1) % 3] - target[:, k]
            inward = np.cross(normal[first], side)
            inward /= np.linalg.norm(inward, axis=1, keepdims=True)
            found &= _heights(other, target[:, k], inward).max(axis=1) > tolerance_m
    return found
