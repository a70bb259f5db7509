"""Paint that is finer than faces: faces are bisected until their parts follow the border of a region.

Each cut goes from a corner to the midpoint of the longest side, so parts of a sliver soon have balanced proportions.
The uncut parts are the *subfaces*. Each has one paint: a swatch, or a blend of two swatches. The mesh itself, and thus
the contact geometry, does not change.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Region

if TYPE_CHECKING:
    from hapscene.scene.body import Body

__all__ = [
    "LEVEL_MAX",
    "NOTHING",
    "SUBFACE_MAX",
    "FinePaint",
    "Painting",
    "blend",
    "paint_faces",
    "paint_region",
    "parts",
    "set_subfaces",
    "swatches_of",
]

LEVEL_MAX: Final = 32
"""Maximum depth of subdivision [count]: it divides 1 m² to sides of 22 µm."""

SUBFACE_MAX: Final = 4_000_000
"""Maximum number of subfaces of a scene [count], 25 bytes each: about 20 m of border at 0.1 mm."""

FINEST_M: Final = 1e-4
"""Default resolution of a border: the longest side of its subfaces [m]. A finger resolves borders that are about ten
times as far apart."""

FINEST_OF_DIAGONAL: Final = 1 / 4096
"""Default resolution on large bodies, relative to the diagonal of the body [1]."""

SOFT_STEP: Final = 1 / 16
"""Longest side of the subfaces in a border with falloff, relative to its width [1]. The weight changes by about 4 %
from one subface to the next. If one swatch is twice as stiff as the other, so does the stiffness, which is a fifth of
the just noticeable difference (`perception.COMPLIANCE`)."""

WEIGHT_STEPS: Final = 256
"""Number of steps of the weight of a blend [count]."""

Array = NDArray[np.float64]
Sight = Callable[[NDArray[np.float64], NDArray[np.uint8]], tuple[NDArray[np.bool_], NDArray[np.bool_]]]
"""Visibility test: of triangles (n, 3, 3) [m] and their levels (n,), whether the centre is visible, and whether they
are only partly visible."""

_SWATCH_BITS: Final = 16
_ROUNDING: Final = 1e-9  # relative to the diagonal: a region that ends in the plane of a face includes the face


def blend(a: ArrayLike, b: ArrayLike, weight: ArrayLike) -> NDArray[np.int64]:
    """Return the paint of swatch `a` blended with swatch `b` by `weight` [0, 1].

    A paint is an integer: the heavier swatch, the lighter swatch and its weight. The paint of one swatch is its index.
    """
    first, second = np.asarray(a, np.int64), np.asarray(b, np.int64)
    n = np.where(first == second, 0, np.rint(WEIGHT_STEPS * np.asarray(weight, np.float64)).astype(np.int64))
    swapped = (2 * n > WEIGHT_STEPS) | ((2 * n == WEIGHT_STEPS) & (second < first))
    n = np.where(swapped, WEIGHT_STEPS - n, n)
    lighter = np.where(n > 0, np.where(swapped, first, second), 0)
    return np.asarray(np.where(swapped, second, first) | lighter << _SWATCH_BITS | n << 2 * _SWATCH_BITS)


def parts(paint: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Split paints into heavier swatch, lighter swatch and the weight of the latter [0, ½]; 0 for a single swatch."""
    value, mask = np.asarray(paint, np.int64), (1 << _SWATCH_BITS) - 1
    return value & mask, value >> _SWATCH_BITS & mask, (value >> 2 * _SWATCH_BITS) / WEIGHT_STEPS


def paint_over(paint: NDArray[np.int64], swatch: int, weight: NDArray[np.float64]) -> NDArray[np.int64]:
    """Paint a swatch over paints: its weight is raised to `weight` where it is lower.

    The other swatches keep their proportions. A blend has two swatches; if there are three, the lightest is dropped.
    """
    a, b, lighter = parts(paint)
    present = (a == swatch) | ((b == swatch) & (lighter > 0))
    has = np.where(present, np.where(a == swatch, 1 - lighter, lighter), 0)
    new = np.maximum(has, weight)
    heaviest = (1 - lighter) * (1 - new)
    third = blend(a, swatch, new / (new + heaviest))
    third = np.where(lighter * (1 - new) <= new, third, paint)
    return np.where(new == has, paint, np.where(present, blend(np.where(a == swatch, b, a), swatch, new), third))


