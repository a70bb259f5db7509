"""Which faces meet at which edge: a mesh of a million faces takes a third of a second.

Vertices at exactly the same place count as one, so a soup of unconnected triangles has the neighbours that
the eye sees. -0.0 and 0.0 are the same place.
"""

import secrets
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native

__all__ = [
    "Edges",
    "Index",
    "Winding",
    "area_of",
    "connected",
    "edges_of",
    "first_of",
    "normals_of",
    "unit",
    "volume_of",
    "weld",
    "winding_of",
]

Index = NDArray[np.int64]

_CHUNK: Final = 1 << 16
"""Faces whose corners are copied at a time [count]."""

_SALT: Final = np.uint64(secrets.randbits(64) | 1)
"""Drawn anew, so that nobody can make a file whose points all look alike: what is found does not depend on it."""


def weld(vertices_m: NDArray[np.float64]) -> Index:
    """For every vertex (N,) the lowest index of a vertex at exactly its place."""
    return first_of(np.ascontiguousarray(vertices_m + 0.0).view(np.uint64))  # + 0.0 turns -0.0 into 0.0


def first_of(rows: NDArray[np.uint64]) -> Index:
    """For every row (n, 3) the index (n,) of the first row that equals it."""
    first = np.empty(len(rows), np.int64)
    table = np.full(1 << (2 * len(rows)).bit_length(), -1, np.int32)  # at most half full
    _find_first(np.ascontiguousarray(rows), _mix(rows).view(np.int64), table, first)
    return first


