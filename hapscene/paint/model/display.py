"""Display meshes of a painted scene: reduced meshes, split into chunks, with one mesh for each swatch of a chunk.

Large meshes are reduced for the viewer. Along borders between swatches, where the reduced mesh is too coarse, faces of
the full mesh are drawn slightly above it. Faces that are painted finer than a face are subdivided; their pieces, called
subfaces here (the leaves of the subdivision tree of `hapscene.scene.fine_paint`), are drawn instead of the face.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.contact.embree import Search, first_face, new_ray
from hapscene.errors import ViewError
from hapscene.paint.model.history import subface_hashes
from hapscene.paint.model.mesh import PaintableMesh, Ray32, Row
from hapscene.paint.model.painting import Changes, Painting, drop_unused_meshes
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import LEVEL_MAX, NOTHING, FinePaint, blend, parts
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import area_of, unit

__all__ = [
    "CHUNK",
    "COLOURS",
    "SUBFACES_MAX",
    "ChunkKey",
    "Display",
    "FileColours",
    "ShownBody",
    "reduce_mesh",
    "triangle_shares",
]

COLOURS: Final = 16
"""Largest number of colours to which the colours of a mesh file are reduced [count]: each is drawn as one mesh."""


@dataclass(frozen=True, eq=False)
class FileColours:
    """Colours that a mesh file gives its faces, reduced to a palette.

    Attributes:
        rgb: (k, 3) palette, channels 0 to 1.
        tint: (M,) uint8 palette index of each face.
    """

    rgb: NDArray[np.float64]
    tint: NDArray[np.uint8]

    @staticmethod
    def of(mesh: Mesh) -> "FileColours | None":
        """Colours of a mesh; None if its file has no colours."""
        if mesh.colour_rgb is None:
            return None
        from PIL import Image

        picture = Image.fromarray(np.ascontiguousarray(mesh.colour_rgb[None]))
        few = picture.quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
        tint = np.asarray(few)[0].astype(np.uint8)
        count = np.bincount(tint)
        sums = [np.bincount(tint, mesh.colour_rgb[:, k]) / np.maximum(count, 1) for k in range(3)]
        rgb = np.stack(sums, axis=1)
        return FileColours(rgb / 255, tint)


PATCHES: Final = 64
"""Approximate number of patches for the large faces of a body [count]: a stroke changes a few, and sending one takes
some milliseconds."""

PATCH_BITS: Final = 8
"""Largest number of bisections from a face to one of its patches [count]."""

LARGE: Final = 1 << 32
"""First number of a patch of a large face. Patches of small faces are below 0; chunks are between."""

SUBFACES_MAX: Final = 2_000
"""Largest number of subfaces shown of one patch [count]; beyond, the smallest are merged."""

OVERLAP: Final = 1e-4
"""Enlargement of each subface, in diagonals of the body [1]: a twentieth of a pixel, which closes the hairline cracks
between subfaces of different size."""


class ShownSubfaces:
    """Subfaces of a body, grouped into patches that are sent to the viewer one by one.

    A patch is a part of a large face, or the subfaces of all small faces of one group. It is identified by a number.

    Args:
        body: the body.
        shape: its mesh.
        group: returns the group (M,) of neighbouring faces that each face belongs to, counted from 0.

    Attributes:
        has: (M,) bool, whether each face is subdivided.
    """

    def __init__(self, body: Body, shape: PaintableMesh, group: Callable[[], NDArray[np.int32]]) -> None:
        self._body, self._shape, self._group_of = body, shape, group
        self._shown = NOTHING
        self.has = np.zeros(len(shape.normal), np.bool_)

    @cached_property
    def _bits(self) -> NDArray[np.int64]:
        """Number of bisections (M,) from each face to its patches; 0 for a small face."""
        share = PATCHES * self._shape.area_m2 / max(float(self._shape.area_m2.sum()), 1e-300)
        return np.clip(np.ceil(np.log2(np.maximum(share, 1e-9))), 0, PATCH_BITS).astype(np.int64)

    @cached_property
    def _group(self) -> NDArray[np.int32]:
        return self._group_of()

    def prepare(self) -> None:
        """Compute in advance what the first update of a large mesh needs. Thread-safe."""
        _ = self._group, self._bits

    def update(self, faces: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.integer]]:
        """Update faces (n,); returns the changed patches, and the faces that are newly or no longer subdivided."""
        fine = self._body.fine or NOTHING
        if fine is self._shown:
            return np.zeros(0, np.int64), faces[:0]
        faces = np.unique(faces)
        old, new = self._shown.of_faces(faces), fine.of_faces(faces)
        self._shown = fine
        one, other = subface_hashes(old), subface_hashes(new)
        changed = [self._patch(old[~np.isin(one, other)]), self._patch(new[~np.isin(other, one)])]
        before = self.has[faces]
        self.has[faces] = False
        self.has[new.faces] = True
        return np.unique(np.concatenate(changed)), faces[before != self.has[faces]]

    def patches(self) -> NDArray[np.int64]:
        """Numbers of the patches that have subfaces."""
        return np.unique(self._patch(self._shown))

    def of_patch(self, patch: int) -> FinePaint:
        """Subfaces of a patch, merged until there are at most `SUBFACES_MAX`."""
        if patch >= LARGE:
            subfaces = self._shown.of_faces([(patch - LARGE) >> PATCH_BITS])
        else:
            subfaces = self._shown.of_faces(np.flatnonzero(self.has & (self._group == -1 - patch)))
        subfaces = subfaces[self._patch(subfaces) == patch]
        while len(subfaces) > SUBFACES_MAX and subfaces.level.any():
            subfaces = _merge_smallest(subfaces)
        return subfaces

    def _patch(self, subfaces: FinePaint) -> NDArray[np.int64]:
        """Patch (k,) of each subface."""
        if not len(subfaces):
            return np.zeros(0, np.int64)
        bits = self._bits[subfaces.face]
        piece = subfaces.path.astype(np.int64) >> (LEVEL_MAX - bits)
        large = LARGE + (subfaces.face.astype(np.int64) << PATCH_BITS | piece)
        return np.where(bits > 0, large, -1 - self._group[subfaces.face].astype(np.int64))


def subface_triangles(subfaces: FinePaint, corner_m: NDArray[np.floating], overlap_m: float) -> NDArray[np.float32]:
    """Corners (k, 3, 3) of subfaces [m], moved outwards by `overlap_m`; `corner_m` (k, 3, 3) is of their faces [m]."""
    corners = subfaces.corners() @ corner_m
    out = corners - corners.mean(axis=1, keepdims=True)
    length = np.linalg.norm(out, axis=2, keepdims=True)
    return np.asarray(corners + out * (overlap_m / np.maximum(length, overlap_m)), np.float32)


def _merge_smallest(subfaces: FinePaint) -> FinePaint:
    """Undo the last level of bisection: the first piece represents both."""
    level = int(subfaces.level.max()) - 1
    piece = subfaces.path & np.uint32((2**level - 1) << (LEVEL_MAX - level))
    key = subfaces.face.astype(np.uint64) << np.uint64(32) | np.where(subfaces.level > level, piece, subfaces.path)
    kept = np.concatenate([[True], key[1:] != key[:-1]])
    return replace(subfaces, level=np.minimum(subfaces.level, level).astype(np.uint8))[kept]


SHOWN_MAX: Final = 60_000
"""Largest number of triangles shown of a scene [count]."""

SLACK: Final = 2.5
"""Factor by which a body's triangle count may differ from its share before its mesh is reduced again [1]: reducing a
large mesh takes seconds."""

CHUNK: Final = 3_000
"""Largest number of triangles of a chunk [count]: about 60 kB to send, and twenty chunks for the largest scene. At most
as many faces of the full mesh are drawn over a chunk; with more borders, only the reduced mesh is shown."""

BACK_SHARE: Final = 0.01
"""Distance behind its point at which a ray starts, in ray lengths [1], so that it meets a surface at the point."""

NORMAL_EDGES: Final = 2.0
"""Distance assigned to perpendicular normals in the search for the nearest shown face, in edges of the shown mesh [1]:
keeps the two sides of a thin wall apart."""

NEAR: Final = 0.02
"""Largest distance at which the reduced mesh is searched, in diagonals [1]; reduction stays below it."""

RAISED: Final = 3e-4
"""Offset of full-mesh faces above the reduced mesh, in diagonals [1]: a quarter of a pixel, which the depth buffer can
still resolve from afar."""

SLIVER_SINE: Final = 0.045
"""Sine of the angle, 2.6°, below which fast-simplification does not collapse a triangle [1]. If slivers make up half of
the permitted triangles, it runs for long without result."""

GRID_MAX: Final = 4096
"""Largest number of grid cells along the longest side for vertex clustering [count]: finer than a screen."""

FIRST: Final = 4
"""Face count after clustering, relative to the target, when clustering is followed by edge collapse [1]."""

SOME: Final = 50_000
"""Number of faces sampled for statistics of a mesh [count]."""

EXCESS: Final = 1.2
"""Face count after edge collapse, relative to the target, above which clustering is used instead [1]."""

Places = NDArray[np.float64]
Faces = NDArray[np.int32]
Ints = NDArray[np.integer]
Mask = NDArray[np.bool_]


class ChunkKey(NamedTuple):
    """Identifies a chunk: index of the body, and number of the chunk or patch within the body."""

    body: int
    chunk: int


@dataclass(frozen=True, eq=False)
class Layer:
    """The part of a chunk with one paint and one file colour, in the body's frame B.

    Attributes:
        paint: a swatch or a blend of two: see `hapscene.scene.fine_paint.parts`.
        tint: index of the file colour: see `FileColours`; 0 if the file has no colours.
        vertices_m: (v, 3) float32 vertices in use [m].
        faces: (f, 3) uint32.
        shown: (s,) int64, faces of the reduced mesh that the first s faces are.
        over: (f − s,) int64, faces of the full mesh that the other faces are, or are subfaces of.
    """

    paint: int
    tint: int
    vertices_m: NDArray[np.float32]
    faces: NDArray[np.uint32]
    shown: NDArray[np.int64]
    over: NDArray[np.int64]

    @property
    def swatch(self) -> int:
        """Index of the swatch in the scene; of a blend, the swatch with the larger weight."""
        return int(parts(self.paint)[0])


class Overlay(NamedTuple):
    """Correspondence of a full mesh and its reduced mesh.

    Attributes:
        shown_of: (M,) int32, the shown face that represents each face of the full mesh.
        lent: (k, 2) int32, shown faces that represent no face, and the face of the full mesh whose colour each takes.
        under: (N,) int32, the shown face below or above each vertex of the full mesh; −1 if it does not exist.
        raised_m: (N, 3) float32, vertices of the full mesh raised above the shown faces [m].
    """

    shown_of: NDArray[np.int32]
    lent: NDArray[np.int32]
    under: NDArray[np.int32]
    raised_m: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ReducedMesh:
    """The reduced mesh of a body, in the body's frame B; its faces are called shown faces.

    Attributes:
        vertices_m: (V, 3) float32 [m].
        faces: (S, 3) int32.
        whole: whether it is the full mesh, not reduced.
    """

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    whole: bool
    _shape: PaintableMesh

    @cached_property
    def overlay(self) -> Overlay:
        """Correspondence with the full mesh, computed at first use: an unpainted mesh is shown without it."""
        return _compared(self._shape, self)


class Display:
    """Display meshes of a painted scene, kept up to date.

    Args:
        painting: the painted scene.
        shown_max: largest number of triangles of all bodies together.

    Attributes:
        bodies: display state of each body, in the order of the scene.

    Raises:
        ViewError: a mesh must be reduced, and the package fast-simplification is missing.
    """

    def __init__(self, painting: Painting, shown_max: int = SHOWN_MAX) -> None:
        self._painting, self._shown_max = painting, shown_max
        self._made: dict[int, tuple[PaintableMesh, ReducedMesh]] = {}  # by id of the mesh
        self._known: dict[int, tuple[Body, ReducedMesh, ShownBody]] = {}  # by id of the body
        self.bodies: list[ShownBody] = []
        self.compose()

    def prepare_strokes(self) -> None:
        """Compute in advance what the first stroke needs. Thread-safe; takes seconds for a large mesh."""
        for body in self.bodies:
            body.prepare()

    def prepare(self, meshes: Sequence[Mesh]) -> None:
        """Reduce the meshes of bodies that are about to be added. Thread-safe; takes seconds for a large mesh."""
        known = [len(body.mesh.faces) for body in self._painting.scene.bodies]
        counts = triangle_shares([*known, *(len(mesh.faces) for mesh in meshes)], self._shown_max)[len(known) :]
        for mesh, count in zip(meshes, counts, strict=True):
            if id(mesh) not in self._made:
                shape = self._painting.shape_of(mesh)
                self._made[id(mesh)] = shape, reduce_mesh(shape, count)

    def compose(self) -> list[ChunkKey]:
        """Update `bodies` after bodies changed; returns the changed chunks of bodies that were shown before."""
        painting, bodies = self._painting, self._painting.scene.bodies
        counts = triangle_shares([len(body.mesh.faces) for body in bodies], self._shown_max)
        known, self._known = self._known, {}
        changed: list[ChunkKey] = []
        with painting.lock:
            for i, (body, shape, count) in enumerate(zip(bodies, painting.shapes, counts, strict=True)):
                mesh = self._made.get(id(body.mesh), (shape, None))[1]
                low, high = count / SLACK, min(count * SLACK, len(body.mesh.faces))
                if mesh is None or not low <= len(mesh.faces) <= high:
                    mesh = reduce_mesh(shape, count)
                    self._made[id(body.mesh)] = shape, mesh
                old = known.get(id(body))
                if old is not None and old[1] is mesh:
                    shown = old[2]
                    changed += [ChunkKey(i, int(c)) for c in shown.update(np.arange(len(body.face_swatch)))]
                else:
                    shown = ShownBody(shape, mesh, body)
                self._known[id(body)] = body, mesh, shown
        drop_unused_meshes(self._made, bodies)
        self.bodies = [self._known[id(body)][2] for body in bodies]
        return changed

    def chunks(self) -> list[ChunkKey]:
        """All chunks and patches."""
        return [ChunkKey(b, c) for b, body in enumerate(self.bodies) for c in body.chunks()]

    def layers(self, key: ChunkKey) -> list[Layer]:
        """Meshes of a chunk, one for each paint and tint."""
        return self.bodies[key.body].layers(key.chunk)

    def update(self, changes: Changes) -> list[ChunkKey]:
        """Update painted faces; returns the chunks that must be drawn again.

        A change of a swatch's colour alone changes no chunk: the view assigns the colours of layers.
        """
        return [
            ChunkKey(body, int(c)) for body, faces in changes.faces.items() for c in self.bodies[body].update(faces)
        ]


class ShownBody:
    """Display state of a body.

    Attributes:
        mesh: the reduced mesh.
        file_colours: colours of the mesh file; None if it has none.
        textured: whether its materials have textures and all of its faces are shown, so that the textures can be.
        swatch: (S,) int16 swatch of each shown face.
        chunk: (S,) int32 chunk of each shown face.
        chunk_count: number of chunks.
    """

    def __init__(self, shape: PaintableMesh, mesh: ReducedMesh, body: Body) -> None:
        self.mesh = mesh
        self._shape = shape
        self._face_swatch = body.face_swatch
        self._drawn = body.face_swatch.copy()
        middle_m = mesh.vertices_m[mesh.faces].mean(axis=1)
        self.chunk = _chunk_of(middle_m)
        self.chunk_count = int(self.chunk.max()) + 1
        self.swatch = np.full(len(mesh.faces), self._drawn[0], np.int16)
        painted = bool((self._drawn != self._drawn[0]).any())
        if painted:
            self._assign_swatches(np.arange(len(mesh.faces)))
        self.file_colours = FileColours.of(body.mesh)
        self.textured = mesh.whole and any(material.textures for material in body.mesh.materials)
        self._tint = np.zeros(len(self._drawn), np.uint8) if self.file_colours is None else self.file_colours.tint
        single = mesh.whole or self.file_colours is None
        self._shown_tint = self._tint[: len(mesh.faces)] if single else self._tint[self._first_full()]

        def group() -> NDArray[np.int32]:
            return _chunk_of(middle_m, len(mesh.faces) // PATCHES + 1)[mesh.overlay.shown_of]

        self._subfaces = ShownSubfaces(body, shape, group)
        self._subfaces.update(np.arange(len(self._drawn)))
        self._over = self._drawn_whole() if painted else np.zeros(len(self._drawn), np.bool_)

    @cached_property
    def _represented(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Faces of the full mesh (M,) in the order of the shown faces that represent them; starts of those (S + 1,)."""
        shown_of = self.mesh.overlay.shown_of
        count = np.bincount(shown_of, minlength=len(self.mesh.faces))
        return np.argsort(shown_of, kind="stable"), np.concatenate([[0], np.cumsum(count)])

    def prepare(self) -> None:
        """Compute in advance what the first stroke needs: it takes seconds for a large mesh. Thread-safe."""
        self._shape.prepare()
        self._subfaces.prepare()
        _ = self._represented

    def look_mesh(self) -> Mesh:
        """The mesh with its materials, sunk by `RAISED`, so that the painted layers lie over it."""
        mesh, place = self._shape.mesh, self._shape.welded
        up = unit(_around(place[mesh.faces], self._shape.normal, len(place)))[place]
        return replace(mesh, vertices_m=mesh.vertices_m - RAISED * mesh.diagonal_m * up)

    def chunks(self) -> list[int]:
        """Numbers of the chunks and of the patches of subfaces."""
        return [*range(self.chunk_count), *self._subfaces.patches().tolist()]

    def update(self, faces: NDArray[np.integer]) -> NDArray[np.int64]:
        """Update faces (n,) of the full mesh; returns the changed chunks and patches."""
        patches, turned = self._subfaces.update(faces)
        faces = faces[self._drawn[faces] != self._face_swatch[faces]]
        if not len(faces) and not len(turned):
            return patches
        self._drawn[faces] = self._face_swatch[faces]
        lent, shown_of = self.mesh.overlay.lent, self.mesh.overlay.shown_of
        borrowers = lent[np.isin(lent[:, 1], faces), 0]
        shown = np.unique(np.concatenate([shown_of[faces], borrowers]))
        before, over = self.swatch[shown], self._over
        self._assign_swatches(shown)
        self._over = self._drawn_whole()
        other = np.concatenate([np.flatnonzero(over != self._over), faces[self._over[faces]]])
        if self.mesh.whole:
            other = turned
        changed = np.concatenate([shown[before != self.swatch[shown]], shown_of[other]])
        return np.unique(np.concatenate([patches, self.chunk[changed]])).astype(np.int64)

    def layers(self, chunk: int) -> list[Layer]:
        """Meshes of a chunk or patch, one for each paint and tint."""
        if not 0 <= chunk < self.chunk_count:
            return self._subface_layers(chunk)
        inside = np.flatnonzero(self.chunk == chunk)
        if self.mesh.whole:  # a subdivided face is drawn by its subfaces
            inside = inside[~self._subfaces.has[inside]]
        over = np.flatnonzero(self._over)
        if len(over):
            over = over[self.chunk[self.mesh.overlay.shown_of[over]] == chunk]
        over = over if len(over) <= CHUNK else over[:0]
        kind = _kind(self.swatch[inside], self._shown_tint[inside])
        kind_over = _kind(self._drawn[over], self._tint[over])
        found = []
        for one in np.unique(np.concatenate([kind, kind_over])):
            shown, fine = inside[kind == one], over[kind_over == one]
            vertices_m, faces = _used(self.mesh.vertices_m, self.mesh.faces[shown])
            if len(fine):
                raised_m, raised = _used(self.mesh.overlay.raised_m, self._shape.mesh.faces[fine])
                faces = np.concatenate([faces, raised + len(vertices_m)])
                vertices_m = np.concatenate([vertices_m, raised_m])
            found.append(Layer(*_of_kind(one), vertices_m, faces.astype(np.uint32), shown, fine))
        return found

    def _subface_layers(self, patch: int) -> list[Layer]:
        subfaces, mesh = self._subfaces.of_patch(patch), self._shape.mesh
        vertices_m = mesh.vertices_m if self.mesh.whole else self.mesh.overlay.raised_m
        corner_m = subface_triangles(subfaces, vertices_m[mesh.faces[subfaces.face]], OVERLAP * mesh.diagonal_m)
        kind, found = _kind(_fewer_weights(subfaces.paint), self._tint[subfaces.face]), []
        for one in np.unique(kind):
            mine = np.flatnonzero(kind == one)
            faces = np.arange(3 * len(mine), dtype=np.uint32).reshape(-1, 3)
            over = subfaces.face[mine].astype(np.int64)
            found.append(Layer(*_of_kind(one), corner_m[mine].reshape(-1, 3), faces, mine[:0], over))
        return found

    def _first_full(self) -> NDArray[np.int64]:
        """Return the face (S,) of the full mesh that determines the tint of each displayed face."""
        full, start = self._represented
        first, lent = full[np.minimum(start[:-1], len(full) - 1)], self.mesh.overlay.lent
        first[lent[:, 0]] = lent[:, 1]
        return np.asarray(first)

    def _drawn_whole(self) -> NDArray[np.bool_]:
        """Whether each face (M,) of the full mesh is drawn: at borders, and where the shown face has another swatch."""
        shape, wrong = self._shape, np.zeros(len(self._drawn), np.bool_)
        if not self.mesh.whole:
            overlay = self.mesh.overlay
            args = self._face_swatch, self.swatch, overlay.shown_of, overlay.under, shape.mesh.faces, shape.pairs
            mark_wrong(*args, wrong, np.zeros_like(wrong))
            wrong &= ~self._subfaces.has
        return wrong

    def _assign_swatches(self, shown: NDArray[np.integer]) -> None:
        """Give shown faces (n,) the swatch with the largest area among the faces that they represent.

        If two areas are equal, the swatch with the lower index is used.
        """
        every, start = self._represented
        length = start[shown + 1] - start[shown]
        row = np.repeat(np.arange(len(shown)), length)
        within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        full = every[np.repeat(start[shown], length) + within]
        kinds, kind = np.unique(self._face_swatch[full], return_inverse=True)
        area = np.bincount(row * len(kinds) + kind, self._shape.area_m2[full], minlength=len(shown) * len(kinds))
        if len(kinds):
            self.swatch[shown] = kinds[np.argmax(area.reshape(len(shown), -1), axis=1)]
        lent = self.mesh.overlay.lent
        mine = np.isin(lent[:, 0], shown)
        self.swatch[lent[mine, 0]] = self._face_swatch[lent[mine, 1]]


