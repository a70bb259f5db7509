"""Undo and redo: packed differences of faces, swatches and bodies before and after each step."""

import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.body import Body
from hapscene.scene.fine_paint import NOTHING, FinePaint
from hapscene.surface.swatch import Swatch

__all__ = [
    "BodyDelta",
    "FaceDelta",
    "History",
    "Paint",
    "Step",
    "SwatchDelta",
    "SwatchState",
    "columns_of",
    "face_count_text",
    "leaf_marks",
]

Paint = tuple[NDArray[np.int16], FinePaint | None]
"""How a body is painted: `Body.face_swatch` and `Body.fine`."""

BYTES_MAX: Final = 64 * 1024 * 1024
"""Most memory that the packed steps may take [bytes]. A stroke of 5,000 faces takes some 10 kB, filling a body of
330 k faces 1 kB: thousands of steps fit."""

STEP_MAX: Final = 10_000
"""Most steps that can be undone [count]: bounds those that hold swatches, whose size is shared with the scene."""

STEP_BYTES: Final = 500
"""What a step takes besides its faces [bytes]: the objects themselves."""

Source = str | Path | None
"""Where a swatch was loaded from, as in `Scene.swatch_source`."""


@dataclass(frozen=True)
class FaceDelta:
    """Faces of a body that changed: their indices, their swatches and their leaves before and after, packed."""

    body: int
    packed: bytes = field(repr=False)
    count: int
    leaves: tuple[bytes, bytes] = field(default=(b"", b""), repr=False)

    @staticmethod
    def between(body: int, old: Paint, new: Paint) -> "FaceDelta | None":
        """What differs in the swatches (M,) and leaves of a body's faces; None where nothing does."""
        differs = old[0] != new[0]
        was, now = old[1] or NOTHING, new[1] or NOTHING
        if was is not now:
            differs[other_faces(was, now)] = True
        faces = np.flatnonzero(differs)
        leaves = (was.of_faces(faces), now.of_faces(faces)) if was is not now else (NOTHING, NOTHING)
        return FaceDelta.pack(body, faces, old[0][faces], new[0][faces], *leaves) if len(faces) else None

    @staticmethod
    def pack(
        body: int,
        faces: NDArray[np.integer],
        old: NDArray[np.int16],
        new: NDArray[np.int16],
        was: FinePaint = NOTHING,
        now: FinePaint = NOTHING,
    ) -> "FaceDelta":
        """Of faces (n,), ascending, their swatches (n,), and all their leaves."""
        steps = np.diff(faces, prepend=0).astype(np.int32)  # small numbers, mostly ones: they pack well
        content = steps.tobytes() + old.tobytes() + new.tobytes()
        return FaceDelta(body, zlib.compress(content, 1), len(faces), (pack_leaves(was), pack_leaves(now)))

    def unpack(self) -> tuple[NDArray[np.int64], NDArray[np.int16], NDArray[np.int16]]:
        """Faces, and their swatches before and after, (count,) each."""
        content, n = zlib.decompress(self.packed), self.count
        faces = np.cumsum(np.frombuffer(content, np.int32, n), dtype=np.int64)
        return faces, np.frombuffer(content, np.int16, n, 4 * n), np.frombuffer(content, np.int16, n, 6 * n)

    def put(self, body: Body, back: bool) -> NDArray[np.int64]:
        """Paint a body as the faces were, or (not `back`) became; which they are."""
        faces, old, new = self.unpack()
        body.face_swatch[faces] = old if back else new
        fine = (body.fine or NOTHING).with_faces(faces, unpack_leaves(self.leaves[0 if back else 1]))
        body.fine = fine if len(fine) else None
        return faces

    @property
    def size(self) -> int:
        """Memory that it takes [bytes]."""
        return len(self.packed) + len(self.leaves[0]) + len(self.leaves[1])


def other_faces(one: FinePaint, other: FinePaint) -> NDArray[np.int32]:
    """Faces whose leaves are not the same in both, ascending."""
    a, b = leaf_marks(one), leaf_marks(other)
    return np.union1d(one.face[~np.isin(a, b)], other.face[~np.isin(b, a)])


def leaf_marks(leaves: FinePaint) -> NDArray[np.uint64]:
    """A number (k,) for each leaf with its paint that no other has, but by a chance of one in 2^64."""
    found = leaves.face.astype(np.uint64) << np.uint64(32) | leaves.path
    for values in (leaves.level, leaves.paint):
        found = (found ^ found >> np.uint64(29)) * np.uint64(0x9E3779B97F4A7C15) + values.astype(np.uint64)
    return found * np.uint64(0xBF58476D1CE4E5B9)


def columns_of(leaves: FinePaint) -> tuple[NDArray[Any], ...]:
    """The arrays of leaves."""
    return leaves.face, leaves.path, leaves.edge, leaves.level, leaves.paint


