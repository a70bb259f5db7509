"""Undo history: compressed differences of faces, swatches and bodies before and after each step."""

import itertools
import zlib
from base64 import b64decode, b64encode
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.io.files import Json
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
    "face_count_text",
    "pack_steps",
    "subface_hashes",
    "unpack_steps",
]

Paint = tuple[NDArray[np.int16], FinePaint | None]
"""Painting of a body: `Body.face_swatch` and `Body.fine`."""

BYTES_MAX: Final = 64 * 1024 * 1024
"""Memory limit of the history [bytes]. A stroke over 5,000 faces takes about 10 kB, filling a body of 330,000 faces
1 kB: thousands of steps fit."""

STEP_MAX: Final = 10_000
"""Largest number of steps that can be undone [count]; limits steps with swatches, whose memory is not counted."""

PACKED_BYTES: Final = 4_000_000
"""Limit of the steps that are autosaved [bytes]; they are written again with every autosave."""

STEP_BYTES: Final = 500
"""Memory of a step without its faces [bytes]."""


@dataclass(frozen=True)
class FaceDelta:
    """Changed faces of a body: indices, and swatches and subfaces before and after, compressed."""

    body: int
    packed: bytes = field(repr=False)
    count: int
    subfaces: tuple[bytes, bytes] = field(default=(b"", b""), repr=False)

    @staticmethod
    def between(body: int, old: Paint, new: Paint) -> "FaceDelta | None":
        """Difference between two paintings of a body; None if they are equal."""
        differs = old[0] != new[0]
        was, now = old[1] or NOTHING, new[1] or NOTHING
        if was is not now:
            differs[changed_faces(was, now)] = True
        faces = np.flatnonzero(differs)
        subfaces = (was.of_faces(faces), now.of_faces(faces)) if was is not now else (NOTHING, NOTHING)
        return FaceDelta.pack(body, faces, old[0][faces], new[0][faces], *subfaces) if len(faces) else None

    @staticmethod
    def pack(
        body: int,
        faces: NDArray[np.integer],
        old: NDArray[np.int16],
        new: NDArray[np.int16],
        was: FinePaint = NOTHING,
        now: FinePaint = NOTHING,
    ) -> "FaceDelta":
        """Compress faces (n,), ascending, their swatches (n,) before and after, and their subfaces."""
        steps = np.diff(faces, prepend=0).astype(np.int32)  # differences are small numbers, which compress well
        content = steps.tobytes() + old.tobytes() + new.tobytes()
        return FaceDelta(body, zlib.compress(content, 1), len(faces), (pack_subfaces(was), pack_subfaces(now)))

    def unpack(self) -> tuple[NDArray[np.int64], NDArray[np.int16], NDArray[np.int16]]:
        """Faces, and their swatches before and after (count,)."""
        content, n = zlib.decompress(self.packed), self.count
        faces = np.cumsum(np.frombuffer(content, np.int32, n), dtype=np.int64)
        return faces, np.frombuffer(content, np.int16, n, 4 * n), np.frombuffer(content, np.int16, n, 6 * n)

    def apply(self, body: Body, undo: bool) -> NDArray[np.int64]:
        """Paint the faces of a body as they were before (`undo`) or after the step; returns the faces."""
        faces, old, new = self.unpack()
        body.face_swatch[faces] = old if undo else new
        fine = (body.fine or NOTHING).with_faces(faces, unpack_subfaces(self.subfaces[0 if undo else 1]))
        body.fine = fine if len(fine) else None
        return faces

    @property
    def size(self) -> int:
        """Memory [bytes]."""
        return len(self.packed) + len(self.subfaces[0]) + len(self.subfaces[1])


def changed_faces(one: FinePaint, other: FinePaint) -> NDArray[np.int32]:
    """Return the faces with different subfaces, ascending."""
    a, b = subface_hashes(one), subface_hashes(other)
    return np.union1d(one.face[~np.isin(a, b)], other.face[~np.isin(b, a)])


def subface_hashes(subfaces: FinePaint) -> NDArray[np.uint64]:
    """A 64-bit hash (k,) of each subface with its paint."""
    found = subfaces.face.astype(np.uint64) << np.uint64(32) | subfaces.path
    for values in (subfaces.level, subfaces.paint):
        found = (found ^ found >> np.uint64(29)) * np.uint64(0x9E3779B97F4A7C15) + values.astype(np.uint64)
    return found * np.uint64(0xBF58476D1CE4E5B9)


def pack_subfaces(subfaces: FinePaint) -> bytes:
    """Compress subfaces."""
    return zlib.compress(b"".join(column.tobytes() for column in subfaces.columns), 1) if len(subfaces) else b""


def unpack_subfaces(packed: bytes) -> FinePaint:
    """Reverse `pack_subfaces`."""
    if not packed:
        return NOTHING
    content, found, at = zlib.decompress(packed), [], 0
    types = [column.dtype for column in NOTHING.columns]
    count = len(content) // sum(kind.itemsize for kind in types)
    for kind in types:
        found.append(np.frombuffer(content, kind, count, at))
        at += count * kind.itemsize
    return FinePaint(*found)


