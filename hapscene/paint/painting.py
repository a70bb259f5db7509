"""A scene, its history, and who watches it: the part of a session under all operations."""

import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError, no_such
from hapscene.geometry import numbers as floats
from hapscene.paint.change_watch import Changes, Watch
from hapscene.paint.history import FaceDelta, History, HistoryEntry, Step, SwatchDelta, faces_word
from hapscene.paint.paintable_mesh import Hit, PaintableMesh, middle, pick
from hapscene.paint.stroke import Stroke
from hapscene.scene.scene import Scene

__all__ = ["ERASE", "Canvas", "Hit"]

ERASE: Final = -1
"""In the place of a swatch: each body's default."""


class Canvas:
    """A scene whose faces and swatches change in steps.

    Attributes:
        scene: painted in place; nobody else should change it meanwhile.
        shapes: of its bodies, in their order; bodies that share a mesh share one.
        defaults: what the eraser brings back, a swatch for each body: what it is made of; where nobody has said, that
            of all its faces at the start, or plain.
        entries: the scene's swatches, with what `reset` brings back.
        history: what can be undone and done again.
        lock: held while anything changes; hold it to read several things that belong together.

    Raises:
        SceneError: a scene without bodies.
    """

    def __init__(self, scene: Scene) -> None:
        if not scene.bodies:
            raise SceneError("the scene has no bodies to paint: add one with scene.add(mesh, name=…)")
        self.scene = scene
        made: dict[int, PaintableMesh] = {}
        self.shapes = [made.get(id(b.mesh)) or made.setdefault(id(b.mesh), PaintableMesh(b.mesh)) for b in scene.bodies]
        for body in scene.bodies:  # saved: the eraser brings back the same the next time
            if body.made_of is None and (body.face_swatch == body.face_swatch[0]).all():
                body.made_of = int(body.face_swatch[0])
        self.defaults = [body.made_of or 0 for body in scene.bodies]
        self.history = History()
        self.entries = [HistoryEntry(*pair) for pair in zip(scene.swatches, scene.swatch_source, strict=True)]
        self.lock = threading.RLock()
        self._stroke: Stroke | None = None
        self._watches: list[Watch] = []
        self._own_watch = self.watch()
        self._saved = (0, 0)

    # --- who looks ---

    def watch(self) -> Watch:
        """A watch of one's own; `changes_of` it tells what changed since the last time."""
        watch = Watch([len(body.mesh.faces) for body in self.scene.bodies])
        self._watches.append(watch)
        return watch

    def changes(self) -> Changes:
        """What changed since the last call: what a view has to show anew."""
        return self.changes_of(self._own_watch)

    def changes_of(self, watch: Watch) -> Changes:
        """What changed since the last call with this watch, which `watch` made."""
        with self.lock:
            return watch.take(len(self.scene.swatches))

    # --- what is where ---

    def body_index(self, body: int | str) -> int:
        """Index of a body by its name, or as given.

        Raises:
            SceneError: there is none.
        """
        bodies = self.scene.bodies
        if isinstance(body, str):
            names = [b.name for b in bodies]
            if body not in names:
                raise SceneError(no_such("body", body, names))
            return names.index(body)
        if not 0 <= body < len(bodies):
            raise SceneError(f"no body {body}; there are {len(bodies)}, counted from 0")
        return int(body)

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """The nearest place on the surface along a ray, met from outside or inside; None where there is none.

        Args:
            origin_W_m: (3,) where it starts [m].
            direction_W: (3,) where it goes, of any length.
        """
        with self.lock:  # a shape has one ray buffer
            return pick(self.scene.bodies, self.shapes, floats(origin_W_m), floats(direction_W))

    def hit_at(self, body: int | str, face: int) -> Hit:
        """The middle of a face as a place on the surface.

        Raises:
            SceneError: no such body, or face.
        """
        index = self.body_index(body)
        count = len(self.shapes[index].normal)
        if not 0 <= face < count:
            raise SceneError(
                f"no face {face} of body {self.scene.bodies[index].name!r}; its faces are 0 to {count - 1}"
            )
        return middle(self.scene.bodies, self.shapes, index, int(face))

    # --- steps ---

    def undo(self) -> str | None:
        """Take the last step back, a stroke in progress first of all; what it was, or None where there is none."""
        with self.lock:
            self.settle()
            step = self.history.back()
            if step is None:
                return None
            for delta in reversed(step.faces):
                self._put_faces(delta, back=True)
            for change in reversed(step.swatches):
                self._put_swatch(change.index, change.old)
            return step.what

    def redo(self) -> str | None:
        """Do again what was undone last; what it was, or None where there is nothing."""
        with self.lock:
            self.settle()
            step = self.history.forward()
            if step is None:
                return None
            self._do(step)
            return step.what

    @property
    def undo_word(self) -> str | None:
        """What `undo` would take back; None where there is nothing."""
        if self._stroke is not None and self._stroke.moves:
            return "stroke"
        return self.history.done[-1].what if self.history.done else None

    @property
    def redo_word(self) -> str | None:
        """What `redo` would do again; None where there is nothing."""
        return self.history.undone[-1].what if self.history.undone else None

    @property
    def stroking(self) -> bool:
        """Whether a stroke is in progress: whatever else is done ends it."""
        return self._stroke is not None

    @property
    def state(self) -> tuple[int, int]:
        """Another value whenever the scene is another; the old one when it is again as it was."""
        return self.history.state, self._stroke.moves if self._stroke is not None else 0

    @property
    def changed(self) -> bool:
        """Whether the scene is another than it was at first, or saved."""
        return self.state != self._saved

    def mark_saved(self) -> None:
        """The scene as it is now is safe on disk."""
        with self.lock:
            self.settle()
            self._saved = self.state

    def settle(self) -> int:
        """End a stroke in progress, if there is one; how many faces it changed."""
        with self.lock:
            stroke, self._stroke = self._stroke, None
            step = stroke.step() if stroke is not None else None
            if step is None:
                return 0
            self.history.add(step)
            return step.face_count

    # --- how a step is made ---

    def ink(self, swatch: int, body: int) -> int:
        """The swatch that a body is painted with.

        Raises:
            SceneError: no such swatch.
        """
        if swatch == ERASE:
            return self.defaults[body]
        if not 0 <= swatch < len(self.scene.swatches):
            raise SceneError(f"no swatch {swatch}; the scene has {len(self.scene.swatches)}, counted from 0")
        return int(swatch)

    def paint(self, what: str, chosen: Mapping[int, NDArray[np.bool_]], swatch: int) -> int:
        """One step: paint faces (M,) bool of bodies; how many became others."""
        with self.lock:
            self.settle()
            deltas = []
            for body, mask in chosen.items():
                paint = self.scene.bodies[body].face_swatch
                ink = np.int16(self.ink(swatch, body))
                faces = np.flatnonzero(mask & (paint != ink))
                if len(faces):
                    deltas.append(FaceDelta.pack(body, faces, paint[faces], np.full(len(faces), ink)))
                    paint[faces] = ink
                    self.note_faces(body, faces)
            count = sum(delta.count for delta in deltas)
            if deltas:
                self.history.add(Step(f"{what}, {faces_word(count)}", faces=tuple(deltas)))
            return count

    def change_swatch(self, what: str, change: SwatchDelta, key: object = None, join: bool = False) -> None:
        """One step: put a swatch; with `join` a part of the last step, if that has the same key."""
        with self.lock:
            self.settle()
            last = self.history.done[-1] if self.history.done else None
            self._put_swatch(change.index, change.new)
            if join and last is not None and last.key == key and not self.history.undone:
                joined = SwatchDelta(change.index, last.swatches[0].old, change.new)
                self.history.replace_last(Step(what, (joined,), key=key))
            else:
                self.history.add(Step(what, (change,), key=key))

    def take_painting(self, scene: Scene, what: str) -> str:
        """One step: paint as another scene of the same bodies is painted, with its swatches; what the step is called.

        Raises:
            SceneError: other bodies.
        """
        with self.lock:
            self.settle()
            shapes = [(b.name, len(b.mesh.faces)) for b in self.scene.bodies]
            if [(b.name, len(b.mesh.faces)) for b in scene.bodies] != shapes:
                raise SceneError(f"{what}: its bodies are not those of this scene: open it by itself")
            wanted = [HistoryEntry(*pair) for pair in zip(scene.swatches, scene.swatch_source, strict=True)]
            known = len(self.entries)
            changes = [SwatchDelta(i, self.entries[i], None) for i in reversed(range(len(wanted), known))]
            for i, entry in enumerate(wanted):
                old = self.entries[i] if i < known else None
                if old is None or (old.swatch, old.source) != (entry.swatch, entry.source):
                    changes.append(SwatchDelta(i, old, entry))
            deltas = []
            for body, (mine, theirs) in enumerate(zip(self.scene.bodies, scene.bodies, strict=True)):
                faces = np.flatnonzero(mine.face_swatch != theirs.face_swatch)
                if len(faces):
                    deltas.append(FaceDelta.pack(body, faces, mine.face_swatch[faces], theirs.face_swatch[faces]))
            step = Step(what, tuple(changes), tuple(deltas))
            if changes or deltas:
                self._do(step)
                self.history.add(step)
            return what

    def snapshot(self) -> Scene:
        """A copy of the scene as it is now; meshes and swatches, which nobody changes, are shared."""
        with self.lock:
            copy = Scene()
            copy.bodies = [replace(body, face_swatch=body.face_swatch.copy()) for body in self.scene.bodies]
            copy.swatches[:] = self.scene.swatches
            copy.swatch_source[:] = self.scene.swatch_source
            return copy

    def note_faces(self, body: int, faces: NDArray[np.integer]) -> None:
        """Tell all watches of painted faces."""
        for watch in self._watches:
            watch.note_faces(body, faces)

    def _do(self, step: Step) -> None:
        for change in step.swatches:
            self._put_swatch(change.index, change.new)
        for delta in step.faces:
            self._put_faces(delta, back=False)

    def _put_faces(self, delta: FaceDelta, back: bool) -> None:
        faces, old, new = delta.unpack()
        self.scene.bodies[delta.body].face_swatch[faces] = old if back else new
        self.note_faces(delta.body, faces)

    def _put_swatch(self, index: int, entry: HistoryEntry | None) -> None:
        known = self.entries[index].swatch.name if index < len(self.entries) else None
        self.entries[index:] = [] if entry is None else [entry, *self.entries[index + 1 :]]
        self.scene.swatches[:] = [e.swatch for e in self.entries]
        self.scene.swatch_source[:] = [e.source for e in self.entries]
        shelf = entry is None or known != entry.swatch.name
        for watch in self._watches:
            watch.note_swatch(index, shelf)
