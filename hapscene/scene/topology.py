"""Topology of triangle meshes: edges, adjacency, winding and connected parts.

Vertices at exactly the same position count as one, so the triangles of an STL file, which share no vertices, are
connected as they appear. −0.0 and 0.0 are the same position. A mesh with a million faces takes a third of a second.
"""

import secrets
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native

__all__ = [
    "Edges",
    "Index",
    "Neighbours",
    "Winding",
    "area_of",
    "connected",
    "edges_of",
    "first_of",
    "neighbours_of",
    "normals_of",
    "unit",
    "volume_of",
    "weld",
    "winding_of",
]

Index = NDArray[np.int64]

_CHUNK: Final = 1 << 16
"""Number of faces that are copied at once [count]."""

_SALT: Final = np.uint64(secrets.randbits(64) | 1)
"""Random multiplier of the hash, so that no file can be crafted to cause collisions. Results do not depend on it."""


def weld(vertices_m: NDArray[np.float64]) -> Index:
    """Return for every vertex the lowest index of a vertex at exactly the same position (N,)."""
    return first_of(np.ascontiguousarray(vertices_m + 0.0).view(np.uint64))  # + 0.0 turns -0.0 into 0.0


def first_of(rows: NDArray[np.uint64]) -> Index:
    """Return for every row (n, 3) the index of the first equal row (n,)."""
    first = np.empty(len(rows), np.int64)
    table = np.full(1 << (2 * len(rows)).bit_length(), -1, np.int32)  # at most half full
    _find_first(np.ascontiguousarray(rows), _mix(rows).view(np.int64), table, first)
    return first


