"""Paint finer than faces: a face is cut in two, and its pieces again, as often as the border of its paint needs.

Each cut goes from a corner to the middle of the longest side, so the pieces of a sliver are soon as wide as they are
long. The pieces that are not cut again are the *leaves*; each has one paint: a swatch, or a blend of two. The mesh that
is touched stays as it is.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Volume

if TYPE_CHECKING:
    from hapscene.scene.body import Body

__all__ = [
    "LEAF_MAX",
    "LEVEL_MAX",
    "NOTHING",
    "FinePaint",
    "Painting",
    "blend",
    "finest_of",
    "halves",
    "paint_faces",
    "paint_region",
    "painted_over",
    "parts",
    "put_leaves",
    "swatches_of",
    "whole_faces",
]

LEVEL_MAX: Final = 32
"""Most cuts from a face to a leaf [count]: 1 m² down to sides of 22 µm."""

LEAF_MAX: Final = 4_000_000
"""Most leaves of a scene [count], 25 bytes each: some 20 m of border at 0.1 mm. More is refused, from files too."""

FINEST_M: Final = 1e-4
"""Longest side of the leaves along a border, unless told [m]: a finger tells borders some ten times as far apart."""

FINEST_OF_DIAGONAL: Final = 1 / 4096
"""And of the body's diagonal, where that is more [1]."""

SOFT_STEP: Final = 1 / 16
"""Longest side of the leaves of a soft border, of its width [1]: the weight goes by some 4 % from one to the next, and
so does the stiffness where one swatch is twice as stiff: a fifth of what is felt (`perception.COMPLIANCE`)."""

WEIGHT_STEPS: Final = 256
"""Weights of a blend are whole parts of this [count]."""

Sight = Callable[[NDArray[np.float64], NDArray[np.uint8]], tuple[NDArray[np.bool_], NDArray[np.bool_]]]
"""Tells of pieces of faces (n, 3, 3) [m], cut so often (n,), whether the middle is seen, and a part not alike."""

_SWATCH_BITS: Final = 16
_ROUNDING: Final = 1e-9  # of the diagonal: a region that ends in a face's plane has the face


def blend(a: ArrayLike, b: ArrayLike, weight: ArrayLike) -> NDArray[np.int64]:
    """Paint of swatch `a` with `weight` [0, 1] of swatch `b`, the heavier one first; of one swatch, its index."""
    first, second = np.asarray(a, np.int64), np.asarray(b, np.int64)
    n = np.where(first == second, 0, np.rint(WEIGHT_STEPS * np.asarray(weight, np.float64)).astype(np.int64))
    turned = (2 * n > WEIGHT_STEPS) | ((2 * n == WEIGHT_STEPS) & (second < first))
    n = np.where(turned, WEIGHT_STEPS - n, n)
    lighter = np.where(n > 0, np.where(turned, first, second), 0)
    return np.asarray(np.where(turned, second, first) | lighter << _SWATCH_BITS | n << 2 * _SWATCH_BITS)


