"""Which faces meet at which edge, vectorised: a mesh of a million faces takes a second.

Vertices at exactly the same place count as one, so a soup of unconnected triangles has the neighbours that
the eye sees. -0.0 and 0.0 are the same place.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Index = NDArray[np.int64]


def weld(vertices_m: NDArray[np.float64]) -> Index:
    """For every vertex (N,) the lowest index of a vertex at exactly its place."""
    return first_of(np.ascontiguousarray(vertices_m + 0.0).view(np.uint64))  # + 0.0 turns -0.0 into 0.0


def first_of(rows: NDArray[np.uint64]) -> Index:
    """For every row (n, 3) the index (n,) of the first row that equals it."""
    mixed = _mix(rows)  # sorting one number is several times as fast as sorting three
    order = np.argsort(mixed, kind="stable")
    same = _like_the_one_before(rows[order])
    if not np.array_equal(same, np.diff(mixed[order]) == 0):  # two rows, one number: sort in full
        order = np.lexsort(rows.T)
        same = _like_the_one_before(rows[order])
    start = np.flatnonzero(np.concatenate([[True], ~same]))
    first = np.empty(len(rows), np.int64)
    # Both sorts keep the order of equals, so the first of a run is the lowest.
    first[order] = np.repeat(order[start], np.diff(start, append=len(rows)))
    return first


def _like_the_one_before(rows: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Whether each row (n, 3) but the first equals the one before, (n - 1,): column by column, which is fastest."""
    return np.asarray(np.logical_and.reduce([column[1:] == column[:-1] for column in rows.T]))


def _mix(rows: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One number (n,) for each row (n, 3), most likely another for another row."""
    with np.errstate(over="ignore"):
        mixed = rows[:, 0] * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= (mixed >> np.uint64(29)) + rows[:, 1] * np.uint64(0xBF58476D1CE4E5B9)
        mixed ^= (mixed >> np.uint64(31)) + rows[:, 2] * np.uint64(0x94D049BB133111EB)
        return mixed ^ (mixed >> np.uint64(32))


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
    corners = welded[faces]
    after = corners[:, (1, 2, 0)]
    whole = (corners != after).all(axis=1)
    if chosen is not None:
        whole &= chosen
    half = np.flatnonzero(np.repeat(whole, 3))
    a, b = corners.ravel()[half], after.ravel()[half]
    key = np.minimum(a, b) * np.int64(len(welded)) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    key = key[order]
    start = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]])) if len(key) else np.zeros(0, np.int64)
    count = np.diff(np.concatenate([start, [len(key)]]))
    return Edges(corners, half[order], start, count, (a < b)[order])


def connected(pairs: Index, count: int) -> Index:
    """Label (count,) of the connected set that each face is in, over pairs (n, 2) of faces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


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


def winding_is_mixed(edges: Edges) -> bool:
    """Whether any edge with two faces has them wound against each other: the quick question."""
    _, alike = edges.pairs()
    return not bool(alike.all())


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


def volume_of(triangles_m: NDArray[np.float64]) -> float:
    """Volume that closed triangles (M, 3, 3) enclose [m³]; negative where they are wound inward."""
    a, b, c = np.moveaxis(triangles_m - triangles_m.mean(axis=(0, 1)), 1, 0)  # far from the origin digits are lost
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
