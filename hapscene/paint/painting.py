"""A scene that is painted: its faces and swatches change in steps, and whoever watches is told. A `Session`'s ground:
document, tuning and display work on it, and it knows none of them."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError, no_such
from hapscene.geometry import numbers as floats
from hapscene.paint.change_watch import Changes, Watch
from hapscene.paint.history import FaceDelta, History, Step, SwatchDelta, SwatchState, face_count_text
from hapscene.paint.paintable_mesh import Hit, PaintableMesh, pick
from hapscene.scene.scene import Scene

ERASE: Final = -1
"""In the place of a swatch: each body's default."""


@dataclass(eq=False)
class _OpenStep:
    """A step that goes on: what it is, what it paints with, bodies as they were before, how often it changed faces."""

    what: str
    swatch: int | str
    before: dict[int, NDArray[np.int16]] = field(default_factory=dict)
    changes: int = 0


class Painting:
    """A scene whose faces and swatches change in steps that can be undone.

    Attributes:
        scene: painted in place; nobody else should change it meanwhile.
        shapes: of its bodies, in their order; bodies that share a mesh share one.
        defaults: what the eraser brings back, a swatch for each body: what it is made of; where nobody has said, that
            of all its faces at the start, or plain.
        swatches: the scene's swatches, with what `reset` brings back.
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
        self.swatches = _swatch_states(scene)
        self.lock = threading.RLock()
        self._open: _OpenStep | None = None
        self._watches: list[Watch] = []
        self._own_watch = self.watch()

    def __repr__(self) -> str:
        faces = sum(len(body.face_swatch) for body in self.scene.bodies)
        bodies = ", ".join(body.name for body in self.scene.bodies[:3]) + ", …" * (len(self.scene.bodies) > 3)
        return f"<Painting of {bodies}: {faces:,} faces, {len(self.swatches)} swatches>"

    # --- who watches ---

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

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """The nearest place on the surface along a ray, met from outside or inside; None where there is none.

        Args:
            origin_W_m: (3,) where it starts [m].
            direction_W: (3,) where it goes, of any length.
        """
        with self.lock:  # a shape has one ray buffer
            return pick(self.scene.bodies, self.shapes, floats(origin_W_m), floats(direction_W))

    def swatch_index(self, swatch: int | str, body: int = 0) -> int:
        """The swatch that a body is painted with, by its name or index: `ERASE` is its default, any other is itself.

        Raises:
            SceneError: no such swatch.
        """
        if isinstance(swatch, str):
            named = self.swatch_named(swatch)
            if named is None:
                raise SceneError(no_such("swatch", swatch, (known.name for known in self.scene.swatches)))
            return named
        if swatch == ERASE:
            return self.defaults[body]
        if not 0 <= swatch < len(self.scene.swatches):
            raise SceneError(f"no swatch {swatch}; the scene has {len(self.scene.swatches)}, counted from 0")
        return int(swatch)

    def swatch_named(self, name: str) -> int | None:
        """Index of the scene's swatch of that name; None where there is none."""
        names = [swatch.name for swatch in self.scene.swatches]
        return names.index(name) if name in names else None

    def snapshot(self) -> Scene:
        """A copy of the scene as it is now."""
        with self.lock:
            return self.scene.copy()

    # --- undo and redo ---

    def undo(self) -> str | None:
        """Take the last step back, an open one first of all; what it was, or None where there is none."""
        with self.lock:
            self.end_step()
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
            self.end_step()
            step = self.history.forward()
            if step is None:
                return None
            self._do(step)
            return step.what

    @property
    def undo_text(self) -> str | None:
        """What `undo` would take back; None where there is nothing."""
        if self._open is not None and self._open.changes:
            return "stroke"
        return self.history.done[-1].what if self.history.done else None

    @property
    def redo_text(self) -> str | None:
        """What `redo` would do again; None where there is nothing."""
        return self.history.undone[-1].what if self.history.undone else None

    @property
    def state(self) -> tuple[int, int]:
        """Another value whenever the scene is another; the old one when it is again as it was."""
        return self.history.state, self._open.changes if self._open is not None else 0

    # --- steps ---

    def begin_step(self, what: str, swatch: int | str) -> None:
        """Open a step: all that `paint_faces` paints until `end_step`. Whatever else is done ends it.

        Raises:
            SceneError: no such swatch.
        """
        with self.lock:
            self.swatch_index(swatch)
            self.end_step()
            self._open = _OpenStep(what, swatch)

    @property
    def step_is_open(self) -> bool:
        """Whether a step goes on."""
        return self._open is not None

    def paint_faces(self, body: int, faces: NDArray[np.integer]) -> int:
        """Paint faces (n,) of a body in the open step; how many became others.

        Raises:
            SceneError: no step is open.
        """
        with self.lock:
            if self._open is None:
                raise SceneError("no step to paint in: begin one first")
            face_swatch = self.scene.bodies[body].face_swatch
            swatch = self.swatch_index(self._open.swatch, body)
            faces = faces[face_swatch[faces] != swatch]
            if len(faces):
                if body not in self._open.before:
                    self._open.before[body] = face_swatch.copy()
                face_swatch[faces] = swatch
                self._open.changes += 1
                self._note_faces(body, faces)
            return len(faces)

    def end_step(self) -> int:
        """End the open step, if there is one; how many faces it changed."""
        with self.lock:
            step, self._open = self._open, None
            if step is None:
                return 0
            bodies = self.scene.bodies
            found = [FaceDelta.between(body, old, bodies[body].face_swatch) for body, old in step.before.items()]
            deltas = tuple(delta for delta in found if delta is not None)
            count = sum(delta.count for delta in deltas)
            if deltas:
                self.history.add(Step(f"{step.what}, {face_count_text(count)}", faces=deltas))
            return count

    def paint(self, what: str, chosen: Mapping[int, NDArray[np.bool_]], swatch: int | str) -> int:
        """One step: paint faces (M,) bool of bodies; how many became others.

        Raises:
            SceneError: no such swatch.
        """
        with self.lock:
            self.begin_step(what, swatch)
            for body, mask in chosen.items():
                self.paint_faces(body, np.flatnonzero(mask))
            return self.end_step()

    def change_swatch(self, what: str, change: SwatchDelta, key: object = None, join: bool = False) -> None:
        """One step: put a swatch; with `join` a part of the last step, if that has the same key."""
        with self.lock:
            self.end_step()
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
            self.end_step()
            shapes = [(b.name, len(b.mesh.faces)) for b in self.scene.bodies]
            if [(b.name, len(b.mesh.faces)) for b in scene.bodies] != shapes:
                raise SceneError(f"{what}: its bodies are not those of this scene: open it by itself")
            wanted, known = _swatch_states(scene), len(self.swatches)
            changes = [SwatchDelta(i, self.swatches[i], None) for i in reversed(range(len(wanted), known))]
            for i, new in enumerate(wanted):
                old = self.swatches[i] if i < known else None
                if old is None or (old.swatch, old.source) != (new.swatch, new.source):
                    changes.append(SwatchDelta(i, old, new))
            pairs = enumerate(zip(self.scene.bodies, scene.bodies, strict=True))
            found = [FaceDelta.between(body, mine.face_swatch, other.face_swatch) for body, (mine, other) in pairs]
            step = Step(what, tuple(changes), tuple(delta for delta in found if delta is not None))
            if step.swatches or step.faces:
                self._do(step)
                self.history.add(step)
            return what

    def _do(self, step: Step) -> None:
        for change in step.swatches:
            self._put_swatch(change.index, change.new)
        for delta in step.faces:
            self._put_faces(delta, back=False)

    def _put_faces(self, delta: FaceDelta, back: bool) -> None:
        faces, old, new = delta.unpack()
        self.scene.bodies[delta.body].face_swatch[faces] = old if back else new
        self._note_faces(delta.body, faces)

    def _put_swatch(self, index: int, state: SwatchState | None) -> None:
        known = self.swatches[index].swatch.name if index < len(self.swatches) else None
        self.swatches[index:] = [] if state is None else [state, *self.swatches[index + 1 :]]
        self.scene.swatches[:] = [s.swatch for s in self.swatches]
        self.scene.swatch_source[:] = [s.source for s in self.swatches]
        shelf = state is None or known != state.swatch.name
        for watch in self._watches:
            watch.note_swatch(index, shelf)

    def _note_faces(self, body: int, faces: NDArray[np.integer]) -> None:
        for watch in self._watches:
            watch.note_faces(body, faces)


def _swatch_states(scene: Scene) -> list[SwatchState]:
    return [SwatchState(*pair) for pair in zip(scene.swatches, scene.swatch_source, strict=True)]
