"""Display of a painted scene for any viewer: reduced meshes in chunks, one mesh for each swatch of a chunk."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.contact.embree import Search, first_face, new_ray
from hapscene.errors import ViewError
from hapscene.native import native
from hapscene.paint.model.history import leaf_marks
from hapscene.paint.model.mesh import PaintableMesh
from hapscene.paint.model.painting import Changes, Painting, forget_unworn
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import LEVEL_MAX, NOTHING, FinePaint, blend, parts
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import area_of, unit
from hapscene.view.body_triangles import shade_of

__all__ = ["CHUNK", "COLOURS", "LEAVES_MAX", "ChunkKey", "Display", "FileLook", "ShownBody", "reduce_mesh", "shares"]

COLOURS: Final = 16
"""Most colours that a file's own are brought down to [count]: each is drawn as a mesh of its own."""


@dataclass(frozen=True, eq=False)
class FileLook:
    """A file's colours.

    Attributes:
        rgb: (k, 3) the few, 0 to 1.
        shade: (k,) what each makes of a swatch's colour, as a factor.
        tint: (M,) uint8, which of them each face has.
    """

    rgb: NDArray[np.float64]
    shade: NDArray[np.float64]
    tint: NDArray[np.uint8]

    @staticmethod
    def of(mesh: Mesh) -> "FileLook | None":
        """That of a mesh; None where its file has no colours."""
        if mesh.colour_rgb is None:
            return None
        from PIL import Image

        picture = Image.fromarray(np.ascontiguousarray(mesh.colour_rgb[None]))
        few = picture.quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
        tint = np.asarray(few)[0].astype(np.uint8)
        count = np.bincount(tint)
        sums = [np.bincount(tint, mesh.colour_rgb[:, k]) / np.maximum(count, 1) for k in range(3)]
        rgb = np.stack(sums, axis=1)
        return FileLook(rgb / 255, shade_of(rgb, mesh.colour_rgb), tint)


PATCHES: Final = 64
"""About how many patches the large faces of a body are cut into [count]: a stroke changes a few, and each is sent in
some milliseconds."""

PATCH_BITS: Final = 8
"""Most cuts from a face to a patch of it [count]."""

LARGE: Final = 1 << 32
"""Patches of large faces are numbered from here; of small ones below 0; chunks of whole faces lie between."""

LEAVES_MAX: Final = 2_000
"""Most leaves of a patch that are shown [count]: where it has more, the smallest are shown as the first of them is."""

OVERLAP: Final = 1e-4
"""How far leaves reach over their borders, in diagonals of the body [1]: a twentieth of a pixel, as finely as triangles
are placed; so there are no hairline cracks between a leaf and the smaller ones beside it."""


class ShownLeaves:
    """The leaves of a body.

    A patch is a piece of a large face, or the leaves of all small faces of one group. It is known by a number.

    Args:
        body: whose they are.
        area_m2: (M,) of its faces [m²].
        group: (M,) of neighbours that each face is in, from 0.
    """

    def __init__(self, body: Body, area_m2: NDArray[np.float64], group: NDArray[np.int32]) -> None:
        self._body, self._group = body, group
        share = PATCHES * area_m2 / max(float(area_m2.sum()), 1e-300)
        self._bits = np.clip(np.ceil(np.log2(np.maximum(share, 1e-9))), 0, PATCH_BITS).astype(np.int64)
        self._shown = NOTHING
        self.has = np.zeros(len(group), np.bool_)

    def update(self, faces: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.integer]]:
        """Look again at faces (n,): the patches that became others, and the faces that won or lost their leaves."""
        fine = self._body.fine or NOTHING
        if fine is self._shown:
            return np.zeros(0, np.int64), faces[:0]
        faces = np.unique(faces)
        old, new = self._shown.of_faces(faces), fine.of_faces(faces)
        self._shown = fine
        one, other = leaf_marks(old), leaf_marks(new)
        changed = [self._patch(old[~np.isin(one, other)]), self._patch(new[~np.isin(other, one)])]
        before = self.has[faces]
        self.has[faces] = False
        self.has[new.faces] = True
        return np.unique(np.concatenate(changed)), faces[before != self.has[faces]]

    def patches(self) -> NDArray[np.int64]:
        """Those that there are."""
        return np.unique(self._patch(self._shown))

    def leaves(self, patch: int) -> FinePaint:
        """The leaves of a patch, no more than are shown."""
        if patch >= LARGE:
            leaves = self._shown.of_faces([(patch - LARGE) >> PATCH_BITS])
        else:
            leaves = self._shown.of_faces(np.flatnonzero(self.has & (self._group == -1 - patch)))
        leaves = leaves[self._patch(leaves) == patch]
        while len(leaves) > LEAVES_MAX and leaves.level.any():
            leaves = _coarser(leaves)
        return leaves

    def _patch(self, leaves: FinePaint) -> NDArray[np.int64]:
        """The patch (k,) of each leaf."""
        bits = self._bits[leaves.face]
        piece = leaves.path.astype(np.int64) >> (LEVEL_MAX - bits)
        large = LARGE + (leaves.face.astype(np.int64) << PATCH_BITS | piece)
        return np.where(bits > 0, large, -1 - self._group[leaves.face].astype(np.int64))