@native
def mark_wrong(
    swatch: Ints, shown_swatch: Ints, shown_of: Ints, under: Ints, faces: Ints, pairs: Ints, wrong: Mask, beside: Mask
) -> None:
    """Set `wrong` for faces whose shown face has another swatch, and for faces next to a border.

    Args:
        swatch, shown_swatch: (M,), (S,) swatches of the full and of the reduced mesh.
        shown_of, under: (M,), (N,) shown face that represents each face, and below each vertex.
        faces, pairs: (M, 3), (n, 2) faces of the full mesh, and pairs of adjacent faces.
        wrong, beside: (M,) bool, output and scratch; all false before.
    """
    for i in range(len(faces)):
        wrong[i] = shown_swatch[shown_of[i]] != swatch[i]
        for k in range(3):
            shown = under[faces[i, k]]
            wrong[i] |= shown >= 0 and shown_swatch[shown] != swatch[i]
    for i in range(len(pairs)):  # a shown face may end between the corners of a face: mark the neighbours, too
        one, other = pairs[i, 0], pairs[i, 1]
        if wrong[one] or wrong[other] or swatch[one] != swatch[other]:
            beside[one] = beside[other] = True
    for i in range(len(wrong)):
        wrong[i] |= beside[i]


WEIGHTS: Final = 8
"""Number of distinct weights shown of a blend [count]: each is drawn as one mesh."""