def _mix(rows: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a hash (n,) of each row (n, 3)."""
    mixed = np.zeros(len(rows), np.uint64)
    for column in (*rows.T, np.uint64(0)):  # the extra round mixes all bits of the last column
        mixed = (mixed ^ column) * _SALT
        mixed ^= mixed >> np.uint64(32)
    return mixed


@native
def _find_first(rows: NDArray[np.uint64], mixed: Index, table: NDArray[np.int32], first: Index) -> None:
    """Enter each row in a hash table with open addressing, and set `first` to the index of the first equal row."""
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
    """All edges of a mesh. Half-edge h = 3 f + k runs from corner k of face f to the next corner.

    Attributes:
        corners: welded vertices of each face (M, 3).
        order: half-edges sorted by edge (H,).
        start: start of each edge in `order` (E,).
        count: number of half-edges of each edge (E,).
        forward: whether each half-edge in `order` runs from the lower to the higher vertex (H,).
    """

    corners: Index
    order: Index
    start: Index
    count: Index
    forward: NDArray[np.bool_]

    def ends(self, edge: Index) -> Index:
        """Return the end vertices (n, 2) of edges, in the direction of their first face."""
        half = self.order[self.start[edge]]
        face, k = half // 3, half % 3
        return np.stack([self.corners[face, k], self.corners[face, (k + 1) % 3]], axis=1)

    def count_by_face(self) -> Index:
        """Return the number of faces at each side of each face, itself included (M, 3); 0 for faces without edges."""
        counts = np.zeros(self.corners.size, np.int64)
        counts[self.order] = np.repeat(self.count, self.count)
        return counts.reshape(-1, 3)

    @property
    def closed(self) -> bool:
        """Whether every edge has exactly two faces."""
        return bool(len(self.count) and (self.count == 2).all())

    def pairs(self) -> tuple[Index, NDArray[np.bool_]]:
        """Return the two faces (n, 2) at each edge with exactly two, and whether their windings agree (n,)."""
        at = self.start[self.count == 2]
        faces = np.stack([self.order[at] // 3, self.order[at + 1] // 3], axis=1)
        return faces, self.forward[at] != self.forward[at + 1]


def edges_of(faces: NDArray[np.integer], welded: Index, chosen: NDArray[np.bool_] | None = None) -> Edges:
    """Compute the edges between the chosen faces (mask (M,)), or all faces.

    Degenerate faces, which have two corners at the same position, have no edges.
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
    """Sort the half-edges of whole faces by their lower, then their higher vertex, with a stable counting sort.

    `places` must be zero. It writes the sorted half-edges to `order`, whether each is the first of its edge to `first`,
    and whether it runs from the lower to the higher vertex to `forward`.
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
    """Return the lower and the higher vertex of a half-edge."""
    a, b = corners[half], corners[half + 1 if half % 3 < 2 else half - 2]
    return min(a, b), max(a, b)


class Neighbours(NamedTuple):
    """Adjacency of the M faces of a mesh."""

    # (M, 3) index of the face across edge k, which runs from corner k to corner k + 1; −1 if there is not exactly one
    beyond: NDArray[np.int32]
    mixed: bool  # whether two neighbours have opposite winding
    closed: bool  # whether every edge has exactly two faces


def neighbours_of(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> Neighbours:
    """Compute the adjacency of faces.

    The entry is −1 at borders, at edges with three or more faces, and between faces with opposite winding. Vertices at
    the same position count as one; faces that have two corners at the same position have no neighbours.
    """
    edges = edges_of(faces, weld(vertices_m))
    at = edges.start[edges.count == 2]
    agree = edges.forward[at] != edges.forward[at + 1]
    one, other = edges.order[at[agree]], edges.order[at[agree] + 1]
    beyond = np.full(3 * len(faces), -1, np.int32)
    beyond[one], beyond[other] = other // 3, one // 3
    return Neighbours(beyond.reshape(-1, 3), not agree.all(), edges.closed)


def connected(pairs: Index, count: int) -> Index:
    """Return a label for the connected component of each face (count,), given pairs (n, 2) of connected faces."""
    graph = scipy.sparse.coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], np.int64)


@dataclass(frozen=True, eq=False)
class Winding:
    """Faces that must be reversed to give all neighbours the same orientation.

    Attributes:
        turned: faces whose winding is opposite to that of the larger part (by area) of their shell (M,).
        shell: label of the connected component of each face (M,).
        one_sided: faces of shells that cannot be oriented, such as a Möbius strip (M,).
    """

    turned: NDArray[np.bool_]
    shell: Index
    one_sided: NDArray[np.bool_]


def winding_of(edges: Edges, area: NDArray[np.float64]) -> Winding:
    """Check the winding across edges with two faces; faces are weighted by area (M,)."""
    count = len(edges.corners)
    pairs, agree = edges.pairs()
    if agree.all():
        nothing = np.zeros(count, np.bool_)
        return Winding(nothing, connected(pairs, count), nothing)
    # Each face has two nodes, as it is and reversed; nodes that must have the same orientation are connected.
    near, far = pairs.T
    other = np.where(agree, far, far + count)
    turned_other = np.where(agree, far + count, far)
    links = np.stack([np.concatenate([near, near + count]), np.concatenate([other, turned_other])], axis=1)
    side = connected(links, 2 * count)
    shell = np.unique(np.minimum(side[:count], side[count:]), return_inverse=True)[1]
    one_sided = side[:count] == side[count:]
    # Of the two orientations of a shell, keep the one that reverses the smaller area.
    as_is = np.bincount(side[:count], area, minlength=2 * count)
    turned = (as_is[side[:count]] < as_is[side[count:]]) & ~one_sided
    tie = (as_is[side[:count]] == as_is[side[count:]]) & (side[:count] > side[count:]) & ~one_sided
    return Winding(turned | tie, shell, one_sided)


def unit(vectors: ArrayLike) -> NDArray[np.float64]:
    """Normalise vectors (n, 3); zero vectors stay zero."""
    vectors = np.asarray(vectors, np.float64)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


def normals_of(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normals (M, 3) of triangles (M, 3, 3) by their winding; zero for triangles without area."""
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    return unit(np.cross(b - a, c - a))


def area_of(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the areas (M,) of triangles (M, 3, 3) [m²]."""
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def volume_of(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> float:
    """Return the volume that closed faces (M, 3) enclose [m³]; negative if they are wound inward."""
    total, origin = 0.0, vertices_m[faces[0, 0]]  # a point of the mesh, to avoid cancellation
    for first in range(0, len(faces), _CHUNK):
        a, b, c = (vertices_m[column] - origin for column in faces[first : first + _CHUNK].T)
        total += float(np.vdot(a, np.cross(b, c)))
    return total / 6.0