def leaf_triangles(leaves: FinePaint, corner_m: NDArray[np.floating], overlap_m: float) -> NDArray[np.float32]:
    """Corners (k, 3, 3) [m] of leaves, of faces with corners (k, 3, 3) [m], a little larger than they are."""
    corners = leaves.corners() @ corner_m
    out = corners - corners.mean(axis=1, keepdims=True)
    length = np.linalg.norm(out, axis=2, keepdims=True)
    return np.asarray(corners + out * (overlap_m / np.maximum(length, overlap_m)), np.float32)


def _coarser(leaves: FinePaint) -> FinePaint:
    """Without the last cut: of its pieces the first stands for all."""
    level = int(leaves.level.max()) - 1
    piece = leaves.path & np.uint32((2**level - 1) << (LEVEL_MAX - level))
    key = leaves.face.astype(np.uint64) << np.uint64(32) | np.where(leaves.level > level, piece, leaves.path)
    kept = np.concatenate([[True], key[1:] != key[:-1]])
    return replace(leaves, level=np.minimum(leaves.level, level).astype(np.uint8))[kept]


SHOWN_MAX: Final = 60_000
"""Most triangles shown of a whole scene [count]."""

SLACK: Final = 2.5
"""How many times too many, or too few, triangles a body may go on with when others come or go [1]: to reduce a large
mesh anew takes seconds."""

CHUNK: Final = 3_000
"""Most triangles of a chunk [count]: some 60 kB to send, and twenty chunks of the largest scene. Over them are drawn as
many of the full mesh at most; where a painting is more chequered, the shown faces must do."""

BACK_SHARE: Final = 0.01
"""From how far behind its point a ray starts, in its length [1]: where both surfaces are one, it must meet it."""

NORMAL_EDGES: Final = 2.0
"""How far apart two faces of one place count when one looks to the side of the other, in edges of the shown mesh [1]:
enough for the two sides of a wall thinner than an edge not to be taken for each other."""

NEAR: Final = 0.02
"""How far from the mesh what is shown of it is looked for, in its diagonals [1]: it is never reduced by as much."""

RAISED: Final = 3e-4
"""How far the full mesh is raised over the shown one, in its diagonals [1]: seen from afar, the picture's depth cannot
tell less apart, and as much is a quarter of a pixel."""

SLIVER_SINE: Final = 0.045
"""Sine of the angle, 2.6°, under which fast-simplification keeps a triangle as it is [1]: where half of what may be
shown are such slivers, it tries for long and gets nowhere."""

GRID_MAX: Final = 4096
"""Most cells along the longest side of a mesh whose vertices are clustered [count]: finer than a screen."""

FIRST: Final = 4
"""How many times too many faces are left by clusters of vertices, before the better way takes its turn [1]."""

SOME: Final = 50_000
"""Faces that are looked at to know the others [count]."""

EXCESS: Final = 1.2
"""How many times too many faces may be left [1], before the other way is taken."""

Places = NDArray[np.float64]
Faces = NDArray[np.int32]


class ChunkKey(NamedTuple):
    """A chunk: index of its body, and its number there."""

    body: int
    chunk: int


