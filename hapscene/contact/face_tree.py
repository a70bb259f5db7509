"""A tree of flat cylinders around the faces of a mesh, with which compiled code finds the face closest to a point.

Embree answers rays only. Each node is bounded by a cylinder, whose axis is the mean normal of its faces: where a mesh
is smooth, cylinders are flat, and a ball that lies on the mesh is close to a few of them only. Boxes would stand out of
the surface by a fraction of their width, and ten to a hundred times as many faces would have to be tested.

The tree is complete and balanced: node i has the children 2i and 2i + 1, and each node halves its faces at the median
along the longest axis of their centres.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.contact.triangle import is_narrow
from hapscene.geometry import Vector, along, cross, dot, norm, row, sub

__all__ = ["LEAF_MAX", "build_tree", "fit_cylinders", "way_from_cylinder"]

LEAF_MAX: Final = 4
"""Most faces of a leaf [count]."""

FIT_MAX: Final = 512
"""Most faces to which a cylinder is fitted exactly [count]; it bounds the time to build a tree."""

SWELL: Final = 1e-6
"""Relative enlargement of the cylinders [1]: above the rounding of float32."""


def build_tree(corners_m: NDArray[np.float64], least_m: float) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Build the tree over faces (f, 3, 3) [m]; faces narrower than `least_m` are left out, as rays leave them out.

    Returns:
        Cylinders (2 n, 8) of the nodes: centre, axis, radius and half height. Node 1 is the root, node 0 is not used,
        the leaves are the last n nodes. Faces (m,) in the order of the leaves: leaf k has those from k m // n to
        (k + 1) m // n.
    """
    center = corners_m.mean(axis=1)
    order = np.empty(len(corners_m), np.int32)
    order = order[: _wide_faces(corners_m, least_m, order)]
    leaves = 1
    while leaves * LEAF_MAX < len(order):
        leaves *= 2
    tree = np.zeros((2 * leaves, 8), np.float32)
    _sort_faces(center[order], order, leaves)
    fit_cylinders(corners_m, order, tree)
    return tree, order


@native
def _wide_faces(corners_m: NDArray[np.float64], least_m: float, order: NDArray[np.int32]) -> int:
    """List the faces that are not narrow in `order`; return their number."""
    count = 0
    for face in range(len(corners_m)):
        c = corners_m[face]
        if not is_narrow(row(c, 0), row(c, 1), row(c, 2), least_m):
            order[count] = face
            count += 1
    return count


