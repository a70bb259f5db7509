"""An algorithm of its own: faces of a mesh that cross each other, or lie on each other in one plane."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.topology import Index, normals_of

Points = NDArray[np.float64]

BATCH: Final = 1 << 19
"""Pairs of boxes that are compared at once [count]: some 100 MB."""


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
    """All pairs (n, 2) of boxes (M, 3) that overlap, in batches.

    The boxes are sorted along a Morton curve and gathered two by two into a tree, which is then walked
    against itself, a level at a time for a whole batch of pairs.
    """
    order = _morton_order((low + high) / 2)
    size = 1 << max(len(low) - 1, 0).bit_length()
    lows, highs = np.full((size, 3), np.inf), np.full((size, 3), -np.inf)  # what is missing overlaps nothing
    lows[: len(low)], highs[: len(low)] = low[order], high[order]
    tree = [(lows, highs)]
    while len(tree[-1][0]) > 1:
        lows, highs = tree[-1]
        tree.append((lows.reshape(-1, 2, 3).min(axis=1), highs.reshape(-1, 2, 3).max(axis=1)))
    work = [(len(tree) - 1, np.zeros((1, 2), np.int64))]
    while work:
        level, pairs = work.pop()
        if len(pairs) > BATCH:
            work += [(level, half) for half in np.array_split(pairs, 2)]
            continue
        lows, highs = tree[level]
        i, j = pairs.T
        pairs = pairs[((lows[i] <= highs[j]) & (lows[j] <= highs[i])).all(axis=1)]
        if level == 0:
            yield order[pairs[pairs[:, 0] != pairs[:, 1]]]
        elif len(pairs):
            split = 2 * pairs[:, None, :] + np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
            own = pairs[:, 0] == pairs[:, 1]
            work.append((level - 1, np.concatenate([split[:, :3].reshape(-1, 2), split[~own, 3]])))


def _morton_order(points: Points) -> Index:
    span = np.ptp(points, axis=0).max()
    cell = ((points - points.min(axis=0)) * (1023.0 / span if span > 0 else 0.0)).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")


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