@dataclass(frozen=True, eq=False)
class Layer:
    """The part of a chunk that wears one paint, in the body's frame B.

    Attributes:
        paint: a swatch, or a blend of two: see `hapscene.scene.fine_paint.parts`.
        tint: which of the file's own colours it has: see `FileLook`; 0 where the file has none.
        vertices_m: (v, 3) float32 [m], those in use.
        faces: (f, 3) uint32.
        shown: (s,) int64, which shown faces of the body the first of them are.
        over: (f − s,) int64, which faces of the full mesh, whole or in leaves, the others are.
    """

    paint: int
    tint: int
    vertices_m: NDArray[np.float32]
    faces: NDArray[np.uint32]
    shown: NDArray[np.int64]
    over: NDArray[np.int64]

    @property
    def swatch(self) -> int:
        """Index in the scene; of a blend, the heavier one's."""
        return int(parts(self.paint)[0])


@dataclass(frozen=True, eq=False)
class ReducedMesh:
    """What is shown of a mesh, in the body's frame B.

    Attributes:
        vertices_m: (V, 3) float32 [m].
        faces: (S, 3) int32.
        shown_of: (M,) int32, the one shown face that stands for each face of the mesh.
        lent: (k, 2) int32, shown faces that stand for none, and the face of the mesh whose colour each wears.
        under: (N,) int32, the shown face under or over each vertex of the mesh; −1 where there is none.
        raised_m: (N, 3) float32, these vertices lifted off what is shown [m]; None where that is the mesh itself.
    """

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    shown_of: NDArray[np.int32]
    lent: NDArray[np.int32]
    under: NDArray[np.int32]
    raised_m: NDArray[np.float32] | None


class Display:
    """What of a painted scene is shown.

    Args:
        painting: the scene.
        shown_max: most triangles of all bodies together.

    Attributes:
        bodies: as they are shown, in the scene's order.

    Raises:
        ViewError: a mesh must be reduced, and the package that does it is missing.
    """

    def __init__(self, painting: Painting, shown_max: int = SHOWN_MAX) -> None:
        self._painting, self._shown_max = painting, shown_max
        self._made: dict[int, tuple[PaintableMesh, ReducedMesh]] = {}  # by id of the mesh
        self._known: dict[int, tuple[Body, ReducedMesh, ShownBody]] = {}  # by id of the body
        self.bodies: list[ShownBody] = []
        self.compose()

    def prepare(self, meshes: Sequence[Mesh]) -> None:
        """Reduce meshes that bodies will come with, in any thread: it takes seconds for a large one."""
        known = [len(body.mesh.faces) for body in self._painting.scene.bodies]
        counts = shares([*known, *(len(mesh.faces) for mesh in meshes)], self._shown_max)[len(known) :]
        for mesh, count in zip(meshes, counts, strict=True):
            if id(mesh) not in self._made:
                shape = self._painting.shape_of(mesh)
                self._made[id(mesh)] = shape, reduce_mesh(shape, count)

    def compose(self) -> list[ChunkKey]:
        """Show the bodies that the scene has now; of those that are kept, the chunks that are to be drawn anew."""
        painting, bodies = self._painting, self._painting.scene.bodies
        counts = shares([len(body.mesh.faces) for body in bodies], self._shown_max)
        known, self._known = self._known, {}
        changed: list[ChunkKey] = []
        with painting.lock:
            for i, (body, shape, count) in enumerate(zip(bodies, painting.shapes, counts, strict=True)):
                mesh = self._made.get(id(body.mesh), (shape, None))[1]
                few = count / SLACK, min(count * SLACK, len(body.mesh.faces))
                if mesh is None or not few[0] <= len(mesh.faces) <= few[1]:
                    mesh = reduce_mesh(shape, count)
                    self._made[id(body.mesh)] = shape, mesh
                old = known.get(id(body))
                if old is not None and old[1] is mesh:
                    shown = old[2]
                    changed += [ChunkKey(i, int(c)) for c in shown.update(np.arange(len(body.face_swatch)))]
                else:
                    shown = ShownBody(shape, mesh, body)
                self._known[id(body)] = body, mesh, shown
        forget_unworn(self._made, bodies)
        self.bodies = [self._known[id(body)][2] for body in bodies]
        return changed

    def chunks(self) -> list[ChunkKey]:
        """All chunks."""
        return [ChunkKey(b, c) for b, body in enumerate(self.bodies) for c in body.chunks()]

    def layers(self, key: ChunkKey) -> list[Layer]:
        """The meshes that a chunk is drawn as, one for each paint and tint in it."""
        return self.bodies[key.body].layers(key.chunk)

    def update(self, changes: Changes) -> list[ChunkKey]:
        """Take note of what changed; the chunks to be drawn anew.

        A swatch whose colour changed alone changes no chunk: it is the view that gives layers their colours.
        """
        return [
            ChunkKey(body, int(c)) for body, faces in changes.faces.items() for c in self.bodies[body].update(faces)
        ]