class SwatchState(NamedTuple):
    """A swatch of the scene, and where it was loaded from, as in `Scene.swatch_source`; None if changed here."""

    swatch: Swatch
    source: str | Path | None


@dataclass(frozen=True)
class SwatchDelta:
    """A swatch of the scene before and after a step; None before it is added and after it is removed."""

    index: int
    old: SwatchState | None
    new: SwatchState | None


@dataclass(frozen=True, eq=False)
class BodyDelta:
    """A body of the scene before and after a step; None before it is added and after it is deleted.

    For a body that stays, both are copies with its name, mesh, pose and parent; `FaceDelta` holds its painting.
    """

    index: int
    old: Body | None
    new: Body | None

    @property
    def size(self) -> int:
        """Memory of the step [bytes]; a step that deletes a body stores the body."""
        gone = self.old if self.new is None else None
        return 0 if gone is None else gone.face_swatch.nbytes + gone.mesh.vertices_m.nbytes + gone.mesh.faces.nbytes


@dataclass(frozen=True)
class Step:
    """The changes that one undo reverts.

    Attributes:
        what: description for the user: "brush, 812 faces".
        swatches: applied first and reverted last, since faces refer to them.
        bodies: applied next, in this order.
        faces: changed faces of one or more bodies.
        key: steps with the same key may be joined; None for a step that is never joined.
        number: unique number, set by the history.
    """

    what: str
    swatches: tuple[SwatchDelta, ...] = ()
    faces: tuple[FaceDelta, ...] = ()
    bodies: tuple[BodyDelta, ...] = ()
    key: object = None
    number: int = 0

    @property
    def size(self) -> int:
        """Memory [bytes]."""
        return STEP_BYTES + sum(delta.size for delta in self.faces) + sum(delta.size for delta in self.bodies)


def pack_steps(steps: Sequence[Step]) -> list[Json]:
    """The newest steps as JSON, back to one that changes bodies or parameters; swatches that they add are left out."""
    found: list[Json] = []
    size = 0
    for step in reversed(steps):
        size += step.size
        if size > PACKED_BYTES or step.bodies or any(d.old is not None or d.new is None for d in step.swatches):
            break
        packed = [(d.body, d.count, *(b64encode(b).decode() for b in (d.packed, *d.subfaces))) for d in step.faces]
        found[:0] = [(step.what, packed)] if packed else []
    return found


def unpack_steps(packed: list[Json]) -> list[Step]:
    """Reverse `pack_steps`."""
    return [
        Step(what, faces=tuple(FaceDelta(i, b64decode(a), n, (b64decode(b), b64decode(c))) for i, n, a, b, c in faces))
        for what, faces in packed
    ]


def face_count_text(count: int) -> str:
    """A face count as text: "1 face", "2,000 faces"."""
    return f"{count:,} face{'' if count == 1 else 's'}"


class History:
    """Stacks of steps that can be undone and redone.

    Attributes:
        done: steps that can be undone, oldest first.
        undone: steps that can be redone, the next one last.
    """

    def __init__(self, bytes_max: int = BYTES_MAX) -> None:
        self.done: list[Step] = []
        self.undone: list[Step] = []
        self.bytes_max = bytes_max
        self._size = 0
        self._numbers = itertools.count(1)
        self._base = 0  # number of the newest step that was dropped

    @property
    def state(self) -> int:
        """Identifies the state of the scene; undo followed by redo returns to the same value."""
        return self.done[-1].number if self.done else self._base

    @property
    def size(self) -> int:
        """Memory of all steps [bytes]."""
        return self._size

    def add(self, step: Step) -> None:
        """Add a step that was done. Steps that were undone can no longer be redone."""
        self._size -= sum(s.size for s in self.undone)
        self.undone.clear()
        self.done.append(replace(step, number=next(self._numbers)))
        self._size += step.size
        dropped = 0
        while len(self.done) - dropped > 1 and (self._size > self.bytes_max or len(self.done) - dropped > STEP_MAX):
            self._size -= self.done[dropped].size
            self._base = self.done[dropped].number
            dropped += 1
        del self.done[:dropped]

    def clear(self) -> None:
        """Drop all steps: the present state becomes the initial state."""
        self.done.clear()
        self.undone.clear()
        self._size = self._base = 0

    def replace_last(self, step: Step) -> None:
        """Replace the last step by one that includes further changes."""
        self._size += step.size - self.done[-1].size
        self.done[-1] = replace(step, number=next(self._numbers))

    def undo(self) -> Step | None:
        """Move the last step to `undone` and return it; None if it does not exist."""
        if not self.done:
            return None
        self.undone.append(self.done.pop())
        return self.undone[-1]

    def redo(self) -> Step | None:
        """Move the last undone step back to `done` and return it; None if it does not exist."""
        if not self.undone:
            return None
        self.done.append(self.undone.pop())
        return self.done[-1]