@dataclass(frozen=True, eq=False)
class FinePaint:
    """The k subfaces of a body, sorted by face and path. Immutable.

    The subfaces of a face cover it without gaps. Two halves with the same paint are merged, so a face with one swatch
    has no subfaces; its swatch is in `Body.face_swatch`.

    Attributes:
        face: index of the face (k,) int32.
        path: the half that each cut took, one bit per cut from the highest bit down (k,) uint32: 0 for the half that
            keeps the corner after the one where the cut starts, 1 for the other.
        edge: the side that each cut bisects, given by the opposite corner, two bits per cut from the highest bits down
            (k,) uint64.
        level: number of cuts (k,) uint8; the area is 2 to the power of −level of the area of the face.
        paint: see `blend` (k,) int64.
    """

    face: NDArray[np.int32]
    path: NDArray[np.uint32]
    edge: NDArray[np.uint64]
    level: NDArray[np.uint8]
    paint: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.face)

    def __repr__(self) -> str:
        return f"<FinePaint: {len(self):,} subfaces of {len(self.faces):,} faces>"

    def __getitem__(self, chosen: NDArray[np.integer | np.bool_] | slice) -> "FinePaint":
        """Select subfaces by index, mask or slice."""
        face, path, edge = self.face[chosen], self.path[chosen], self.edge[chosen]
        return FinePaint(face, path, edge, self.level[chosen], self.paint[chosen])

    @property
    def columns(self) -> tuple[NDArray[np.generic], ...]:
        """The five arrays in the order of the attributes."""
        return self.face, self.path, self.edge, self.level, self.paint

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return sum(values.nbytes for values in self.columns)

    @property
    def faces(self) -> NDArray[np.int32]:
        """Indices of the subdivided faces, ascending."""
        return self.face[np.concatenate([[True], self.face[1:] != self.face[:-1]])] if len(self) else self.face

    def of_faces(self, faces: ArrayLike) -> "FinePaint":
        """Return the subfaces of faces (m,), ascending."""
        return self[self._rows(np.asarray(faces, np.int32))]

    def with_faces(self, faces: ArrayLike, subfaces: "FinePaint") -> "FinePaint":
        """Return a copy in which the subfaces of faces (m,), ascending, are replaced by `subfaces`."""
        gone = self._rows(np.asarray(faces, np.int32))
        kept = FinePaint(*(np.delete(values, gone) for values in self.columns))
        at = np.searchsorted(kept.face, subfaces.face)
        pairs = zip(kept.columns, subfaces.columns, strict=True)
        return FinePaint(*(np.insert(values, at, new) for values, new in pairs))

    def at(self, face: int, bary: ArrayLike) -> int | None:
        """Return the paint at barycentric coordinates (3,) of a face; None if the face is not subdivided."""
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
        """Return barycentric coordinates of the corners of each subface (k, 3, 3), in the winding of its face."""
        found = np.tile(np.eye(3), (len(self), 1, 1))
        for level in range(int(self.level.max(initial=0))):
            row = np.flatnonzero(self.level > level)
            edge = (self.edge[row] >> np.uint64(2 * (LEVEL_MAX - 1 - level)) & np.uint64(3)).astype(np.intp)
            half = (self.path[row] >> np.uint32(LEVEL_MAX - 1 - level) & np.uint32(1)).astype(np.intp)
            found[row, (edge + 2 - half) % 3] = _middle(found[row], edge)
        return found

    def corners_m(self, mesh: Mesh) -> NDArray[np.float64]:
        """Return the corners of each subface in the body frame (k, 3, 3) [m], in the winding of the face."""
        return np.asarray(self.corners() @ np.take(mesh.vertices_m, mesh.faces[self.face], axis=0))

    def main_swatch(self) -> NDArray[np.int16]:
        """Return the swatch with the largest weighted area for each of `faces`; of equal ones the lowest index."""
        a, b, weight = parts(self.paint)
        number = np.cumsum(np.concatenate([[False], self.face[1:] != self.face[:-1]]))[: len(self)]
        key = np.concatenate([number << _SWATCH_BITS | a, number << _SWATCH_BITS | b])
        used, which = np.unique(key, return_inverse=True)
        share = np.bincount(which, np.concatenate([(1 - weight) * self._share(), weight * self._share()]))
        order = np.lexsort((-used, share, used >> _SWATCH_BITS))
        last = order[np.flatnonzero(np.diff(used[order] >> _SWATCH_BITS, append=-1))]
        return (used[last] & ((1 << _SWATCH_BITS) - 1)).astype(np.int16)

    def joined(self) -> "FinePaint":
        """Return a copy in which halves with equal paint are merged, and faces with a single swatch are undivided."""
        subfaces = self
        for level in range(int(self.level.max(initial=0)), 0, -1):
            bit = np.uint32(1 << (LEVEL_MAX - level))
            first = np.flatnonzero((subfaces.level[:-1] == level) & (subfaces.level[1:] == level))
            same = (subfaces.path[first] | bit) == subfaces.path[first + 1]
            same &= ((subfaces.path[first] & bit) == 0) & (subfaces.paint[first] == subfaces.paint[first + 1])
            first = first[same & (subfaces.face[first] == subfaces.face[first + 1])]
            if len(first):
                kept, edge = subfaces.level.copy(), subfaces.edge.copy()
                kept[first] -= 1
                edge[first] &= ~np.uint64(3 << 2 * (LEVEL_MAX - level))
                subfaces = FinePaint(subfaces.face, subfaces.path, edge, kept, subfaces.paint)
                subfaces = subfaces[np.delete(np.arange(len(subfaces)), first + 1)]
        return subfaces[(subfaces.level > 0) | (subfaces.paint >> 2 * _SWATCH_BITS > 0)]

    def is_consistent(self) -> bool:
        """Check that the subfaces of a face agree on its cuts; it is assumed that they cover the face."""
        level, last = self.level.astype(np.int64), 2 * (LEVEL_MAX - self.level.astype(np.int64))
        low, high = np.uint64(0x5555555555555555), np.uint64(0xAAAAAAAAAAAAAAAA)
        if (self.edge & high & (self.edge & low) << np.uint64(1)).any():  # sides are 0, 1, 2
            return False
        if (self.edge & ((np.uint64(1) << np.minimum(last, 63).astype(np.uint64)) - np.uint64(1)))[level > 0].any():
            return False
        shared = LEVEL_MAX - np.frexp((self.path[1:] ^ self.path[:-1]).astype(np.float64))[1]  # number of common cuts
        differ = (self.edge[1:] ^ self.edge[:-1]) >> (2 * (LEVEL_MAX - 1 - shared)).astype(np.uint64)
        return not (differ[self.face[1:] == self.face[:-1]].any() or self.edge[level == 0].any())

    def _share(self) -> NDArray[np.float64]:
        return np.asarray(0.5 ** self.level.astype(np.float64))

    def _rows(self, faces: NDArray[np.int32]) -> NDArray[np.intp]:
        start, stop = np.searchsorted(self.face, faces), np.searchsorted(self.face, faces, side="right")
        count = stop - start
        return np.asarray(np.repeat(start - np.cumsum(count) + count, count) + np.arange(count.sum()))


