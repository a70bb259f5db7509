"""The scene as it is shown: bodies reduced, cut into chunks, each chunk a mesh for each swatch on it.

A browser that draws without a graphics card is slow over some 60,000 triangles, and what is sent anew after a stroke
should be small: so no more is shown than that, in chunks of some thousand, and only chunks whose swatches changed are
made again. Painted is always the full mesh. A shown face wears the swatch that most of the area it stands for has. Over
it are drawn, raised by a hair, the faces of the full mesh for which that is wrong, and those along a border: so borders
are seen as they are. The picture depends on the painting alone, and undo brings it back.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.paint.change_watch import Changes
from hapscene.paint.paintable_mesh import PaintableMesh
from hapscene.paint.painting import Canvas
from hapscene.paint.reduce import Reduced, reduced
from hapscene.scene.topology import area_of

SHOWN_MAX: Final = 60_000
"""Most triangles shown of a whole scene [count]."""

CHUNK: Final = 3_000
"""Most triangles of a chunk [count]: some 60 kB to send, and twenty chunks of the largest scene. Over them are drawn as
many of the full mesh at most; where a painting is more chequered, the shown faces must do."""


class ChunkKey(NamedTuple):
    """A chunk: index of its body, and its number there."""

    body: int
    chunk: int


@dataclass(frozen=True, eq=False)
class Layer:
    """The part of a chunk that wears one swatch, in the body's frame B.

    Attributes:
        swatch: index in the scene.
        vertices_m: (v, 3) float32 [m], those in use.
        faces: (f, 3) uint32.
        shown: (s,) int64, which shown faces of the body the first of them are.
        over: (f − s,) int64, which faces of the full mesh, raised, the others are.
    """

    swatch: int
    vertices_m: NDArray[np.float32]
    faces: NDArray[np.uint32]
    shown: NDArray[np.int64]
    over: NDArray[np.int64]


class ShownBody:
    """A body as it is shown.

    Attributes:
        mesh: what is shown of its mesh.
        swatch: (S,) int16 that each shown face wears.
        chunk: (S,) int32 that it is in.
        chunk_count: how many there are.
    """

    def __init__(self, shape: PaintableMesh, mesh: Reduced, face_swatch: NDArray[np.int16]) -> None:
        self.mesh = mesh
        self._shape = shape
        self._face_swatch = face_swatch
        self._drawn = face_swatch.copy()
        # where none has an area, what is painted decides still
        self._area_m2 = np.maximum(area_of(shape.corner_m), np.finfo(np.float64).tiny)
        self._full = np.argsort(mesh.shown_of, kind="stable")
        count = np.bincount(mesh.shown_of, minlength=len(mesh.faces))
        self._start = np.concatenate([[0], np.cumsum(count)])
        self.chunk = _cut(mesh.vertices_m[mesh.faces].mean(axis=1))
        self.chunk_count = int(self.chunk.max()) + 1
        self.swatch = np.zeros(len(mesh.faces), np.int16)
        self._wear(np.arange(len(mesh.faces)))
        self._over = self._wrong()

    def update(self, faces: NDArray[np.integer]) -> NDArray[np.int64]:
        """Look again at faces (n,) of the full mesh; the chunks that became others."""
        faces = faces[self._drawn[faces] != self._face_swatch[faces]]
        self._drawn[faces] = self._face_swatch[faces]
        lent = self.mesh.lent
        borrowers = lent[np.isin(lent[:, 1], faces), 0]
        shown = np.unique(np.concatenate([self.mesh.shown_of[faces], borrowers]))
        before, over = self.swatch[shown], self._over
        self._wear(shown)
        self._over = self._wrong()
        other = np.concatenate([np.flatnonzero(over != self._over), faces[self._over[faces]]])
        changed = np.concatenate([shown[before != self.swatch[shown]], self.mesh.shown_of[other]])
        return np.unique(self.chunk[changed]).astype(np.int64)

    def layers(self, chunk: int) -> list[Layer]:
        """The meshes that a chunk is drawn as, one for each swatch in it."""
        inside = np.flatnonzero(self.chunk == chunk)
        over = np.flatnonzero(self._over)
        over = over[self.chunk[self.mesh.shown_of[over]] == chunk]
        over = over if len(over) <= CHUNK else over[:0]
        found = []
        for swatch in np.unique(np.concatenate([self.swatch[inside], self._face_swatch[over]])):
            shown, fine = inside[self.swatch[inside] == swatch], over[self._face_swatch[over] == swatch]
            vertices_m, faces = _used(self.mesh.vertices_m, self.mesh.faces[shown])
            if len(fine) and self.mesh.raised_m is not None:
                raised_m, raised = _used(self.mesh.raised_m, self._shape.mesh.faces[fine])
                faces = np.concatenate([faces, raised + len(vertices_m)])
                vertices_m = np.concatenate([vertices_m, raised_m])
            found.append(Layer(int(swatch), vertices_m, faces.astype(np.uint32), shown, fine))
        return found

    def _wrong(self) -> NDArray[np.bool_]:
        """Whether each face (M,) of the full mesh is drawn itself: at a border, or where what is shown is wrong."""
        mesh, swatch, pairs = self.mesh, self._face_swatch, self._shape.pairs
        if mesh.raised_m is None:
            return np.zeros(len(swatch), np.bool_)
        wrong: NDArray[np.bool_] = self.swatch[mesh.shown_of] != swatch
        seen = np.where(mesh.under >= 0, self.swatch[mesh.under], -1)
        for corner in self._shape.mesh.faces.T:
            wrong |= (seen[corner] != swatch) & (seen[corner] >= 0)
        one, other = pairs.T
        beside = wrong[one] | wrong[other] | (swatch[one] != swatch[other])  # tips of shown faces lie between corners
        wrong[one[beside]] = wrong[other[beside]] = True
        return wrong

    def _wear(self, shown: NDArray[np.integer]) -> None:
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


class Display:
    """What of a painted scene is shown.

    Args:
        canvas: the scene.
        shown_max: most triangles of all bodies together.

    Attributes:
        bodies: as they are shown, in the scene's order.

    Raises:
        ViewError: a mesh must be reduced, and the package that does it is missing.
    """

    def __init__(self, canvas: Canvas, shown_max: int = SHOWN_MAX) -> None:
        bodies = canvas.scene.bodies
        counts = shares([len(body.mesh.faces) for body in bodies], shown_max)
        made: dict[tuple[int, int], Reduced] = {}
        self.bodies: list[ShownBody] = []
        with canvas.lock:
            for body, shape, count in zip(bodies, canvas.shapes, counts, strict=True):
                key = (id(body.mesh), count)
                if key not in made:
                    made[key] = reduced(shape, count)
                self.bodies.append(ShownBody(shape, made[key], body.face_swatch))

    def chunks(self) -> list[ChunkKey]:
        """All chunks."""
        return [ChunkKey(b, c) for b, body in enumerate(self.bodies) for c in range(body.chunk_count)]

    def layers(self, key: ChunkKey) -> list[Layer]:
        """The meshes that a chunk is drawn as, one for each swatch in it."""
        return self.bodies[key.body].layers(key.chunk)

    def update(self, changes: Changes) -> list[ChunkKey]:
        """Take note of what changed; the chunks to be drawn anew.

        A swatch whose colour changed alone changes no chunk: it is the view that gives layers their colours.
        """
        return [
            ChunkKey(body, int(c)) for body, faces in changes.faces.items() for c in self.bodies[body].update(faces)
        ]


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


def _cut(centroid_m: NDArray[np.floating]) -> NDArray[np.int32]:
    """A chunk (S,) for each place (S, 3): halved across the longest side until none has more than `CHUNK`."""
    chunk = np.zeros(len(centroid_m), np.int32)
    waiting, count = [np.arange(len(centroid_m))], 0
    while waiting:
        inside = waiting.pop()
        if len(inside) <= CHUNK:
            chunk[inside] = count
            count += 1
            continue
        place = centroid_m[inside]
        axis = int(np.argmax(place.max(axis=0) - place.min(axis=0)))
        half = len(inside) // 2
        order = np.argpartition(place[:, axis], half)
        waiting += [inside[order[half:]], inside[order[:half]]]
    return chunk