def _mix(rows: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One number (n,) for each row (n, 3), most likely another for another row."""
    mixed = np.zeros(len(rows), np.uint64)
    for column in (*rows.T, np.uint64(0)):  # once more, since one round takes the last one's bits half the way
        mixed = (mixed ^ column) * _SALT
        mixed ^= mixed >> np.uint64(32)
    return mixed


@native
def _find_first(rows: NDArray[np.uint64], mixed: Index, table: NDArray[np.int32], first: Index) -> None:
    """Note each row in a table of indices, from the place on that its number names, unless its equal stands there."""
    mask = len(table) - 1
    for i in range(len(rows)):
        place = mixed[i] & mask
        while table[place] >= 0:
            k = table[place]
            if rows[k, 0] == rows[i, 0] and rows[k, 1] == rows[i, 1] and rows[k, 2] == rows[i, 2]:
                break
            place = (place + 1) & mask
        if table[place] < 0:
            table[place] = i
        first[i] = table[place]


@dataclass(frozen=True, eq=False)
class Edges:
    """All edges of a mesh; half-edge h = 3 f + k runs from corner k of face f to its next corner.

    Attributes:
        corners: (M, 3) welded vertices of each face.
        order: (H,) half-edges, those of the same edge side by side.
        start: (E,) where each edge begins in `order`.
        count: (E,) half-edges of each edge.
        forward: (H,) bool in `order`: runs from the lower vertex to the higher.
    """

    corners: Index
    order: Index
    start: Index
    count: Index
    forward: NDArray[np.bool_]

    def ends(self, edge: Index) -> Index:
        """Vertices (n, 2) at the ends of edges, in the direction of their first face."""
        half = self.order[self.start[edge]]
        face, k = half // 3, half % 3
        return np.stack([self.corners[face, k], self.corners[face, (k + 1) % 3]], axis=1)

    def count_by_face(self) -> Index:
        """How many faces (M, 3) share each side of each face, itself included; 0 for faces without edges."""
        counts = np.zeros(self.corners.size, np.int64)
        counts[self.order] = np.repeat(self.count, self.count)
        return counts.reshape(-1, 3)

    @property
    def closed(self) -> bool:
        """Whether every edge has just two faces."""
        return bool(len(self.count) and (self.count == 2).all())

    def pairs(self) -> tuple[Index, NDArray[np.bool_]]:
        """Faces on both sides (n, 2) of each edge with just two, and whether (n,) they are wound alike."""
        at = self.start[self.count == 2]
        faces = np.stack([self.order[at] // 3, self.order[at + 1] // 3], axis=1)
        return faces, self.forward[at] != self.forward[at + 1]


def edges_of(faces: NDArray[np.integer], welded: Index, chosen: NDArray[np.bool_] | None = None) -> Edges:
    """Edges between the chosen faces (M,) bool, or all.

    Faces that lose a side by welding, having two corners at one place, have no edges.
    """
    corners = np.take(welded, faces)
    a, b, c = corners.T
    whole = (a != b) & (b != c) & (c != a)
    if chosen is not None:
        whole &= chosen
    order = np.empty(3 * np.count_nonzero(whole), np.int64)
    first, forward = np.empty((2, len(order)), np.bool_)
    places = np.zeros((2, len(welded) + 1), np.int64)
    _sort_half_edges(corners.ravel(), whole, places, np.empty(len(order), np.int32), order, first, forward)
    start = np.flatnonzero(first)
    return Edges(corners, order, start, np.diff(start, append=len(order)), forward)


@native
def _sort_half_edges(
    corners: Index,
    whole: NDArray[np.bool_],
    places: Index,
    by_high: NDArray[np.int32],
    order: Index,
    first: NDArray[np.bool_],
    forward: NDArray[np.bool_],
) -> None:
    """Half-edges of whole faces in the `order` of their lower, then their higher vertex, counting (zeroed `places`).

    Both sorts, to the higher vertex and then to the lower, keep the order of equals. Left of the half-edges in order:
    whether each is the `first` of its edge, and whether it runs `forward`.
    """
    for half in range(corners.size):
        if whole[half // 3]:
            low, high = _ends(corners, half)
            places[0, low + 1] += 1
            places[1, high + 1] += 1
    for vertex in range(places.shape[1] - 1):
        places[0, vertex + 1] += places[0, vertex]
        places[1, vertex + 1] += places[1, vertex]
    for half in range(corners.size):
        if whole[half // 3]:
            high = _ends(corners, half)[1]
            by_high[places[1, high]] = half
            places[1, high] += 1
    for half in by_high:
        low = _ends(corners, half)[0]
        order[places[0, low]] = half
        places[0, low] += 1
    before = (-1, -1)
    for i in range(len(order)):
        ends = _ends(corners, order[i])
        first[i] = ends != before
        forward[i] = ends[0] == corners[order[i]]
        before = ends


@native
def _ends(corners: Index, half: int) -> tuple[int, int]:
    """The lower and the higher vertex of a half-edge."""
    a, b = corners[half], corners[half + 1 if half % 3 < 2 else half - 2]
    return min(a, b), max(a, b)


def connected(pairs: Index, count: int) -> Index:
    """Label (count,) of the connected set that each face is in, over pairs (n, 2) of faces."""
    graph = scipy.sparse.coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], np.int64)


@dataclass(frozen=True, eq=False)
class Winding:
    """How the faces would have to be turned for all neighbours to be wound alike.

    Attributes:
        turned: (M,) bool, faces wound against the larger part (by area) of their shell.
        shell: (M,) label of the connected set of faces.
        one_sided: (M,) bool, faces of shells that have no two sides, as a Möbius strip: nothing helps there.
    """

    turned: NDArray[np.bool_]
    shell: Index
    one_sided: NDArray[np.bool_]


def winding_of(edges: Edges, area: NDArray[np.float64]) -> Winding:
    """Judge the winding over edges with two faces, each face weighted by its area (M,)."""
    count = len(edges.corners)
    pairs, alike = edges.pairs()
    if alike.all():
        nothing = np.zeros(count, np.bool_)
        return Winding(nothing, connected(pairs, count), nothing)
    # Every face stands twice, as it is and turned; what must go together is connected.
    near, far = pairs.T
    other = np.where(alike, far, far + count)
    turned_other = np.where(alike, far + count, far)
    links = np.stack([np.concatenate([near, near + count]), np.concatenate([other, turned_other])], axis=1)
    side = connected(links, 2 * count)
    shell = np.unique(np.minimum(side[:count], side[count:]), return_inverse=True)[1]
    one_sided = side[:count] == side[count:]
    # Of the two ways to wind a shell, the one that leaves more area as it is.
    as_is = np.bincount(side[:count], area, minlength=2 * count)
    turned = (as_is[side[:count]] < as_is[side[count:]]) & ~one_sided
    tie = (as_is[side[:count]] == as_is[side[count:]]) & (side[:count] > side[count:]) & ~one_sided
    return Winding(turned | tie, shell, one_sided)


def unit(vectors: ArrayLike) -> NDArray[np.float64]:
    """Vectors (n, 3) of length 1; zero stays zero."""
    vectors = np.asarray(vectors, np.float64)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


def normals_of(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normal of triangles (M, 3, 3) → (M, 3), by their winding; zero where one has no area."""
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    return unit(np.cross(b - a, c - a))


def area_of(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area of triangles (M, 3, 3) → (M,) [m²]."""
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def volume_of(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> float:
    """Volume that closed faces (M, 3) enclose [m³]; negative where they are wound inward."""
    total, origin = 0.0, vertices_m[faces[0, 0]]  # of the mesh itself: far from it digits are lost
    for first in range(0, len(faces), _CHUNK):
        a, b, c = (vertices_m[column] - origin for column in faces[first : first + _CHUNK].T)
        total += float(np.vdot(a, np.cross(b, c)))
    return total / 6.0