def whole_faces(faces: ArrayLike, paint: ArrayLike) -> FinePaint:
    """Return undivided faces (m,) with paint (m,) as one subface each."""
    count = np.size(faces)
    undivided = np.zeros(count, np.uint32), np.zeros(count, np.uint64), np.zeros(count, np.uint8)
    return FinePaint(np.array(faces, np.int32), *undivided, np.array(paint, np.int64))


Painting = tuple[NDArray[np.int16], FinePaint | None]
"""Paint of a body: `Body.face_swatch` and `Body.fine`."""

NOTHING: Final = whole_faces([], [])
"""No subfaces."""


def finest_of(mesh: Mesh) -> float:
    """Return the default resolution of paint on a mesh [m]."""
    return max(FINEST_M, mesh.diagonal_m * FINEST_OF_DIAGONAL)


def swatches_of(body: "Body") -> NDArray[np.int64]:
    """Return the indices of all swatches on a body, ascending."""
    a, b, weight = parts((body.fine or NOTHING).paint)
    return np.unique(np.concatenate([np.flatnonzero(np.bincount(body.face_swatch)), a, b[weight > 0]]))


def set_subfaces(body: "Body", subfaces: FinePaint) -> None:
    """Set the paint of faces to sorted subfaces, which must cover each of these faces."""
    faces = subfaces.faces
    body.face_swatch[faces] = subfaces.main_swatch()
    fine = (body.fine or NOTHING).with_faces(faces, subfaces.joined())
    body.fine = fine if len(fine) else None


