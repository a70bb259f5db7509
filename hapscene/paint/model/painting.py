"""A painted scene: steps that can be undone, and a record of changes for the view and the simulated hand."""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError, no_such
from hapscene.geometry import numbers as floats
from hapscene.paint.model.history import (
    BodyDelta,
    FaceDelta,
    History,
    Paint,
    Step,
    SwatchDelta,
    SwatchState,
    face_count_text,
)
from hapscene.paint.model.mesh import Hit, PaintableMesh, Visibility, pick
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import paint_faces, paint_region
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Region
from hapscene.scene.scene import Scene

__all__ = ["ERASE", "UNUSED_MESHES_MAX", "Changes", "Painting", "drop_unused_meshes", "set_default_swatch"]


@dataclass(frozen=True, eq=False)
class Changes:
    """Changes of a painting since the last call of `Painting.changes`.

    Attributes:
        faces: by index of the body, faces (n,) int64, ascending, whose painting may have changed.
        swatches: indices of swatches that are new or whose parameters, name or colour changed.
        swatch_list: whether swatches of the scene were added, removed or renamed.
        bodies: whether bodies were added, deleted or renamed, or have another mesh; `faces` is empty then.
        poses: whether bodies were moved, attached or hidden.
    """

    faces: dict[int, NDArray[np.int64]]
    swatches: tuple[int, ...]
    swatch_list: bool
    bodies: bool = False
    poses: bool = False

    def __bool__(self) -> bool:
        return bool(self.faces or self.swatches or self.swatch_list or self.bodies or self.poses)


ERASE: Final = -1
"""Index that stands for the default swatch of each body."""

JOIN_S: Final = 1.0
"""Longest pause between changes of a slider, or moves of a body, that are undone together [s]."""

UNUSED_MESHES_MAX: Final = 4
"""Number of prepared meshes kept although no body uses them any more [count]: about 0.3 GB each for a million faces."""


@dataclass(eq=False)
class _OpenStep:
    """A step in progress.

    Attributes:
        what: description for the user.
        swatch: swatch that it paints with.
        before: painting of each changed body before the step.
        changes: number of changes so far.
    """

    what: str
    swatch: int | str
    before: dict[int, Paint] = field(default_factory=dict)
    changes: int = 0


