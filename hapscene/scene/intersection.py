"""Faces of a mesh that cross each other, or lie on each other in one plane."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.topology import Index

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

    Two triangles that cross without lying in one plane do so because an edge of one goes through the inside
    of the other; that is what is looked for, after their boxes overlap.
    """
    crossing, lying = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2), np.int64)]
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    for pairs in overlapping(triangles_m.min(axis=1), triangles_m.max(axis=1)):
        pairs = pairs[(length[pairs] > 0).all(axis=(1, 2))]
        first, second = pairs.T
        above = _heights(triangles_m[second], a[first], normal[first])
        flat = np.asarray((np.abs(above) <= tolerance_m).all(axis=1))
        through = _on_both_sides(above, tolerance_m)
        pairs, flat = pairs[flat | through], flat[flat | through]
        lying.append(pairs[flat][_overlap(triangles_m, normal, pairs[flat], tolerance_m)])
        pairs = pairs[~flat]
        pairs = pairs[
            _on_both_sides(_heights(triangles_m[pairs[:, 0]], a[pairs[:, 1]], normal[pairs[:, 1]]), tolerance_m)
        ]
        pierced = _pierces(triangles_m, normal, pairs, tolerance_m)
        pierced |= _pierces(triangles_m, normal, pairs[:, ::-1], tolerance_m)
        crossing.append(pairs[pierced])
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


def _pierces(triangles_m: Points, normal: Points, pairs: Index, tolerance_m: float) -> NDArray[np.bool_]:
    """Whether an edge of the second of each pair goes through the inside of the first."""
    first, second = pairs.T
    target, n = triangles_m[first], normal[first]
    height = _heights(triangles_m[second], target[:, 0], n)
    found = np.zeros(len(pairs), np.bool_)
    for k in range(3):
        start, end = triangles_m[second, k], triangles_m[second, (k + 1) % 3]
        h0, h1 = height[:, k], height[:, (k + 1) % 3]
        through = (np.maximum(h0, h1) > tolerance_m) & (np.minimum(h0, h1) < -tolerance_m)
        t = np.divide(h0, h0 - h1, out=np.zeros(len(pairs)), where=through)
        point = start + t[:, None] * (end - start)
        found |= through & (_depth_inside(target, n, point) > tolerance_m)
    return found


def _depth_inside(triangles_m: Points, normal: Points, point: Points) -> Points:
    """Distance (n,) of points in the triangles' planes from the nearest side, positive inside."""
    depth = np.full(len(point), np.inf)
    for k in range(3):
        side = triangles_m[:, (k + 1) % 3] - triangles_m[:, k]
        inward = np.cross(normal, side)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        depth = np.minimum(depth, np.einsum("ij,ij->i", point - triangles_m[:, k], inward))
    return depth


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