def paint_faces(body: "Body", faces: NDArray[np.generic], swatch: int) -> None:
    """Paint whole faces, given by indices or a mask, with one swatch."""
    body.face_swatch[faces] = swatch
    if body.fine is not None:
        index = np.flatnonzero(faces) if faces.dtype == np.bool_ else np.unique(faces)
        fine = body.fine.with_faces(index, NOTHING)
        body.fine = fine if len(fine) else None


def paint_region(
    body: "Body",
    region: Region,
    swatch: int,
    *,
    resolution_m: float | None = None,
    falloff_m: float = 0.0,
    opacity: float = 1.0,
    faces: NDArray[np.generic] | None = None,
    sight: Sight | None = None,
) -> NDArray[np.int64]:
    """Paint a region on a body and subdivide the faces along its border.

    Args:
        body: modified in place.
        region: region in the body frame.
        swatch: index into the swatches of the scene.
        resolution_m: longest side of the subfaces along the border [m]; infinity selects whole faces by their
            centroids. Default: `finest_of`.
        falloff_m: width over which the weight of the swatch rises from 0 to 1, centred on the border [m]. A face within
            the transition, such as one in a side of a box, gets half the weight: extend the region beyond the surface.
        opacity: weight of the swatch inside the region [0, 1].
        faces: indices or mask of the faces that may be painted. Default: all.
        sight: visibility test; invisible parts are not painted. Default: everything is visible.

    Returns:
        Indices of the painted faces, ascending.

    Raises:
        SceneError: a number is out of range, or the border needs more than `SUBFACE_MAX` subfaces.
    """
    mesh = body.mesh
    resolution_m = finest_of(mesh) if resolution_m is None else resolution_m
    _check_numbers(resolution_m, falloff_m, opacity)
    painter = _Painter(region, max(resolution_m, falloff_m * SOFT_STEP), falloff_m, _ROUNDING * mesh.diagonal_m, sight)
    chosen = painter.faces_near(mesh, faces)
    had = body.fine or NOTHING
    fine = had.of_faces(chosen)
    plain = np.setdiff1d(chosen, fine.faces, assume_unique=True)
    front = fine.with_faces(plain, whole_faces(plain, body.face_swatch[plain]))
    where_m = front.corners_m(mesh)
    done: list[FinePaint] = []
    reached: list[NDArray[np.int32]] = []
    count = len(had) - len(fine)
    while len(front):
        weight, cut = painter.look(where_m, front.level)
        paint = paint_over(front.paint, swatch, opacity * weight)
        done.append(replace(front, paint=paint)[~cut])
        reached.append(np.unique(front.face[~cut & (opacity * weight > 0)]))
        count += len(done[-1])
        front, where_m = halves(front[cut], where_m[cut])
        if count + len(front) > SUBFACE_MAX:
            raise SceneError(
                f"body {body.name!r}: the border needs more than {SUBFACE_MAX:,} subfaces: increase resolution_m, "
                f"which is {resolution_m:.2g} m, or paint a smaller region"
            )
    hit = np.unique(np.concatenate([*reached, np.zeros(0, np.int32)]))
    subfaces = _sorted(done)
    set_subfaces(body, subfaces[np.isin(subfaces.face, hit)])
    return hit.astype(np.int64)