def parts(paint: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Heavier swatch, lighter swatch and its weight [0, ½] of paints; where that is 0, there is no lighter one."""
    value, mask = np.asarray(paint, np.int64), (1 << _SWATCH_BITS) - 1
    return value & mask, value >> _SWATCH_BITS & mask, (value >> 2 * _SWATCH_BITS) / WEIGHT_STEPS


def painted_over(paint: NDArray[np.int64], swatch: int, weight: NDArray[np.float64]) -> NDArray[np.int64]:
    """Paints with a swatch put over them by weight: its weight becomes that, unless it is more already.

    The others share the rest as they did. A blend has two swatches: of three the smallest goes.
    """
    a, b, lighter = parts(paint)
    in_it = (a == swatch) | ((b == swatch) & (lighter > 0))
    has = np.where(in_it, np.where(a == swatch, 1 - lighter, lighter), 0)
    new = np.maximum(has, weight)
    heaviest = (1 - lighter) * (1 - new)
    third = blend(a, swatch, new / (new + heaviest))
    third = np.where(lighter * (1 - new) <= new, third, paint)
    return np.where(new == has, paint, np.where(in_it, blend(np.where(a == swatch, b, a), swatch, new), third))


@dataclass(frozen=True, eq=False)
class FinePaint:
    """Leaves of the faces of one body that are painted finer; k of them, sorted by face, then path. Not to be changed.

    The leaves of a face cover it. Two halves of one piece that have the same paint are one leaf again, so a face of one
    swatch has none here: `Body.face_swatch` says it.

    Attributes:
        face: (k,) int32.
        path: (k,) uint32, which half each cut took, a bit for each from the highest down: 0 the half that keeps
            the corner after the one that is cut from, 1 the other.
        edge: (k,) uint64, which side each cut halved, two bits from the highest down: the corner opposite to it.
        level: (k,) uint8, how often it was cut: its area is 2 to the minus level of its face's.
        paint: (k,) int64, see `parts`.
    """

    face: NDArray[np.int32]
    path: NDArray[np.uint32]
    edge: NDArray[np.uint64]
    level: NDArray[np.uint8]
    paint: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.face)

    def __repr__(self) -> str:
        return f"<FinePaint: {len(self):,} leaves of {len(self.faces):,} faces>"

    def __getitem__(self, chosen: Any) -> "FinePaint":
        """The leaves of an index, mask or slice."""
        return FinePaint(*(values[chosen] for values in self.columns))

    @property
    def columns(self) -> tuple[NDArray[Any], ...]:
        """The five arrays, in order."""
        return self.face, self.path, self.edge, self.level, self.paint

    @property
    def nbytes(self) -> int:
        """Memory that the leaves take [bytes]."""
        return sum(values.nbytes for values in self.columns)

    @property
    def faces(self) -> NDArray[np.int32]:
        """Faces that have leaves, ascending."""
        return self.face[np.concatenate([[True], self.face[1:] != self.face[:-1]])] if len(self) else self.face

    def of_faces(self, faces: ArrayLike) -> "FinePaint":
        """The leaves of some faces (m,), ascending."""
        return self[self._rows(np.asarray(faces, np.int32))]

    def with_faces(self, faces: ArrayLike, leaves: "FinePaint") -> "FinePaint":
        """The leaves with those of some faces (m,), ascending, replaced; a face that gets none is painted whole."""
        gone = self._rows(np.asarray(faces, np.int32))
        kept = FinePaint(*(np.delete(values, gone) for values in self.columns))
        at = np.searchsorted(kept.face, leaves.face)
        pairs = zip(kept.columns, leaves.columns, strict=True)
        return FinePaint(*(np.insert(values, at, new) for values, new in pairs))

    def at(self, face: int, bary: ArrayLike) -> int | None:
        """The paint at a point of a face, by its barycentric coordinates (3,); None where the face has no leaves."""
        low, high = (int(i) for i in np.searchsorted(self.face, np.array([face, face + 1], np.int32)))
        b = [float(x) for x in np.asarray(bary)]
        level = 0
        while high - low > 1:
            edge = int(self.edge[low]) >> 2 * (LEVEL_MAX - 1 - level) & 3
            i, j = (edge + 1) % 3, (edge + 2) % 3
            bit = self.path[low:high] >> np.uint32(LEVEL_MAX - 1 - level) & np.uint32(1)
            half = low + int(np.searchsorted(bit, 1))
            if b[i] >= b[j]:
                b[i], b[j], high = b[i] - b[j], 2 * b[j], half
            else:
                b[i], b[j], low = 2 * b[i], b[j] - b[i], half
            level += 1
        return int(self.paint[low]) if high > low else None

    def corners(self) -> NDArray[np.float64]:
        """Barycentric coordinates (k, 3, 3) in its face of each leaf's corners, in the face's winding."""
        found = np.tile(np.eye(3), (len(self), 1, 1))
        for level in range(int(self.level.max(initial=0))):
            row = np.flatnonzero(self.level > level)
            edge = (self.edge[row] >> np.uint64(2 * (LEVEL_MAX - 1 - level)) & np.uint64(3)).astype(np.intp)
            half = (self.path[row] >> np.uint32(LEVEL_MAX - 1 - level) & np.uint32(1)).astype(np.intp)
            found[row, (edge + 2 - half) % 3] = _middle(found[row], edge)
        return found

    def leaf_corners_m(self, mesh: Mesh) -> NDArray[np.float64]:
        """Corners (k, 3, 3) [m] of each leaf in the body's frame, in the face's winding: to draw, or to write, them."""
        return np.asarray(self.corners() @ np.take(mesh.vertices_m, mesh.faces[self.face], axis=0))

    def leaf_areas_m2(self, mesh: Mesh) -> NDArray[np.float64]:
        """Areas (k,) [m²] of the leaves."""
        a, b, c = np.moveaxis(np.take(mesh.vertices_m, mesh.faces[self.face], axis=0), 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2 * self._share())

    def most(self) -> NDArray[np.int16]:
        """The swatch of most of its area, by weight, for each of `faces`; the first of several."""
        a, b, weight = parts(self.paint)
        number = np.cumsum(np.concatenate([[False], self.face[1:] != self.face[:-1]]))[: len(self)]
        key = np.concatenate([number << _SWATCH_BITS | a, number << _SWATCH_BITS | b])
        used, which = np.unique(key, return_inverse=True)
        share = np.bincount(which, np.concatenate([(1 - weight) * self._share(), weight * self._share()]))
        order = np.lexsort((-used, share, used >> _SWATCH_BITS))
        last = order[np.flatnonzero(np.diff(used[order] >> _SWATCH_BITS, append=-1))]
        return (used[last] & ((1 << _SWATCH_BITS) - 1)).astype(np.int16)

    def joined(self) -> "FinePaint":
        """The leaves with halves of one paint joined, and no face that is one leaf of one swatch."""
        leaves = self
        for level in range(int(self.level.max(initial=0)), 0, -1):
            bit = np.uint32(1 << (LEVEL_MAX - level))
            first = np.flatnonzero((leaves.level[:-1] == level) & (leaves.level[1:] == level))
            same = (leaves.path[first] | bit) == leaves.path[first + 1]
            same &= ((leaves.path[first] & bit) == 0) & (leaves.paint[first] == leaves.paint[first + 1])
            first = first[same & (leaves.face[first] == leaves.face[first + 1])]
            if len(first):
                kept, edge = leaves.level.copy(), leaves.edge.copy()
                kept[first] -= 1
                edge[first] &= ~np.uint64(3 << 2 * (LEVEL_MAX - level))
                leaves = FinePaint(leaves.face, leaves.path, edge, kept, leaves.paint)
                leaves = leaves[np.delete(np.arange(len(leaves)), first + 1)]
        return leaves[(leaves.level > 0) | (leaves.paint >> 2 * _SWATCH_BITS > 0)]

    def is_sound(self) -> bool:
        """Whether leaves that cover their faces also agree how each piece of a face is cut."""
        level, last = self.level.astype(np.int64), 2 * (LEVEL_MAX - self.level.astype(np.int64))
        low, high = np.uint64(0x5555555555555555), np.uint64(0xAAAAAAAAAAAAAAAA)
        if (self.edge & high & (self.edge & low) << np.uint64(1)).any():  # 3 is no side
            return False
        if (self.edge & ((np.uint64(1) << np.minimum(last, 63).astype(np.uint64)) - np.uint64(1)))[level > 0].any():
            return False
        shared = LEVEL_MAX - np.frexp((self.path[1:] ^ self.path[:-1]).astype(np.float64))[1]  # cuts, until they part
        differ = (self.edge[1:] ^ self.edge[:-1]) >> (2 * (LEVEL_MAX - 1 - shared)).astype(np.uint64)
        return not (differ[self.face[1:] == self.face[:-1]].any() or self.edge[level == 0].any())

    def _share(self) -> NDArray[np.float64]:
        return np.asarray(0.5 ** self.level.astype(np.float64))

    def _rows(self, faces: NDArray[np.int32]) -> NDArray[np.intp]:
        start, stop = np.searchsorted(self.face, faces), np.searchsorted(self.face, faces, side="right")
        count = stop - start
        return np.asarray(np.repeat(start - np.cumsum(count) + count, count) + np.arange(count.sum()))


def whole_faces(faces: ArrayLike, paint: ArrayLike) -> FinePaint:
    """One leaf for each of some faces (m,), with its paint (m,)."""
    count = np.size(faces)
    none = np.zeros(count, np.uint32), np.zeros(count, np.uint64), np.zeros(count, np.uint8)
    return FinePaint(np.array(faces, np.int32), *none, np.array(paint, np.int64))


Painting = tuple[NDArray[np.int16], FinePaint | None]
"""How a body is painted: `Body.face_swatch` and `Body.fine`."""

NOTHING: Final = whole_faces([], [])
"""No leaves, of any body."""


def finest_of(mesh: Mesh) -> float:
    """How fine paint on a mesh is where nothing else is said [m]."""
    return max(FINEST_M, mesh.diagonal_m * FINEST_OF_DIAGONAL)


def swatches_of(body: "Body") -> NDArray[np.int64]:
    """Indices of the swatches that a body is painted with anywhere, ascending."""
    a, b, weight = parts((body.fine or NOTHING).paint)
    return np.unique(np.concatenate([np.flatnonzero(np.bincount(body.face_swatch)), a, b[weight > 0]]))


def put_leaves(body: "Body", leaves: FinePaint) -> None:
    """Paint faces as sorted leaves say, which cover each that they are of."""
    faces = leaves.faces
    body.face_swatch[faces] = leaves.most()
    fine = (body.fine or NOTHING).with_faces(faces, leaves.joined())
    body.fine = fine if len(fine) else None


def paint_faces(body: "Body", faces: NDArray[Any], swatch: int) -> None:
    """Paint whole faces, by index or mask, with a swatch of the scene."""
    body.face_swatch[faces] = swatch
    if body.fine is not None:
        index = np.flatnonzero(faces) if faces.dtype == np.bool_ else np.unique(faces)
        fine = body.fine.with_faces(index, NOTHING)
        body.fine = fine if len(fine) else None


def paint_region(
    body: "Body",
    region: Volume,
    swatch: int,
    *,
    finest_m: float | None = None,
    soft_m: float = 0.0,
    opacity: float = 1.0,
    faces: NDArray[Any] | None = None,
    over: int | None = None,
    sight: Sight | None = None,
) -> NDArray[np.int64]:
    """Paint a region of space onto a body, through its faces; returns those that it reaches, ascending.

    Args:
        body: painted in place.
        region: in the body's frame.
        swatch: index into the scene's swatches.
        finest_m: longest side of the leaves along the border [m]; infinity paints whole faces, by their centroids.
            None: `FINEST_M`, or `FINEST_OF_DIAGONAL` where that is more.
        soft_m: width over which the border goes from none of the swatch to all, half on either side [m]. A face that
            lies in the border itself, as where a box ends at the surface, has half: let the region reach beyond it.
        opacity: the swatch's weight where it is all [0, 1].
        faces: the only ones that are painted, by index or mask; None: all.
        over: the only swatch that is painted over; of a blend, the heavier counts. None: any.
        sight: what is seen; nothing else is painted. None: all is.

    Raises:
        SceneError: a number is out of range, or the border would need more than `LEAF_MAX` leaves.
    """
    mesh = body.mesh
    finest_m = finest_of(mesh) if finest_m is None else finest_m
    try:
        is_sound = finest_m > 0 and 0 <= soft_m < math.inf and 0 <= opacity <= 1
    except (TypeError, ValueError):  # a text, or many numbers
        is_sound = False
    if not is_sound:
        raise SceneError(
            f"finest_m must be positive, soft_m 0 or more, opacity within 0 and 1; they are {finest_m!r}, {soft_m!r} "
            f"and {opacity!r}"
        )
    chosen = np.arange(len(mesh.faces)) if faces is None else np.asarray(faces)
    chosen = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else np.unique(chosen)
    corners = np.take(mesh.vertices_m, mesh.faces[chosen], axis=0)
    centre = corners.mean(axis=1)
    reach_m = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    chosen = chosen[region.distance_m(centre) < reach_m + soft_m / 2 + _ROUNDING * mesh.diagonal_m]
    painter = _Painter(region, max(finest_m, soft_m * SOFT_STEP), soft_m, _ROUNDING * mesh.diagonal_m, sight)
    had = body.fine or NOTHING
    fine = had.of_faces(chosen)
    plain = np.setdiff1d(chosen, fine.faces, assume_unique=True)
    pieces = [fine, whole_faces(plain, body.face_swatch[plain])]
    front = FinePaint(*(np.concatenate(values) for values in zip(*(piece.columns for piece in pieces), strict=True)))
    where_m = front.leaf_corners_m(mesh)
    done: list[FinePaint] = []
    reached: list[NDArray[np.int32]] = []
    count = len(had) - len(fine)
    while len(front):
        weight, cut = painter.look(where_m, front.level)
        if over is not None:
            stays = parts(front.paint)[0] != over
            weight[stays], cut[stays] = 0.0, False
        paint = painted_over(front.paint, swatch, opacity * weight)
        done.append(replace(front, paint=paint)[~cut])
        reached.append(np.unique(front.face[~cut & (opacity * weight > 0)]))
        count += len(done[-1])
        front, where_m = halves(front[cut], where_m[cut])
        if count + len(front) > LEAF_MAX:
            raise SceneError(
                f"body {body.name!r}: a border this fine needs more than {LEAF_MAX:,} pieces; a finest_m above "
                f"{finest_m:.2g} m, or a smaller region, needs fewer"
            )
    hit = np.unique(np.concatenate([*reached, np.zeros(0, np.int32)]))
    columns = [np.concatenate(values) for values in zip(*(leaves.columns for leaves in (NOTHING, *done)), strict=True)]
    leaves = FinePaint(*columns)
    leaves = leaves[np.isin(leaves.face, hit)]
    put_leaves(body, leaves[np.argsort(leaves.face.astype(np.int64) << LEVEL_MAX | leaves.path)])
    return hit.astype(np.int64)


@dataclass(frozen=True)
class _Painter:
    """What decides of each piece whether the border goes through it."""

    region: Volume
    finest_m: float
    soft_m: float
    rounding_m: float
    sight: Sight | None

    def look(self, where_m: NDArray[np.float64], level: NDArray[np.uint8]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """The weight (n,) at the middle of pieces (n, 3, 3), and whether they must be cut."""
        half_m = self.soft_m / 2
        centre = where_m.mean(axis=1)
        reach_m = np.linalg.norm(where_m - centre[:, None], axis=2).max(axis=1)
        distance_m = self.region.distance_m(centre) - self.rounding_m
        if self.soft_m > 0:
            weight = np.clip(0.5 - distance_m / self.soft_m, 0, 1)
        else:
            weight = (distance_m <= 0).astype(np.float64)
        may = np.linalg.norm(where_m - np.roll(where_m, 1, axis=1), axis=2).max(axis=1) > self.finest_m
        may &= level < LEVEL_MAX
        cut = (np.abs(distance_m) < reach_m + half_m) & may
        if self.region.is_convex and cut.any():
            row = np.flatnonzero(cut)
            deep_m = self.region.distance_m(where_m[row].reshape(-1, 3)).reshape(-1, 3).max(axis=1)
            within = row[deep_m <= self.rounding_m - half_m]
            cut[within], weight[within] = False, 1.0
        if self.sight is not None:
            row = np.flatnonzero(~cut & (weight > 0))
            seen, partly = self.sight(where_m[row], level[row])
            weight[row[~seen]], cut[row] = 0.0, partly & may[row]
        return weight, cut


def halves(leaves: FinePaint, where_m: NDArray[np.float64]) -> tuple[FinePaint, NDArray[np.float64]]:
    """Both halves of each piece, cut at the middle of its longest side, and their corners [m]."""
    opposite_m = where_m[:, [1, 2, 0]] - where_m[:, [2, 0, 1]]
    edge = np.argmax(np.einsum("nij,nij->ni", opposite_m, opposite_m), axis=1)
    middle = _middle(where_m, edge)
    shift = (LEVEL_MAX - 1 - leaves.level).astype(np.uint64)
    halved, corners = [], []
    for half in range(2):
        found = where_m.copy()
        found[np.arange(len(found)), (edge + 2 - half) % 3] = middle
        corners.append(found)
        halved.append((
            leaves.face,
            leaves.path | (np.uint64(half) << shift).astype(np.uint32),
            leaves.edge | edge.astype(np.uint64) << np.uint64(2) * shift,
            leaves.level + np.uint8(1),
            leaves.paint,
        ))  # fmt: skip
    return FinePaint(*(np.concatenate(pair) for pair in zip(*halved, strict=True))), np.concatenate(corners)


def _middle(corners: NDArray[np.float64], edge: NDArray[np.intp]) -> NDArray[np.float64]:
    """Middle (n, d) of the sides of triangles (n, 3, d) opposite to a corner (n,)."""
    row = np.arange(len(corners))
    return np.asarray((corners[row, (edge + 1) % 3] + corners[row, (edge + 2) % 3]) / 2)