@native
def _sort_faces(center: NDArray[np.float64], order: NDArray[np.int32], leaves: int) -> None:
    """Sort `order`, and the centres with it, such that each node halves its faces along their longest axis."""
    width = leaves
    while width > 1:  # leaves below each node of this level
        for first in range(0, leaves, width):
            start, end = first * len(order) // leaves, (first + width) * len(order) // leaves
            middle = (first + width // 2) * len(order) // leaves
            low, high = row(center, start), row(center, start)
            for i in range(start, end):
                x, y, z = row(center, i)
                low = min(low[0], x), min(low[1], y), min(low[2], z)
                high = max(high[0], x), max(high[1], y), max(high[2], z)
            size = sub(high, low)
            axis = 0 if size[0] >= max(size[1], size[2]) else 1 if size[1] >= size[2] else 2
            _partition(center, order, axis, start, middle, end)
        width //= 2


@native
def _partition(
    center: NDArray[np.float64], order: NDArray[np.int32], axis: int, start: int, middle: int, end: int
) -> None:
    """Move the faces with the smallest centres along an axis to the front of `order[start:end]` (Hoare's selection)."""
    low, high = start, end - 1
    while low < high:
        pivot = center[(low + high) // 2, axis]
        i, j = low, high
        while i <= j:
            while center[i, axis] < pivot:
                i += 1
            while center[j, axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                for k in range(3):
                    center[i, k], center[j, k] = center[j, k], center[i, k]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break


@native
def fit_cylinders(corners_m: NDArray[np.float64], order: NDArray[np.int32], tree: NDArray[np.float32]) -> None:
    """Fit the cylinders of all nodes to the faces (f, 3, 3) below them; those of large nodes to their children."""
    leaves, count = len(tree) // 2, len(order)
    for node in range(len(tree) - 1, 0, -1):
        width, first = leaves, node
        while first >= 2:
            width, first = width // 2, first // 2
        first = node * width - leaves
        start, end = first * count // leaves, (first + width) * count // leaves
        if end - start <= FIT_MAX:
            _fit_cylinder(corners_m, order[start:end], tree[node])
        else:
            _merge_cylinders(tree[2 * node], tree[2 * node + 1], tree[node])


@native
def _merge_cylinders(one: NDArray[np.float32], two: NDArray[np.float32], node: NDArray[np.float32]) -> None:
    """Fit a cylinder to two others: their axes and sizes bound the farthest points."""
    a, b = (float(one[3]), float(one[4]), float(one[5])), (float(two[3]), float(two[4]), float(two[5]))
    axis = along(a, 1.0 if dot(a, b) >= 0.0 else -1.0, b)
    length = norm(axis)
    for k in range(3):
        node[k] = 0.5 * (one[k] + two[k])
        node[3 + k] = axis[k] / length
    axis = (float(node[3]), float(node[4]), float(node[5]))
    radius, height = 0.0, 0.0
    for child in (one, two):
        way = (float(child[0] - node[0]), float(child[1] - node[1]), float(child[2] - node[2]))
        up = dot(axis, way)
        c = abs(axis[0] * child[3] + axis[1] * child[4] + axis[2] * child[5])
        s = math.sqrt(max(1.0 - c * c, 0.0))
        height = max(height, abs(up) + c * child[7] + s * child[6])
        radius = max(radius, norm(along(way, -up, axis)) + child[6] + s * child[7])
    node[6] = radius + SWELL * (radius + height)
    node[7] = height + SWELL * (radius + height)


@native
def _fit_cylinder(corners_m: NDArray[np.float64], faces: NDArray[np.int32], node: NDArray[np.float32]) -> None:
    """Fit the cylinder of one node. The search reads what is written, so radius and height follow rounded numbers."""
    axis = (0.0, 0.0, 0.0)
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for face in faces:
        c = corners_m[face]
        n = cross(sub(row(c, 1), row(c, 0)), sub(row(c, 2), row(c, 0)))
        axis = along(axis, 1.0 if dot(n, axis) >= 0.0 else -1.0, n)
        for k in range(3):
            x, y, z = c[k, 0], c[k, 1], c[k, 2]
            low = min(low[0], x), min(low[1], y), min(low[2], z)
            high = max(high[0], x), max(high[1], y), max(high[2], z)
    length = norm(axis)
    if not length > 0.0:
        axis, length = (0.0, 0.0, 1.0), 1.0
    for k in range(3):
        node[3 + k] = axis[k] / length
    axis = (float(node[3]), float(node[4]), float(node[5]))
    m = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
    least, most = np.inf, -np.inf
    for face in faces:
        for k in range(3):
            h = dot(axis, sub(row(corners_m[face], k), m))
            least, most = min(least, h), max(most, h)
    m = along(m, 0.5 * (least + most), axis)
    for k in range(3):
        node[k] = m[k]
    m = (float(node[0]), float(node[1]), float(node[2]))
    radius2, height = 0.0, 0.0
    for face in faces:
        for k in range(3):
            d = sub(row(corners_m[face], k), m)
            h = dot(axis, d)
            radius2, height = max(radius2, dot(d, d) - h * h), max(height, abs(h))
    radius = math.sqrt(radius2)
    node[6] = radius + SWELL * (radius + height)
    node[7] = height + SWELL * (radius + height)


@native
def way_from_cylinder(node: NDArray[np.float32], p: Vector) -> tuple[float, Vector]:
    """Return the distance from the closest point of a cylinder (8,) to `p`, and the way; both are 0 inside."""
    axis, radius, half = (float(node[3]), float(node[4]), float(node[5])), float(node[6]), float(node[7])
    away = sub(p, (float(node[0]), float(node[1]), float(node[2])))
    height = dot(axis, away)
    beside = along(away, -height, axis)
    beside2 = dot(away, away) - height * height  # not from `beside`, for which the processor would have to wait
    out = share = 0.0
    if beside2 > radius * radius:
        distance = math.sqrt(beside2)
        out, share = distance - radius, 1.0 - radius / distance
    up = height - math.copysign(half, height) if abs(height) > half else 0.0
    return math.sqrt(out * out + up * up), along((up * axis[0], up * axis[1], up * axis[2]), share, beside)