def _sorted(pieces: list[FinePaint]) -> FinePaint:
    """Join subfaces, sorted by face and path."""
    columns = zip(*(piece.columns for piece in (NOTHING, *pieces)), strict=True)
    subfaces = FinePaint(*(np.concatenate(values) for values in columns))
    return subfaces[np.argsort(subfaces.face.astype(np.int64) << LEVEL_MAX | subfaces.path)]


def _check_numbers(resolution_m: float, falloff_m: float, opacity: float) -> None:
    try:
        is_valid = resolution_m > 0 and 0 <= falloff_m < math.inf and 0 <= opacity <= 1
    except (TypeError, ValueError):  # text or an array
        is_valid = False
    if not is_valid:
        raise SceneError(
            "expected resolution_m above 0, falloff_m 0 or more, and opacity from 0 to 1, got "
            f"{resolution_m!r}, {falloff_m!r} and {opacity!r}"
        )


@dataclass(frozen=True)
class _Painter:
    """Decides for each part of a face whether it must be cut, and its weight."""

    region: Region
    longest_m: float
    falloff_m: float
    rounding_m: float
    sight: Sight | None

    def faces_near(self, mesh: Mesh, faces: NDArray[np.generic] | None) -> NDArray[np.int64]:
        """Return the indices of those of the `faces` that may reach into the region, ascending."""
        chosen = np.arange(len(mesh.faces)) if faces is None else np.asarray(faces)
        chosen = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else np.unique(chosen)
        corners = np.take(mesh.vertices_m, mesh.faces[chosen], axis=0)
        centre = corners.mean(axis=1)
        reach_m = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
        near = self.region.distance_m(centre) < reach_m + self.falloff_m / 2 + self.rounding_m
        return np.asarray(chosen[near], np.int64)

    def look(self, where_m: Array, level: NDArray[np.uint8]) -> tuple[Array, NDArray[np.bool_]]:
        """Return the weight at the centre of triangles (n, 3, 3), and whether they must be cut."""
        half_m = self.falloff_m / 2
        centre = where_m.mean(axis=1)
        reach_m = np.linalg.norm(where_m - centre[:, None], axis=2).max(axis=1)
        distance_m = self.region.distance_m(centre) - self.rounding_m
        if self.falloff_m > 0:
            weight = np.clip(0.5 - distance_m / self.falloff_m, 0, 1)
        else:
            weight = (distance_m <= 0).astype(np.float64)
        may = np.linalg.norm(where_m - np.roll(where_m, 1, axis=1), axis=2).max(axis=1) > self.longest_m
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


def halves(subfaces: FinePaint, where_m: NDArray[np.float64]) -> tuple[FinePaint, NDArray[np.float64]]:
    """Bisect each triangle at the midpoint of its longest side; return the halves and their corners (2 n, 3, 3) [m]."""
    opposite_m = where_m[:, [1, 2, 0]] - where_m[:, [2, 0, 1]]
    edge = np.argmax(np.einsum("nij,nij->ni", opposite_m, opposite_m), axis=1)
    middle = _middle(where_m, edge)
    shift = (LEVEL_MAX - 1 - subfaces.level).astype(np.uint64)
    halved, corners = [], []
    for half in range(2):
        found = where_m.copy()
        found[np.arange(len(found)), (edge + 2 - half) % 3] = middle
        corners.append(found)
        halved.append((
            subfaces.face,
            subfaces.path | (np.uint64(half) << shift).astype(np.uint32),
            subfaces.edge | edge.astype(np.uint64) << np.uint64(2) * shift,
            subfaces.level + np.uint8(1),
            subfaces.paint,
        ))  # fmt: skip
    return FinePaint(*(np.concatenate(pair) for pair in zip(*halved, strict=True))), np.concatenate(corners)


def _middle(corners: NDArray[np.float64], edge: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the midpoints (n, d) of the sides of triangles (n, 3, d) that are opposite to a corner (n,)."""
    row = np.arange(len(corners))
    return np.asarray((corners[row, (edge + 1) % 3] + corners[row, (edge + 2) % 3]) / 2)