_TINT_BITS: Final = 8


def _fewer_weights(paint: NDArray[np.int64]) -> NDArray[np.int64]:
    """Paints with their blend weights rounded to multiples of 1 / `WEIGHTS`."""
    a, b, weight = parts(paint)
    return np.asarray(blend(a, np.where(weight > 0, b, a), np.rint(weight * WEIGHTS) / WEIGHTS))


def _kind(paint: NDArray[np.integer], tint: NDArray[np.integer]) -> NDArray[np.int64]:
    """Paint and tint (n,) packed into one number (n,); faces with the same number are drawn as one mesh."""
    return np.asarray(paint.astype(np.int64) << _TINT_BITS | tint)


def _of_kind(kind: int) -> tuple[int, int]:
    """Paint and tint of a number from `_kind`."""
    return int(kind) >> _TINT_BITS, int(kind) & ((1 << _TINT_BITS) - 1)


def triangle_shares(counts: list[int], most: int) -> list[int]:
    """Number of triangles shown of bodies with `counts` faces: at most `most` in total, at least 1 each.

    Small bodies are shown in full; the others get equal shares.
    """
    found, left = list(counts), most
    order = sorted(range(len(counts)), key=counts.__getitem__)
    for k, body in enumerate(order):
        found[body] = min(counts[body], max(left // (len(order) - k), 1))
        left -= found[body]
    return found


def _used(vertices_m: NDArray[np.float32], faces: NDArray[np.int32]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """The vertices that faces (n, 3) use, and the faces with indices into those vertices."""
    used, index = np.unique(faces, return_inverse=True)
    return vertices_m[used], index.reshape(-1, 3)


def _chunk_of(centroid_m: NDArray[np.floating], most: int = CHUNK) -> NDArray[np.int32]:
    """Return the chunk (S,) of each point (S, 3). Bisects the points until each chunk has at most `most` points."""
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


# --- mesh reduction, and the mapping between the full and the reduced mesh ---


def reduce_mesh(shape: PaintableMesh, count: int) -> ReducedMesh:
    """Reduce a mesh to about `count` faces; a mesh with no more faces is kept.

    The method is edge collapse by quadric error metrics (Garland & Heckbert 1997, fast-simplification), or vertex
    clustering (Rossignac & Borrel 1993) for meshes with many slivers. A face of the full mesh is represented by the
    shown face above or below its centroid; if it does not exist, by the nearest one in centroid and normal.

    Raises:
        ViewError: the package fast-simplification is missing.
    """
    mesh = shape.mesh
    if len(mesh.faces) <= count:
        return ReducedMesh(mesh.vertices_m.astype(np.float32), mesh.faces, True, shape)
    corners = shape.welded[mesh.faces]
    used = np.zeros(len(mesh.vertices_m), np.bool_)
    used[corners] = True
    vertices_m, faces = mesh.vertices_m[used], (np.cumsum(used) - 1)[corners].astype(np.int32)
    found = None
    some = shape.corner_m[:: max(len(faces) // SOME, 1)]
    if np.count_nonzero(_smallest_sine(some) < SLIVER_SINE) * len(faces) / len(some) < count / 2:
        left = vertices_m, faces
        if len(faces) > 2 * FIRST * count:  # small clusters lose nothing visible, and are much faster
            span_m = float(np.ptp(vertices_m, axis=0).max())
            area_m2 = float(area_of(some).sum()) * len(faces) / len(some)
            direction = _direction(faces, shape.normal, len(vertices_m))
            left = _grouped(vertices_m, faces, direction, span_m * math.sqrt(FIRST * count / (2 * area_m2)))
        found = _collapsed(*left, count)
    if found is None or len(found[1]) > EXCESS * count:
        found = _clustered(vertices_m, faces, shape.normal, count)
    return ReducedMesh(found[0].astype(np.float32), found[1], False, shape)


def _collapsed(vertices_m: Places, faces: Faces, count: int) -> tuple[Places, Faces]:
    try:
        from fast_simplification import simplify
    except ImportError:
        raise ViewError(
            f"a mesh of {len(faces):,} faces must be reduced to be shown, and the package fast-simplification is "
            "missing: pip install 'hapscene[paint]'"
        ) from None
    centre_m = vertices_m.mean(axis=0)
    vertices, left = simplify(vertices_m - centre_m, faces, target_count=count)
    return np.asarray(vertices, np.float64) + centre_m, np.asarray(left, np.int32)


def _clustered(vertices_m: Places, faces: Faces, normal: NDArray[np.float64], count: int) -> tuple[Places, Faces]:
    """Vertex clustering on the finest grid that leaves at most `count` faces."""
    direction = _direction(faces, normal, len(vertices_m))
    coarse, fine = 1.0, float(GRID_MAX)  # cells along the longest side
    best = vertices_m, faces
    while fine / coarse > 1.05:
        cells = math.sqrt(coarse * fine)
        found = _grouped(vertices_m, faces, direction, cells)
        if len(found[1]) <= count:
            coarse = cells
        else:
            fine = cells
        if len(found[1]) <= count or len(best[1]) > count:
            best = found
    return best


def _direction(faces: Faces, normal: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Which of 27 directions the normal at each vertex (count,) is nearest to."""
    around = _around(faces, normal, count)
    way = np.rint(around / np.maximum(np.abs(around).max(axis=1, keepdims=True), 1e-300)).astype(np.int64) + 1
    return np.asarray(way @ np.array([9, 3, 1]))


def _grouped(vertices_m: Places, faces: Faces, direction: NDArray[np.int64], cells: float) -> tuple[Places, Faces]:
    """Merge vertices with the same grid cell and direction into their mean; `cells` along the longest side."""
    low_m, span_m = vertices_m.min(axis=0), float(np.ptp(vertices_m, axis=0).max())
    key = np.zeros(len(vertices_m), np.int64)
    for cell in ((vertices_m - low_m) / span_m * cells).astype(np.int64).T:
        key = key * (GRID_MAX + 1) + cell
    cluster = np.unique(key * 27 + direction, return_inverse=True)[1]
    size = np.bincount(cluster)
    middle_m = np.stack([np.bincount(cluster, vertices_m[:, k]) / size for k in range(3)], axis=1)
    return middle_m, _once(cluster[faces]).astype(np.int32)


def _once(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces (M, 3) without degenerate and duplicate ones."""
    whole = corners[(corners != corners[:, (1, 2, 0)]).all(axis=1)]
    row, low = np.arange(len(whole)), np.argmin(whole, axis=1)
    turned = np.stack([whole[row, (low + k) % 3] for k in range(3)], axis=1)  # lowest index first, winding kept
    size = int(corners.max()) + 1
    key = (turned[:, 0] * size + turned[:, 1]) * size + turned[:, 2]
    return np.asarray(turned[np.unique(key, return_index=True)[1]])


def _smallest_sine(corner_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sine (M,) of the smallest angle of triangles (M, 3, 3); 0 for degenerate ones."""
    side = np.sort(np.linalg.norm(corner_m - corner_m[:, (1, 2, 0)], axis=2), axis=1)
    product = side[:, 1] * side[:, 2]
    return np.asarray(np.divide(2 * area_of(corner_m), product, out=np.zeros(len(side)), where=product > 0))


def _around(faces: NDArray[np.integer], normal: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Sum (count, 3) of the normals (M, 3) of the faces at each vertex."""
    corners = faces.ravel()
    return np.stack([np.bincount(corners, np.repeat(normal[:, k], 3), count) for k in range(3)], axis=1)


def _compared(shape: PaintableMesh, reduced: ReducedMesh) -> Overlay:
    """Correspondence of a mesh and its reduced mesh."""
    mesh, vertices_m, faces = shape.mesh, reduced.vertices_m.astype(np.float64), reduced.faces
    if reduced.whole:
        every, none = np.arange(len(faces), dtype=np.int32), np.zeros(0, np.int32)
        return Overlay(every, none.reshape(0, 2), none, reduced.vertices_m)
    corner = vertices_m[faces]
    normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    search = Search(vertices_m, faces, 0.0)
    shown_of, over_face_m = _under(search, normal, shape.centroid_m, shape.normal, NEAR * mesh.diagonal_m)
    shown_of, lent = _stand_for(shape, corner, normal, shown_of)
    is_first = shape.welded == np.arange(len(shape.welded))  # vertices at the same position are compared once
    first, place = np.flatnonzero(is_first), (np.cumsum(is_first) - 1)[shape.welded]
    corners = place[mesh.faces]
    up = unit(_around(corners, shape.normal, len(first)))
    under, above_m = _under(search, normal, mesh.vertices_m[first], up, NEAR * mesh.diagonal_m)
    lift_m = np.maximum(above_m, 0.0)
    for column in corners.T:
        np.maximum.at(lift_m, column, over_face_m)
    lift_m += RAISED * mesh.diagonal_m
    raised_m = mesh.vertices_m + (lift_m[:, None] * up)[place]
    return Overlay(shown_of, lent, under[place], raised_m.astype(np.float32))


def _under(
    search: Search, shown_normal: NDArray[np.float64], points_m: Places, normals: NDArray[np.float64], far_m: float
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Shown face (n,) above or below each point, −1 if it does not exist, and its height above the point (n,) [m]."""
    face, above_m = np.zeros(len(points_m), np.int32), np.zeros(len(points_m))
    overlay_faces(search.handle, new_ray(), points_m - search.center_m, normals, shown_normal, far_m, face, above_m)
    return face, above_m


def _stand_for(
    shape: PaintableMesh, corner_m: NDArray[np.float64], normal: NDArray[np.float64], shown_of: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Replace −1 in `shown_of` (M,) by the face nearest in position and normal; compute `Overlay.lent`."""
    edge_m = float(np.median(np.linalg.norm(corner_m[:, 1] - corner_m[:, 0], axis=1)))
    scale_m = NORMAL_EDGES / 2 * edge_m  # opposite unit normals are 2 apart
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
    search: int, ray: Ray32, points_m: Row, normals: Row, shown_normals: Row, far_m: float, faces: Ints, above_m: Row
) -> None:
    """Find the shown face above or below each point, along its normal.

    Args:
        search, ray: see `first_face`.
        points_m: (n, 3) in the centred frame of the search structure [m].
        normals: (n, 3) unit normals at the points; zero if unknown.
        shown_normals: (S, 3) normals of the shown faces; a face that points away from the normal is ignored.
        far_m: length of a ray to either side [m].
        faces, above_m: (n,), (n,) output: face, −1 if it does not exist, and its height above the point [m].
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