class ShownBody:
    """A body as it is shown.

    Attributes:
        mesh: what is shown of its mesh.
        look: the colours of its file; None where it has none.
        swatch: (S,) int16 that each shown face wears.
        chunk: (S,) int32 that it is in.
        chunk_count: how many there are.
    """

    def __init__(self, shape: PaintableMesh, mesh: ReducedMesh, body: Body) -> None:
        self.mesh = mesh
        self._shape = shape
        self._face_swatch = body.face_swatch
        self._drawn = body.face_swatch.copy()
        # where none has an area, what is painted decides still
        self._area_m2 = np.maximum(area_of(shape.corner_m), np.finfo(np.float64).tiny)
        self._full = np.argsort(mesh.shown_of, kind="stable")
        count = np.bincount(mesh.shown_of, minlength=len(mesh.faces))
        self._start = np.concatenate([[0], np.cumsum(count)])
        middle_m = mesh.vertices_m[mesh.faces].mean(axis=1)
        self.chunk = _chunk_of(middle_m)
        self.chunk_count = int(self.chunk.max()) + 1
        self.swatch = np.zeros(len(mesh.faces), np.int16)
        self._assign_swatches(np.arange(len(mesh.faces)))
        self.look = FileLook.of(body.mesh)
        self._tint = np.zeros(len(self._drawn), np.uint8) if self.look is None else self.look.tint
        self._shown_tint = self._tint if mesh.raised_m is None else self._tint[self._first_full()]
        group = _chunk_of(middle_m, len(mesh.faces) // PATCHES + 1)[mesh.shown_of]
        self._leaves = ShownLeaves(body, self._area_m2, group)
        self._leaves.update(np.arange(len(self._drawn)))
        self._over = self._drawn_whole()

    def chunks(self) -> list[int]:
        """Numbers of the chunks, and of the patches of leaves."""
        return [*range(self.chunk_count), *self._leaves.patches().tolist()]

    def update(self, faces: NDArray[np.integer]) -> NDArray[np.int64]:
        """Look again at faces (n,) of the full mesh; the chunks that became others."""
        patches, turned = self._leaves.update(faces)
        faces = faces[self._drawn[faces] != self._face_swatch[faces]]
        if not len(faces) and not len(turned):
            return patches
        self._drawn[faces] = self._face_swatch[faces]
        lent = self.mesh.lent
        borrowers = lent[np.isin(lent[:, 1], faces), 0]
        shown = np.unique(np.concatenate([self.mesh.shown_of[faces], borrowers]))
        before, over = self.swatch[shown], self._over
        self._assign_swatches(shown)
        self._over = self._drawn_whole()
        other = np.concatenate([np.flatnonzero(over != self._over), faces[self._over[faces]]])
        if self.mesh.raised_m is None:
            other = turned
        changed = np.concatenate([shown[before != self.swatch[shown]], self.mesh.shown_of[other]])
        return np.unique(np.concatenate([patches, self.chunk[changed]])).astype(np.int64)

    def layers(self, chunk: int) -> list[Layer]:
        """The meshes that a chunk is drawn as, one for each paint and tint in it."""
        if not 0 <= chunk < self.chunk_count:
            return self._leaf_layers(chunk)
        inside = np.flatnonzero(self.chunk == chunk)
        if self.mesh.raised_m is None:  # a face in leaves is drawn as these
            inside = inside[~self._leaves.has[inside]]
        over = np.flatnonzero(self._over)
        over = over[self.chunk[self.mesh.shown_of[over]] == chunk]
        over = over if len(over) <= CHUNK else over[:0]
        kind, kind_over = (
            _kind(self.swatch[inside], self._shown_tint[inside]),
            _kind(self._drawn[over], self._tint[over]),
        )
        found = []
        for one in np.unique(np.concatenate([kind, kind_over])):
            shown, fine = inside[kind == one], over[kind_over == one]
            vertices_m, faces = _used(self.mesh.vertices_m, self.mesh.faces[shown])
            if len(fine) and self.mesh.raised_m is not None:
                raised_m, raised = _used(self.mesh.raised_m, self._shape.mesh.faces[fine])
                faces = np.concatenate([faces, raised + len(vertices_m)])
                vertices_m = np.concatenate([vertices_m, raised_m])
            found.append(Layer(*_of_kind(one), vertices_m, faces.astype(np.uint32), shown, fine))
        return found

    def _leaf_layers(self, patch: int) -> list[Layer]:
        leaves, mesh = self._leaves.leaves(patch), self._shape.mesh
        vertices_m = mesh.vertices_m if self.mesh.raised_m is None else self.mesh.raised_m
        corner_m = leaf_triangles(leaves, vertices_m[mesh.faces[leaves.face]], OVERLAP * mesh.diagonal_m)
        kind, found = _kind(_fewer_weights(leaves.paint), self._tint[leaves.face]), []
        for one in np.unique(kind):
            mine = np.flatnonzero(kind == one)
            faces = np.arange(3 * len(mine), dtype=np.uint32).reshape(-1, 3)
            over = leaves.face[mine].astype(np.int64)
            found.append(Layer(*_of_kind(one), corner_m[mine].reshape(-1, 3), faces, mine[:0], over))
        return found

    def _first_full(self) -> NDArray[np.int64]:
        """A face of the full mesh for each shown one (S,), whose tint that has."""
        first = self._full[np.minimum(self._start[:-1], len(self._full) - 1)]
        first[self.mesh.lent[:, 0]] = self.mesh.lent[:, 1]
        return np.asarray(first)

    def _drawn_whole(self) -> NDArray[np.bool_]:
        """Whether each face (M,) of the full mesh is drawn itself: at a border, or where what is shown is wrong."""
        mesh, wrong = self.mesh, np.zeros(len(self._drawn), np.bool_)
        if mesh.raised_m is not None:
            args = self._face_swatch, self.swatch, mesh.shown_of, mesh.under, self._shape.mesh.faces, self._shape.pairs
            mark_wrong(*args, wrong, np.zeros_like(wrong))
            wrong &= ~self._leaves.has
        return wrong

    def _assign_swatches(self, shown: NDArray[np.integer]) -> None:
        """Give shown faces (n,) the swatch of most of the area that they stand for; the lower number where equal."""
        length = self._start[shown + 1] - self._start[shown]
        row = np.repeat(np.arange(len(shown)), length)
        within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        full = self._full[np.repeat(self._start[shown], length) + within]
        kinds, kind = np.unique(self._face_swatch[full], return_inverse=True)
        area = np.bincount(row * len(kinds) + kind, self._area_m2[full], minlength=len(shown) * len(kinds))
        if len(kinds):
            self.swatch[shown] = kinds[np.argmax(area.reshape(len(shown), -1), axis=1)]
        lent = self.mesh.lent
        mine = np.isin(lent[:, 0], shown)
        self.swatch[lent[mine, 0]] = self._face_swatch[lent[mine, 1]]


@native
def mark_wrong(
    swatch: Any, shown_swatch: Any, shown_of: Any, under: Any, faces: Any, pairs: Any, wrong: Any, beside: Any
) -> None:
    """Set `wrong` (M,) of faces that are not seen in their swatch (M,), or lie at a border.

    Args:
        swatch, shown_swatch: (M,), (S,) of the faces of the full mesh and of what is shown of it.
        shown_of, under: (M,), (N,) the shown face that stands for each face, and under each vertex.
        faces, pairs: (M, 3), (n, 2) of the full mesh, and which of them lie side by side.
        wrong, beside: (M,) bool, written; false before.
    """
    for i in range(len(faces)):
        wrong[i] = shown_swatch[shown_of[i]] != swatch[i]
        for k in range(3):
            shown = under[faces[i, k]]
            wrong[i] |= shown >= 0 and shown_swatch[shown] != swatch[i]
    for i in range(len(pairs)):  # tips of shown faces lie between corners
        one, other = pairs[i, 0], pairs[i, 1]
        if wrong[one] or wrong[other] or swatch[one] != swatch[other]:
            beside[one] = beside[other] = True
    for i in range(len(wrong)):
        wrong[i] |= beside[i]


WEIGHTS: Final = 8
"""Weights of a blend that are told apart by the eye [count]: each is a mesh of its own."""

_TINT_BITS: Final = 8


def _fewer_weights(paint: NDArray[np.int64]) -> NDArray[np.int64]:
    """Paints with their weights rounded to those that are told apart."""
    a, b, weight = parts(paint)
    return np.asarray(blend(a, np.where(weight > 0, b, a), np.rint(weight * WEIGHTS) / WEIGHTS))


def _kind(paint: NDArray[np.integer], tint: NDArray[np.integer]) -> NDArray[np.int64]:
    """One number for paint and tint (n,): what is drawn as one mesh."""
    return np.asarray(paint.astype(np.int64) << _TINT_BITS | tint)


def _of_kind(kind: int) -> tuple[int, int]:
    return int(kind) >> _TINT_BITS, int(kind) & ((1 << _TINT_BITS) - 1)


def shares(counts: list[int], most: int) -> list[int]:
    """How many triangles are shown of bodies of `counts` faces: `most` in all, and 1 at least of each.

    The small ones are shown whole, and those that are reduced alike.
    """
    found, left = list(counts), most
    order = sorted(range(len(counts)), key=counts.__getitem__)
    for k, body in enumerate(order):
        found[body] = min(counts[body], max(left // (len(order) - k), 1))
        left -= found[body]
    return found


def _used(vertices_m: NDArray[np.float32], faces: NDArray[np.int32]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Of vertices those that faces (n, 3) use, and the faces in these."""
    used, index = np.unique(faces, return_inverse=True)
    return vertices_m[used], index.reshape(-1, 3)


def _chunk_of(centroid_m: NDArray[np.floating], most: int = CHUNK) -> NDArray[np.int32]:
    """A chunk (S,) for each place (S, 3): halved across the longest side until none has more than `most`."""
    chunk = np.zeros(len(centroid_m), np.int32)
    waiting, count = [np.arange(len(centroid_m))], 0
    while waiting:
        inside = waiting.pop()
        if len(inside) <= most:
            chunk[inside] = count
            count += 1
            continue
        place = centroid_m[inside]
        axis = int(np.argmax(place.max(axis=0) - place.min(axis=0)))
        half = len(inside) // 2
        order = np.argpartition(place[:, axis], half)
        waiting += [inside[order[half:]], inside[order[:half]]]
    return chunk


# How a mesh is reduced, and where what is shown of it lies over the full one.


def reduce_mesh(shape: PaintableMesh, count: int) -> ReducedMesh:
    """A mesh with about `count` faces at most; itself, where it has no more.

    By quadric error metrics (Garland & Heckbert 1997, fast-simplification); by clusters of vertices (Rossignac & Borrel
    1993), where slivers keep those from it. A face of the mesh is stood for by the shown face over or under its
    centroid; where there is none, by the one nearest by centroid and normal.

    Raises:
        ViewError: the package that reduces is not there.
    """
    mesh = shape.mesh
    if len(mesh.faces) <= count:
        every, none = np.arange(len(mesh.faces), dtype=np.int32), np.zeros(0, np.int32)
        return ReducedMesh(mesh.vertices_m.astype(np.float32), mesh.faces, every, none.reshape(0, 2), none, None)
    corners = shape.welded[mesh.faces]
    worn = np.zeros(len(mesh.vertices_m), np.bool_)
    worn[corners] = True
    vertices_m, faces = mesh.vertices_m[worn], (np.cumsum(worn) - 1)[corners].astype(np.int32)
    found = None
    some = shape.corner_m[:: max(len(faces) // SOME, 1)]
    if np.count_nonzero(_smallest_sine(some) < SLIVER_SINE) * len(faces) / len(some) < count / 2:
        left = vertices_m, faces
        if len(faces) > 2 * FIRST * count:  # clusters are quicker by much, and as good as long as they are small
            span_m = float(np.ptp(vertices_m, axis=0).max())
            area_m2 = float(area_of(some).sum()) * len(faces) / len(some)
            look = _look(faces, shape.normal, len(vertices_m))
            left = _grouped(vertices_m, faces, look, span_m * math.sqrt(FIRST * count / (2 * area_m2)))
        found = _collapsed(*left, count)
    if found is None or len(found[1]) > EXCESS * count:
        found = _clustered(vertices_m, faces, shape.normal, count)
    return ReducedMesh(found[0].astype(np.float32), found[1], *_compared(shape, *found))


def _collapsed(vertices_m: Places, faces: Faces, count: int) -> tuple[Places, Faces]:
    try:
        from fast_simplification import simplify
    except ImportError:
        raise ViewError(
            f"a mesh of {len(faces):,} faces is too large to show whole, and what reduces it is missing: "
            "pip install 'hapscene[paint]'"
        ) from None
    centre_m = vertices_m.mean(axis=0)
    vertices, left = simplify(vertices_m - centre_m, faces, target_count=count)
    return np.asarray(vertices, np.float64) + centre_m, np.asarray(left, np.int32)


def _clustered(vertices_m: Places, faces: Faces, normal: NDArray[np.float64], count: int) -> tuple[Places, Faces]:
    """Vertices of one cell of a grid, looking the same way, become one in their middle; the finest such grid."""
    look = _look(faces, normal, len(vertices_m))
    coarse, fine = 1.0, float(GRID_MAX)  # cells along the longest side
    best = vertices_m, faces
    while fine / coarse > 1.05:
        cells = math.sqrt(coarse * fine)
        found = _grouped(vertices_m, faces, look, cells)
        if len(found[1]) <= count:
            coarse = cells
        else:
            fine = cells
        if len(found[1]) <= count or len(best[1]) > count:
            best = found
    return best


def _look(faces: Faces, normal: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Which of 27 ways the faces around each vertex (count,) look."""
    around = _around(faces, normal, count)
    way = np.rint(around / np.maximum(np.abs(around).max(axis=1, keepdims=True), 1e-300)).astype(np.int64) + 1
    return np.asarray(way @ np.array([9, 3, 1]))


def _grouped(vertices_m: Places, faces: Faces, look: NDArray[np.int64], cells: float) -> tuple[Places, Faces]:
    """Vertices of one cell of a grid that look the same way become one; so many cells along the longest side."""
    low_m, span_m = vertices_m.min(axis=0), float(np.ptp(vertices_m, axis=0).max())
    key = np.zeros(len(vertices_m), np.int64)
    for cell in ((vertices_m - low_m) / span_m * cells).astype(np.int64).T:
        key = key * (GRID_MAX + 1) + cell
    cluster = np.unique(key * 27 + look, return_inverse=True)[1]
    size = np.bincount(cluster)
    middle_m = np.stack([np.bincount(cluster, vertices_m[:, k]) / size for k in range(3)], axis=1)
    return middle_m, _once(cluster[faces]).astype(np.int32)


def _once(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces (M, 3) without those that have lost a side, each once."""
    whole = corners[(corners != corners[:, (1, 2, 0)]).all(axis=1)]
    row, low = np.arange(len(whole)), np.argmin(whole, axis=1)
    turned = np.stack([whole[row, (low + k) % 3] for k in range(3)], axis=1)  # the lowest first: wound as it was
    size = int(corners.max()) + 1
    key = (turned[:, 0] * size + turned[:, 1]) * size + turned[:, 2]
    return np.asarray(turned[np.unique(key, return_index=True)[1]])


def _smallest_sine(corner_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sine (M,) of the smallest angle of triangles (M, 3, 3); 0 for those without area."""
    side = np.sort(np.linalg.norm(corner_m - corner_m[:, (1, 2, 0)], axis=2), axis=1)
    product = side[:, 1] * side[:, 2]
    return np.asarray(np.divide(2 * area_of(corner_m), product, out=np.zeros(len(side)), where=product > 0))


def _around(faces: NDArray[np.integer], normal: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """The sum (count, 3) of the normals (M, 3) of the faces at each vertex."""
    corners = faces.ravel()
    return np.stack([np.bincount(corners, np.repeat(normal[:, k], 3), count) for k in range(3)], axis=1)


def _compared(
    shape: PaintableMesh, vertices_m: Places, faces: Faces
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """`ReducedMesh.shown_of`, `lent`, `under` and `raised_m` of a mesh and what is shown of it."""
    mesh = shape.mesh
    corner = vertices_m[faces]
    normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    look = Search(vertices_m, faces, 0.0)
    shown_of, over_face_m = _under(look, normal, shape.centroid_m, shape.normal, NEAR * mesh.diagonal_m)
    shown_of, lent = _stand_for(shape, corner, normal, shown_of)
    place = shape.welded
    up = unit(_around(place[mesh.faces], shape.normal, len(place)))[place]
    under, above_m = _under(look, normal, mesh.vertices_m, up, NEAR * mesh.diagonal_m)
    lift_m = np.maximum(above_m, 0.0)
    for corners in place[mesh.faces].T:
        np.maximum.at(lift_m, corners, over_face_m)
    lift_m = lift_m[place] + RAISED * mesh.diagonal_m
    return shown_of, lent, under, (mesh.vertices_m + lift_m[:, None] * up).astype(np.float32)


def _under(
    look: Search, shown_normal: NDArray[np.float64], points_m: Places, normals: NDArray[np.float64], far_m: float
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """The shown face (n,) over or under each point, −1 where there is none, and how high above it that is (n,) [m]."""
    face, above_m = np.zeros(len(points_m), np.int32), np.zeros(len(points_m))
    overlay_faces(look.handle, new_ray(), points_m - look.center_m, normals, shown_normal, far_m, face, above_m)
    return face, above_m


def _stand_for(
    shape: PaintableMesh, corner_m: NDArray[np.float64], normal: NDArray[np.float64], shown_of: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The shown face (M,) for every face, those of −1 found by centroid and normal; and for those idle, `lent`."""
    edge_m = float(np.median(np.linalg.norm(corner_m[:, 1] - corner_m[:, 0], axis=1)))
    scale_m = NORMAL_EDGES / 2 * edge_m  # normals that oppose are 2 apart
    shown = np.hstack([corner_m.mean(axis=1), scale_m * normal])
    full = np.hstack([shape.centroid_m, scale_m * shape.normal])
    lost = np.flatnonzero(shown_of < 0)
    if len(lost):
        shown_of[lost] = scipy.spatial.cKDTree(shown).query(full[lost], workers=-1)[1]
    idle = np.flatnonzero(np.bincount(shown_of, minlength=len(shown)) == 0)
    lender = scipy.spatial.cKDTree(full).query(shown[idle])[1] if len(idle) else idle
    return shown_of, np.stack([idle, lender], axis=1).astype(np.int32)


@native
def overlay_faces(
    search: int, ray: Any, points_m: Any, normals: Any, shown_normals: Any, far_m: float, faces: Any, above_m: Any
) -> None:
    """Write which shown face lies over or under each point, −1 where none does, and how high above the point.

    Args:
        search, ray: as `first_face` has them.
        points_m: (n, 3) in the centred frame of the search structure [m].
        normals: (n, 3) unit normals there; zero where none is known.
        shown_normals: (S, 3) of the shown faces; one that looks away from the point's normal is another surface.
        far_m: how far a ray goes to either side [m].
        faces, above_m: (n,), (n,), written [m].
    """
    back_m = BACK_SHARE * far_m
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        faces[i], above_m[i] = -1, 0.0
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        nearest_m = far_m
        for way in (1.0, -1.0):
            start = (x - way * back_m * nx, y - way * back_m * ny, z - way * back_m * nz)
            direction = (way * nx, way * ny, way * nz)
            face = first_face(search, ray, start, direction, far_m + back_m, 0)
            if face < 0:
                continue
            if nx * shown_normals[face, 0] + ny * shown_normals[face, 1] + nz * shown_normals[face, 2] <= 0.0:
                continue
            away_m = float(ray[8]) - back_m
            if abs(away_m) < nearest_m:
                nearest_m = abs(away_m)
                faces[i], above_m[i] = face, way * away_m
