"""A tree of bounding boxes over the faces of a mesh, with which compiled code lists the faces near a point.

Embree answers rays only. The tree is complete and balanced: each node halves its faces at the median along the longest
axis of their centres, so that node i has the children 2i and 2i + 1, and a leaf holds at most `LEAF_MAX` faces. Boxes
are float32, rounded outwards.
"""

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.contact.triangle import is_narrow
from hapscene.geometry import Vector

if TYPE_CHECKING:
    pass

__all__ = ["STACK_MAX", "build_tree", "square_distance", "tree_size"]

LEAF_MAX: Final = 2
"""Most faces of a leaf [count]. With larger leaves, more faces are tested that are too far away."""

STACK_MAX: Final = 64
"""Nodes that a search keeps [count]: one for each level of the tree."""


def tree_size(count: int) -> int:
    """Return the number of leaves of a tree over `count` faces, a power of 2."""
    leaves = 1
    while leaves * LEAF_MAX < count:
        leaves *= 2
    return leaves


def build_tree(
    corners_m: NDArray[np.float64], least_m: float
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Build the tree over faces (f, 3, 3) [m]; faces narrower than `least_m` are left out, as rays leave them out.

    Returns:
        boxes (2 n, 2, 3), low and high corner of each node; node 1 is the root, node 0 is not used, and the leaves are
        the last n nodes. Faces (m,) in the order of the leaves: leaf k has the faces from k m // n to (k + 1) m // n.
    """
    center = np.ascontiguousarray((corners_m.min(axis=1) + corners_m.max(axis=1)) / 2.0)
    order = np.empty(len(corners_m), np.int32)
    order = order[: _wide_faces(corners_m, least_m, order)]
    boxes = np.empty((2 * tree_size(len(order)), 2, 3), np.float32)
    _sort_faces(center, order, len(boxes) // 2)
    _fit_boxes(corners_m, order, boxes)
    return boxes, order


@native
def _wide_faces(corners_m: NDArray[np.float64], least_m: float, order: NDArray[np.int32]) -> int:
    """List the faces that are not narrow in `order`; return their number."""
    count = 0
    for face in range(len(corners_m)):
        c = corners_m[face]
        a, b, d = (c[0, 0], c[0, 1], c[0, 2]), (c[1, 0], c[1, 1], c[1, 2]), (c[2, 0], c[2, 1], c[2, 2])
        if not is_narrow(a, b, d, least_m):
            order[count] = face
            count += 1
    return count


@native
def _sort_faces(center: NDArray[np.float64], order: NDArray[np.int32], leaves: int) -> None:
    """Sort `order` such that each node of the tree halves its faces along the longest axis of their centres."""
    width = leaves
    while width > 1:  # leaves below each node of this level
        for first in range(0, leaves, width):
            start, end = first * len(order) // leaves, (first + width) * len(order) // leaves
            middle = (first + width // 2) * len(order) // leaves
            axis, most = 0, -1.0
            for k in range(3):
                low, high = np.inf, -np.inf
                for i in range(start, end):
                    low, high = min(low, center[order[i], k]), max(high, center[order[i], k])
                if high - low > most:
                    axis, most = k, high - low
            _partition(center, order, axis, start, middle, end)
        width //= 2


@native
def _partition(
    center: NDArray[np.float64], order: NDArray[np.int32], axis: int, start: int, middle: int, end: int
) -> None:
    """Move the faces with the smallest centres along an axis to the front of `order[start:end]` (Hoare's selection)."""
    low, high = start, end - 1
    while low < high:
        pivot = center[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while center[order[i], axis] < pivot:
                i += 1
            while center[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break


@native
def _fit_boxes(corners_m: NDArray[np.float64], order: NDArray[np.int32], boxes: NDArray[np.float32]) -> None:
    """Write the boxes of all nodes, from the leaves to the root."""
    leaves, count = len(boxes) // 2, len(order)
    for node in range(len(boxes) - 1, 0, -1):
        for k in range(3):
            low, high = np.float32(np.inf), np.float32(-np.inf)
            if node >= leaves:
                leaf = node - leaves
                for i in range(leaf * count // leaves, (leaf + 1) * count // leaves):
                    for corner in range(3):
                        x = corners_m[order[i], corner, k]
                        low = min(low, np.nextafter(np.float32(x), np.float32(-np.inf)))
                        high = max(high, np.nextafter(np.float32(x), np.float32(np.inf)))
            else:
                low = min(boxes[2 * node, 0, k], boxes[2 * node + 1, 0, k])
                high = max(boxes[2 * node, 1, k], boxes[2 * node + 1, 1, k])
            boxes[node, 0, k], boxes[node, 1, k] = low, high


@native
def square_distance(box: NDArray[np.float32], p: Vector) -> float:
    """Return the squared distance from a point to a box (2, 3), 0 inside [m²]."""
    d2 = 0.0
    for k in range(3):
        d = max(box[0, k] - p[k], p[k] - box[1, k], 0.0)
        d2 += d * d
    return d2