class Painting:
    """A scene whose faces, swatches and bodies change in steps that can be undone.

    Attributes:
        scene: the scene, changed in place; do not change it elsewhere.
        shapes: prepared meshes of the bodies, in their order; bodies with the same mesh share one.
        defaults: swatch of each body that the eraser restores: `Body.made_of`, or the swatch of all its faces at the
            start, or plain.
        swatches: the scene's swatches and where they were loaded from.
        history: steps that can be undone and redone.
        hidden: names of hidden bodies, which are not painted. Not saved with the scene.
        lock: held during each change; hold it to read several values consistently.
        clock: returns the time by which successive changes are joined into one step [s].

    Raises:
        SceneError: the scene has no bodies.
    """

    def __init__(self, scene: Scene) -> None:
        if not scene.bodies:
            raise SceneError("the scene has no bodies: add one with scene.add(mesh, name=…)")
        self.scene = scene
        self._made: dict[int, PaintableMesh] = {}
        self.shapes = [self.shape_of(body.mesh) for body in scene.bodies]
        self.hidden: set[str] = set()
        for body in scene.bodies:
            set_default_swatch(body)
        self.defaults = [body.made_of or 0 for body in scene.bodies]
        self.history = History()
        self.swatches = _swatch_states(scene)
        self.lock = threading.RLock()
        self.clock: Callable[[], float] = time.monotonic
        self._changed_s = -math.inf
        self._open: _OpenStep | None = None
        self._changed_swatches: set[int] = set()
        self._list_changed = self._bodies_changed = self._poses_changed = False
        self._reset_changed_faces()

    # --- record of changes ---

    def changes(self) -> Changes:
        """Changes since the last call, for the view."""
        with self.lock:
            faces = {body: np.flatnonzero(self._changed_faces[body]) for body in sorted(self._painted_bodies)}
            swatches = tuple(sorted(i for i in self._changed_swatches if i < len(self.scene.swatches)))
            found = Changes(faces, swatches, self._list_changed, self._bodies_changed, self._poses_changed)
            self._changed_swatches.clear()
            self._list_changed = self._bodies_changed = self._poses_changed = False
            for body in self._painted_bodies:
                self._changed_faces[body][:] = False
            self._painted_bodies.clear()
            return found

    def note_poses(self) -> None:
        """Record that bodies were moved, attached or hidden."""
        self._poses_changed = True

    def _note_faces(self, body: int, faces: NDArray[np.integer]) -> None:
        if len(faces):
            self._changed_faces[body][faces] = True
            self._painted_bodies.add(body)

    def _reset_changed_faces(self) -> None:
        self._changed_faces = [np.zeros(len(body.mesh.faces), np.bool_) for body in self.scene.bodies]
        self._painted_bodies: set[int] = set()

    # --- queries ---

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike, visible_only: bool = False) -> Hit | None:
        """The nearest point on the surface along a ray; None without a hit. Hidden bodies are ignored.

        Args:
            origin_W_m: (3,) origin of the ray [m].
            direction_W: (3,) direction of the ray, of any length.
            visible_only: ignore back faces of one-sided bodies, which are not drawn.
        """
        with self.lock:  # a shape has one ray buffer
            shown = [i for i, body in enumerate(self.scene.bodies) if body.name not in self.hidden]
            bodies, shapes = [self.scene.bodies[i] for i in shown], [self.shapes[i] for i in shown]
            hit = pick(bodies, shapes, floats(origin_W_m), floats(direction_W), visible_only)
            return None if hit is None else replace(hit, body=shown[hit.body])

    def swatch_index(self, swatch: int | str, body: int = 0) -> int:
        """Index of a swatch, given by name or index; `ERASE` is the default swatch of the body.

        Raises:
            SceneError: the scene has no such swatch.
        """
        if isinstance(swatch, str):
            named = self.swatch_named(swatch)
            if named is None:
                raise SceneError(no_such("swatch", swatch, (known.name for known in self.scene.swatches)))
            return named
        if swatch == ERASE:
            return self.defaults[body]
        if not 0 <= swatch < len(self.scene.swatches):
            count = len(self.scene.swatches)
            raise SceneError(f"swatch index {swatch} is out of range: expected 0 to {count - 1}")
        return int(swatch)

    def swatch_named(self, name: str) -> int | None:
        """Index of the scene's swatch with that name; None if it does not exist."""
        names = [swatch.name for swatch in self.scene.swatches]
        return names.index(name) if name in names else None

    def snapshot(self) -> Scene:
        """A copy of the present scene."""
        with self.lock:
            return self.scene.copy()

    # --- undo and redo ---

    def undo(self) -> str | None:
        """Undo the last step, including one in progress; returns its description, or None if it does not exist."""
        with self.lock:
            self.end_step()
            step = self.history.undo()
            if step is None:
                return None
            for delta in reversed(step.faces):
                self._apply_faces(delta, undo=True)
            self._apply_bodies([(delta.index, delta.new, delta.old) for delta in reversed(step.bodies)])
            for change in reversed(step.swatches):
                self._set_swatch(change.index, change.old)
            return step.what

    def redo(self) -> str | None:
        """Redo the step undone last; returns its description, or None if it does not exist."""
        with self.lock:
            self.end_step()
            step = self.history.redo()
            if step is None:
                return None
            self._apply(step)
            return step.what

    @property
    def undo_text(self) -> str | None:
        """Description of the step that `undo` would revert; None if it does not exist."""
        if self._open is not None and self._open.changes:
            return "stroke"
        return self.history.done[-1].what if self.history.done else None

    @property
    def redo_text(self) -> str | None:
        """Description of the step that `redo` would apply; None if it does not exist."""
        return self.history.undone[-1].what if self.history.undone else None

    @property
    def state(self) -> tuple[int, int]:
        """Identifies the state of the scene: equal states after undo and redo have equal values."""
        return self.history.state, self._open.changes if self._open is not None else 0

    # --- steps ---

    def begin_step(self, what: str, swatch: int | str) -> object:
        """Begin a step that collects all painting until `end_step`, and return it. Any other operation ends it, too.

        Args:
            what: description for the user.
            swatch: name or index of the swatch to paint with.

        Raises:
            SceneError: the scene has no such swatch.
        """
        with self.lock:
            self.swatch_index(swatch)
            self.end_step()
            self._open = _OpenStep(what, swatch)
            return self._open

    @property
    def open_step(self) -> object:
        """The step in progress; None if it does not exist."""
        return self._open

    def paint_faces(self, body: int, faces: NDArray[np.integer]) -> int:
        """Paint faces (n,) of a body in the open step; returns the number of faces that changed.

        Raises:
            SceneError: no step is open.
        """
        with self.lock:
            step = self._open_step()
            painted = self.scene.bodies[body]
            if painted.name in self.hidden:
                return 0
            swatch = self.swatch_index(step.swatch, body)
            differs = painted.face_swatch[faces] != swatch
            if painted.fine is not None:
                differs |= np.isin(faces, painted.fine.faces)
            faces = faces[differs]
            if len(faces):
                self._keep_before(step, body)
                paint_faces(painted, faces, swatch)
                self._note_faces(body, faces)
            return len(faces)

    def paint_region(
        self,
        body: int,
        region: Region,
        faces: NDArray[np.integer] | None = None,
        falloff_m: float = 0.0,
        opacity: float = 1.0,
        *,
        eye_W_m: ArrayLike | None = None,
    ) -> int:
        """Paint the part of a body that is inside a region, in the open step; returns the number of faces reached.

        Args:
            body: index of the body.
            region: region in the body's frame.
            faces: (n,) restrict painting to these faces; None for all.
            falloff_m: width of the soft border [m]; see `hapscene.scene.fine_paint.paint_region`.
            opacity: weight of the swatch over the present painting [0, 1].
            eye_W_m: (3,) paint only what is visible from this point [m]; None to ignore occlusion.

        Raises:
            SceneError: no step is open, or the border needs too many subfaces.
        """
        with self.lock:
            step = self._open_step()
            painted = self.scene.bodies[body]
            if painted.name in self.hidden:
                return 0
            before = self._keep_before(step, body)
            swatch = self.swatch_index(step.swatch, body)
            sight = None if eye_W_m is None else Visibility(self.scene.bodies, self.shapes, body, eye_W_m, self.hidden)
            if sight is not None:
                faces = sight.facing(np.arange(len(painted.face_swatch)) if faces is None else faces)
            faces = paint_region(
                painted, region, swatch, falloff_m=falloff_m, opacity=opacity, faces=faces, sight=sight
            )
            if len(faces):
                self._note_faces(body, faces)
            elif before is None:
                del step.before[body]
                step.changes -= 1
            return len(faces)

    def _open_step(self) -> _OpenStep:
        if self._open is None:
            raise SceneError("there is no open step to paint in: call begin_step first")
        return self._open

    def _keep_before(self, step: _OpenStep, body: int) -> Paint | None:
        """Store the painting of a body before the step changes it first; returns what was stored already."""
        known, painted = step.before.get(body), self.scene.bodies[body]
        if known is None:
            step.before[body] = painted.face_swatch.copy(), painted.fine
        step.changes += 1
        return known

    def end_step(self) -> int:
        """End the step in progress, if any; returns the number of faces that it changed."""
        with self.lock:
            step, self._open = self._open, None
            if step is None:
                return 0
            bodies = self.scene.bodies
            found = [FaceDelta.between(body, old, _paint_of(bodies[body])) for body, old in step.before.items()]
            deltas = tuple(delta for delta in found if delta is not None)
            count = sum(delta.count for delta in deltas)
            if deltas:
                new, last = Step(f"{step.what}, {face_count_text(count)}", faces=deltas), self.history.done[-1:]
                if last and last[0].key == ("add", self.swatch_index(step.swatch)):  # added for this step
                    self.history.replace_last(replace(new, swatches=last[0].swatches))
                else:
                    self.history.add(new)
            return count

    def paint(self, what: str, chosen: Mapping[int, NDArray[np.bool_]], swatch: int | str) -> int:
        """Paint masks of faces (M,) bool, by body, in one step; returns the number of faces that changed.

        Raises:
            SceneError: the scene has no such swatch.
        """
        with self.lock:
            self.begin_step(what, swatch)
            for body, mask in chosen.items():
                self.paint_faces(body, np.flatnonzero(mask))
            return self.end_step()

    def change(
        self,
        what: str,
        swatches: Sequence[SwatchDelta] = (),
        bodies: Sequence[BodyDelta] = (),
        *,
        key: object = None,
        goes_on: bool = False,
    ) -> None:
        """Change swatches, then bodies, in one step.

        Args:
            what: description for the user.
            swatches, bodies: changes, applied in this order.
            key: extend the last step, if it has the same key and is at most `JOIN_S` old; None to add a step.
            goes_on: extend the last step, if it has the same key, however old it is.

        Raises:
            SceneError: no body would be left.
        """
        with self.lock:
            self.end_step()
            if len(self.scene.bodies) + sum((d.old is None) - (d.new is None) for d in bodies) < 1:
                raise SceneError("cannot delete the last body: add another body first")
            last = self.history.done[-1] if self.history.done else None
            step = Step(what, tuple(swatches), bodies=tuple(bodies), key=key)
            self._apply(step)
            now_s = self.clock()
            recent, self._changed_s = goes_on or now_s - self._changed_s <= JOIN_S, now_s
            joins = key is not None and recent and not self.history.undone and last is not None and last.key == key
            if joins and last is not None and [d.index for d in last.bodies] == [d.index for d in bodies]:
                put = tuple(replace(new, old=old.old) for old, new in zip(last.swatches, step.swatches, strict=True))
                moved = tuple(replace(new, old=old.old) for old, new in zip(last.bodies, step.bodies, strict=True))
                self.history.replace_last(replace(step, swatches=put, bodies=moved))
            else:
                self.history.add(step)

    def replay(self, steps: Sequence[Step]) -> None:
        """Do steps of an earlier session again."""
        with self.lock:
            for step in steps:
                self._apply(step)
                self.history.add(step)

    def take_painting(self, scene: Scene, what: str) -> str:
        """Take over the painting, the swatches and the bodies of another state of this scene, in one step.

        Args:
            scene: the other scene.
            what: description for the user, which is returned.

        Raises:
            SceneError: the scenes have no body in common.
        """
        with self.lock:
            self.end_step()
            mine, theirs = ([_shape(body) for body in s.bodies] for s in (self.scene, scene))
            shapes = [shape[:2] for shape in mine]
            differ = mine != theirs and not set(shapes).isdisjoint(shape[:2] for shape in theirs)
            if not differ and [shape[:2] for shape in theirs] != shapes:
                raise SceneError(f"{what}: the bodies differ from those of this scene: open that scene instead")
            wanted, known = _swatch_states(scene), len(self.swatches)
            changes = [SwatchDelta(i, self.swatches[i], None) for i in reversed(range(len(wanted), known))]
            for i, new in enumerate(wanted):
                old = self.swatches[i] if i < known else None
                if old != new:
                    changes.append(SwatchDelta(i, old, new))
            bodies: list[BodyDelta] = []
            found: list[FaceDelta | None] = []
            if not differ:
                pairs = enumerate(zip(self.scene.bodies, scene.bodies, strict=True))
                found = [FaceDelta.between(body, _paint_of(mine), _paint_of(other)) for body, (mine, other) in pairs]
            else:
                own = {id(body.mesh): body.mesh for body in self.scene.bodies}
                known_mesh = {mesh.digest: mesh for mesh in own.values()}
                for body in scene.bodies:
                    body.mesh = known_mesh.setdefault(body.mesh.digest, body.mesh)
                bodies = [BodyDelta(i, body, None) for i, body in reversed([*enumerate(self.scene.bodies)])]
                bodies += [BodyDelta(i, None, body) for i, body in enumerate(scene.bodies)]
            step = Step(what, tuple(changes), tuple(delta for delta in found if delta is not None), tuple(bodies))
            if step.swatches or step.faces or step.bodies:
                self._apply(step)
                self.history.add(step)
            return what

    def _apply(self, step: Step) -> None:
        for change in step.swatches:
            self._set_swatch(change.index, change.new)
        self._apply_bodies([(delta.index, delta.old, delta.new) for delta in step.bodies])
        for delta in step.faces:
            self._apply_faces(delta, undo=False)

    def _apply_faces(self, delta: FaceDelta, undo: bool) -> None:
        self._note_faces(delta.body, delta.apply(self.scene.bodies[delta.body], undo))

    def _apply_bodies(self, changes: Sequence[tuple[int, Body | None, Body | None]]) -> None:
        """Replace bodies, each given by index, present body and new body."""
        replaced = False
        for index, old, new in changes:
            bodies = [] if new is None else [new]
            if old is not None and new is not None:  # the body stays: views keep references to it
                bodies = self.scene.bodies[index : index + 1]
                for name in ("name", "mesh", "X_WB", "parent"):
                    setattr(bodies[0], name, getattr(new, name))
            span = slice(index, index + (old is not None))
            self.scene.bodies[span] = bodies
            self.shapes[span] = [self.shape_of(body.mesh) for body in bodies]
            self.defaults[span] = [body.made_of or 0 for body in bodies]
            replaced |= old is None or new is None or old.mesh is not new.mesh or old.name != new.name
            if old is not None and old.name in self.hidden:
                self.hidden.remove(old.name)
                self.hidden |= {body.name for body in bodies}
        if changes:
            drop_unused_meshes(self._made, self.scene.bodies)
            self.scene.pose_count += 1
            self.note_poses()
            if replaced:
                self._bodies_changed = True
                self._reset_changed_faces()

    def shape_of(self, mesh: Mesh) -> PaintableMesh:
        """The prepared form of a mesh, shared by all bodies with that mesh. Takes seconds for a large mesh."""
        known = self._made.get(id(mesh))
        # it refers to the mesh: the id stays valid
        return known or self._made.setdefault(id(mesh), PaintableMesh(mesh))

    def _set_swatch(self, index: int, state: SwatchState | None) -> None:
        known = self.swatches[index].swatch.name if index < len(self.swatches) else None
        self.swatches[index:] = [] if state is None else [state, *self.swatches[index + 1 :]]
        self.scene.swatches[:] = [s.swatch for s in self.swatches]
        self.scene.swatch_source[:] = [s.source for s in self.swatches]
        self._changed_swatches.add(index)
        self._list_changed |= state is None or known != state.swatch.name


def set_default_swatch(body: Body) -> None:
    """Set `Body.made_of` of a body that has one swatch all over, if it is not set, for the eraser."""
    if body.made_of is None and (body.face_swatch == body.face_swatch[0]).all():
        body.made_of = int(body.face_swatch[0])


def drop_unused_meshes(made: dict[int, Any], bodies: Sequence[Body]) -> None:
    """Remove entries (keyed by mesh id) of meshes that no body uses, except the last `UNUSED_MESHES_MAX`, for undo."""
    used = {id(body.mesh) for body in bodies}
    for key in [key for key in list(made) if key not in used][:-UNUSED_MESHES_MAX]:
        del made[key]


def _paint_of(body: Body) -> Paint:
    return body.face_swatch, body.fine


def _shape(body: Body) -> tuple[object, ...]:
    """Everything that identifies a body except its painting."""
    pose = body.X_WB.tobytes()
    return body.name, len(body.mesh.faces), body.mesh.digest, pose, body.two_sided, body.parent


def _swatch_states(scene: Scene) -> list[SwatchState]:
    return [SwatchState(*pair) for pair in zip(scene.swatches, scene.swatch_source, strict=True)]