def pack_leaves(leaves: FinePaint) -> bytes:
    """Leaves as few bytes."""
    return zlib.compress(b"".join(column.tobytes() for column in columns_of(leaves)), 1) if len(leaves) else b""


def unpack_leaves(packed: bytes) -> FinePaint:
    """What was packed."""
    if not packed:
        return NOTHING
    content, found, at = zlib.decompress(packed), [], 0
    types = [column.dtype for column in columns_of(NOTHING)]
    count = len(content) // sum(kind.itemsize for kind in types)
    for kind in types:
        found.append(np.frombuffer(content, kind, count, at))
        at += count * kind.itemsize
    return FinePaint(*found)


@dataclass(frozen=True, eq=False)
class SwatchState:
    """A swatch of the scene at one time.

    Attributes:
        swatch: as it is.
        source: where it was loaded from; None where it was changed or made here.
        original: what `reset` brings back; None for itself.
    """

    swatch: Swatch
    source: Source
    original: "SwatchState | None" = None


@dataclass(frozen=True)
class SwatchDelta:
    """A swatch of the scene before and after; None where there was, or is, none."""

    index: int
    old: SwatchState | None
    new: SwatchState | None


@dataclass(frozen=True, eq=False)
class BodyDelta:
    """A body of the scene before and after; None where there was, or is, none: those behind it have moved up.

    Of a body that goes on, both are copies that tell its name, mesh, pose and parent; `FaceDelta` its painting.
    """

    index: int
    old: Body | None
    new: Body | None

    @property
    def size(self) -> int:
        """Memory that it takes [bytes]: a body that is gone is kept by its step alone."""
        gone = self.old if self.new is None else None
        return 0 if gone is None else gone.face_swatch.nbytes + gone.mesh.vertices_m.nbytes + gone.mesh.faces.nbytes


@dataclass(frozen=True)
class Step:
    """What one undo takes back.

    Attributes:
        what: in words for the user: "brush, 812 faces".
        swatches: changed first when done, last when undone: faces refer to them.
        bodies: changed next, in this order: faces refer to them.
        faces: of one or more bodies.
        key: what the step went on changing, so that the next of the same key may join it; None for what stands alone.
        number: tells it from all others; set by the history.
    """

    what: str
    swatches: tuple[SwatchDelta, ...] = ()
    faces: tuple[FaceDelta, ...] = ()
    bodies: tuple[BodyDelta, ...] = ()
    key: object = None
    number: int = 0

    @property
    def face_count(self) -> int:
        """How many faces it changed."""
        return sum(delta.count for delta in self.faces)

    @property
    def size(self) -> int:
        """Memory that it takes [bytes]."""
        return STEP_BYTES + sum(delta.size for delta in self.faces) + sum(delta.size for delta in self.bodies)


def face_count_text(count: int) -> str:
    """A number of faces in words."""
    return f"{count:,} face{'' if count == 1 else 's'}"


class History:
    """Steps done and undone.

    Attributes:
        done: steps that can be undone, the oldest first.
        undone: steps that can be done again, the next one last.
    """

    def __init__(self, bytes_max: int = BYTES_MAX) -> None:
        self.done: list[Step] = []
        self.undone: list[Step] = []
        self.bytes_max = bytes_max
        self._size = 0
        self._count = 0
        self._ground = 0  # number of the last step that was forgotten

    def __repr__(self) -> str:
        return f"<History: {len(self.done)} to undo, {len(self.undone)} to redo, {self.size / 1e3:.1f} kB>"

    @property
    def state(self) -> int:
        """A number for where the scene stands: the same again after an undo and a redo."""
        return self.done[-1].number if self.done else self._ground

    @property
    def size(self) -> int:
        """Memory that the steps take [bytes]."""
        return self._size

    def add(self, step: Step) -> None:
        """A step was done: what was undone before cannot be done again."""
        self._size -= sum(s.size for s in self.undone)
        self.undone.clear()
        self.done.append(self._numbered(step))
        self._size += step.size
        forgotten = 0
        while len(self.done) - forgotten > 1 and (self._size > self.bytes_max or len(self.done) - forgotten > STEP_MAX):
            self._size -= self.done[forgotten].size
            self._ground = self.done[forgotten].number
            forgotten += 1
        del self.done[:forgotten]

    def clear(self) -> None:
        """Forget all: where the scene stands is where it began."""
        self.done.clear()
        self.undone.clear()
        self._size = self._ground = 0

    def replace_last(self, step: Step) -> None:
        """The last step went on: it is now this one."""
        self._size += step.size - self.done[-1].size
        self.done[-1] = self._numbered(step)

    def _numbered(self, step: Step) -> Step:
        self._count += 1
        return replace(step, number=self._count)

    def back(self) -> Step | None:
        """The step to undo, or None."""
        if not self.done:
            return None
        self.undone.append(self.done.pop())
        return self.undone[-1]

    def forward(self) -> Step | None:
        """The step to do again, or None."""
        if not self.undone:
            return None
        self.done.append(self.undone.pop())
        return self.done[-1]
