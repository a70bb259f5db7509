"""A scene that is painted in steps that can be undone. Watches report what changed to views and to the hand."""

import threading
from collections.abc import Mapping, Sequence
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
from hapscene.paint.model.mesh import Hit, PaintableMesh, pick
from hapscene.paint.model.visibility import Sight
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import NOTHING, blend, paint_faces, paint_region, parts, set_subfaces
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Volume
from hapscene.scene.scene import Scene

__all__ = ["ERASE", "UNWORN_MAX", "Changes", "Painting", "forget_unworn", "know_default"]


@dataclass(frozen=True, eq=False)
class Changes:
    """What is different since the last look.

    Attributes:
        faces: by index of the body, faces (n,) int64, ascending, whose swatch may be another one.
        swatches: indices of swatches whose numbers, name or colour are others, or that are new.
        shelf: whether the list of the scene's swatches is another one: some came, went, or were renamed.
        bodies: whether some bodies came, went, or have another mesh or name; then `faces` tells of none.
        poses: whether some are elsewhere, or hang on others.
    """

    faces: dict[int, NDArray[np.int64]]
    swatches: tuple[int, ...]
    shelf: bool
    bodies: bool = False
    poses: bool = False

    def __repr__(self) -> str:
        counts = {body: len(faces) for body, faces in self.faces.items()}
        more = "".join(f", the {name}" for name in ("shelf", "bodies", "poses") if getattr(self, name))
        return f"<Changes: faces by body {counts}, swatches {list(self.swatches)}{more}>"

    def __bool__(self) -> bool:
        return bool(self.faces or self.swatches or self.shelf or self.bodies or self.poses)


class Watch:
    """Gathers what changes until it is taken: a bit a face, however long nobody looks."""

    def __init__(self, face_counts: list[int]) -> None:
        self._faces = [np.zeros(count, np.bool_) for count in face_counts]
        self._touched: set[int] = set()
        self._swatches: set[int] = set()
        self._shelf = self._bodies = self._poses = False

    def note_bodies(self, face_counts: list[int]) -> None:
        """There are other bodies."""
        self._faces = [np.zeros(count, np.bool_) for count in face_counts]
        self._touched = set()
        self._bodies = True

    def note_poses(self) -> None:
        """Bodies are elsewhere."""
        self._poses = True

    def note_faces(self, body: int, faces: NDArray[np.integer]) -> None:
        """Faces (n,) of a body were painted."""
        if len(faces):
            self._faces[body][faces] = True
            self._touched.add(body)

    def note_swatch(self, swatch: int, shelf: bool) -> None:
        """A swatch has other numbers, or (`shelf`) is new, gone or renamed."""
        self._swatches.add(swatch)
        self._shelf |= shelf

    def take(self, swatch_count: int) -> Changes:
        """What was gathered; from now on anew."""
        faces = {body: np.flatnonzero(self._faces[body]) for body in sorted(self._touched)}
        for body in self._touched:
            self._faces[body][:] = False
        swatches = tuple(sorted(i for i in self._swatches if i < swatch_count))
        found = Changes(faces, swatches, self._shelf, self._bodies, self._poses)
        self._touched, self._swatches = set(), set()
        self._shelf = self._bodies = self._poses = False
        return found


ERASE: Final = -1
"""In the place of a swatch: each body's default."""

UNWORN_MAX: Final = 4
"""How many meshes that no body wears any more stay prepared [count]: some 0.3 GB each, of a million faces."""


@dataclass(eq=False)
class _OpenStep:
    """A step that goes on: what it is, what it paints with, bodies as they were before, how often it changed faces."""

    what: str
    swatch: int | str
    before: dict[int, Paint] = field(default_factory=dict)
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
        hidden, locked: names of bodies that are not seen, and that stay as they are; neither is painted. Not saved.
        lock: held while anything changes; hold it to read several things that belong together.

    Raises:
        SceneError: a scene without bodies.
    """

    def __init__(self, scene: Scene) -> None:
        if not scene.bodies:
            raise SceneError("the scene has no bodies to paint: add one with scene.add(mesh, name=…)")
        self.scene = scene
        self._made: dict[int, PaintableMesh] = {}
        self.shapes = [self.shape_of(body.mesh) for body in scene.bodies]
        self.hidden: set[str] = set()
        self.locked: set[str] = set()
        for body in scene.bodies:
            know_default(body)
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
        watch = Watch(self._face_counts())
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

    def is_kept(self, body: Body) -> bool:
        """Whether nothing is painted on a body now: it is locked, or hidden."""
        return body.name in self.locked or body.name in self.hidden

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike, seen: bool = False) -> Hit | None:
        """The nearest place on the surface along a ray, met from outside or inside; None where there is none.

        Args:
            origin_W_m: (3,) where it starts [m].
            direction_W: (3,) where it goes, of any length.
            seen: whether what is not drawn, the inside of a one-sided body, is gone through.
        """
        with self.lock:  # a shape has one ray buffer
            there = [i for i, body in enumerate(self.scene.bodies) if body.name not in self.hidden]
            bodies, shapes = [self.scene.bodies[i] for i in there], [self.shapes[i] for i in there]
            hit = pick(bodies, shapes, floats(origin_W_m), floats(direction_W), seen)
            return None if hit is None else replace(hit, body=there[hit.body])

    def sight(self, body: int, eye_W_m: ArrayLike) -> Sight:
        """What is seen of a body from a point (3,) in W [m]."""
        return Sight(self.scene.bodies, self.shapes, body, eye_W_m, self.hidden)

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
            self._put_bodies([(delta.index, delta.new, delta.old) for delta in reversed(step.bodies)])
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
            painted = self.scene.bodies[body]
            if self.is_kept(painted):
                return 0
            swatch = self.swatch_index(self._open.swatch, body)
            other = painted.face_swatch[faces] != swatch
            if painted.fine is not None:
                other |= np.isin(faces, painted.fine.faces)
            faces = faces[other]
            if len(faces):
                self._keep(self._open, body)
                paint_faces(painted, faces, swatch)
                self._note_faces(body, faces)
            return len(faces)

    def paint_region(
        self,
        body: int,
        region: Volume,
        faces: NDArray[np.integer] | None = None,
        falloff_m: float = 0.0,
        opacity: float = 1.0,
        *,
        swatch: int | None = None,
        over: int | None = None,
        eye_W_m: ArrayLike | None = None,
    ) -> int:
        """Paint what a region in a body's frame cuts out of its faces, or of those (n,), in the open step.

        With its swatch, unless another is given; from an eye at a point (3,) in W [m], what is seen of it alone.
        Soft borders, opacity and `over` are those of `hapscene.scene.fine_paint.paint_region`.

        Returns:
            how many faces it reached.

        Raises:
            SceneError: no step is open, or the border needs too many pieces.
        """
        with self.lock:
            if self._open is None:
                raise SceneError("no step to paint in: begin one first")
            painted, step = self.scene.bodies[body], self._open
            if self.is_kept(painted):
                return 0
            before = self._keep(step, body)
            swatch = self.swatch_index(step.swatch if swatch is None else swatch, body)
            sight = None if eye_W_m is None else self.sight(body, eye_W_m)
            if sight is not None:
                faces = sight.facing(np.arange(len(painted.face_swatch)) if faces is None else faces)
            more: dict[str, Any] = {"falloff_m": falloff_m, "opacity": opacity, "over": over, "sight": sight}
            faces = paint_region(painted, region, swatch, faces=faces, **more)
            if len(faces):
                self._note_faces(body, faces)
            elif before is None:
                del step.before[body]
                step.changes -= 1
            return len(faces)

    def replace_swatch(self, body: int, old: int) -> int:
        """Paint what wears a swatch, whole faces and leaves, blends too, in the open step; how many faces it reached.

        Raises:
            SceneError: no step is open.
        """
        with self.lock:
            painted = self.scene.bodies[body]
            if self.is_kept(painted):
                return 0
            leaves = painted.fine or NOTHING
            whole = painted.face_swatch == old
            whole[leaves.faces] = False
            count = self.paint_faces(body, np.flatnonzero(whole))
            heavier, lighter, weight = parts(leaves.paint)
            worn = (heavier == old) | ((lighter == old) & (weight > 0))
            if self._open is not None and worn.any():
                self._keep(self._open, body)
                new, found = self.swatch_index(self._open.swatch, body), leaves.of_faces(np.unique(leaves.face[worn]))
                heavier, lighter, weight = parts(found.paint)
                paint = blend(np.where(heavier == old, new, heavier), np.where(lighter == old, new, lighter), weight)
                set_subfaces(painted, replace(found, paint=paint))
                self._note_faces(body, found.faces)
                count += len(found.faces)
            return count

    def _keep(self, step: _OpenStep, body: int) -> Paint | None:
        """Keep how a body was before a step, unless that is known; what was known."""
        known, painted = step.before.get(body), self.scene.bodies[body]
        if known is None:
            step.before[body] = painted.face_swatch.copy(), painted.fine
        step.changes += 1
        return known

    def end_step(self) -> int:
        """End the open step, if there is one; how many faces it changed."""
        with self.lock:
            step, self._open = self._open, None
            if step is None:
                return 0
            bodies = self.scene.bodies
            found = [FaceDelta.between(body, old, _paint_of(bodies[body])) for body, old in step.before.items()]
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

    def change(
        self,
        what: str,
        swatches: Sequence[SwatchDelta] = (),
        bodies: Sequence[BodyDelta] = (),
        *,
        key: object = None,
        join: bool = False,
    ) -> None:
        """One step: put swatches, then bodies, in this order; with `join`, part of the last step if its key is equal.

        Raises:
            SceneError: no body would be left.
        """
        with self.lock:
            self.end_step()
            if len(self.scene.bodies) + sum((d.old is None) - (d.new is None) for d in bodies) < 1:
                raise SceneError("a scene has one body at least: add another one first")
            last = self.history.done[-1] if self.history.done else None
            step = Step(what, tuple(swatches), bodies=tuple(bodies), key=key)
            self._do(step)
            joins = join and last is not None and last.key == key and not self.history.undone
            if joins and last is not None and [d.index for d in last.bodies] == [d.index for d in bodies]:
                put = tuple(replace(new, old=old.old) for old, new in zip(last.swatches, step.swatches, strict=True))
                moved = tuple(replace(new, old=old.old) for old, new in zip(last.bodies, step.bodies, strict=True))
                self.history.replace_last(replace(step, swatches=put, bodies=moved))
            else:
                self.history.add(step)

    def take_painting(self, scene: Scene, what: str, *, composed: bool = False) -> str:
        """One step: paint as another scene of the same bodies is painted, with its swatches; what the step is called.

        With `composed`, some bodies may be others, or elsewhere, which they are here then.

        Raises:
            SceneError: other bodies.
        """
        with self.lock:
            self.end_step()
            mine, theirs = ([_shape(body) for body in s.bodies] for s in (self.scene, scene))
            shapes = [shape[:2] for shape in mine]
            others = composed and mine != theirs and not set(shapes).isdisjoint(shape[:2] for shape in theirs)
            if not others and [shape[:2] for shape in theirs] != shapes:
                raise SceneError(f"{what}: its bodies are not those of this scene: open it by itself")
            wanted, known = _swatch_states(scene), len(self.swatches)
            changes = [SwatchDelta(i, self.swatches[i], None) for i in reversed(range(len(wanted), known))]
            for i, new in enumerate(wanted):
                old = self.swatches[i] if i < known else None
                if old is None or (old.swatch, old.source) != (new.swatch, new.source):
                    changes.append(SwatchDelta(i, old, new))
            bodies: list[BodyDelta] = []
            found: list[FaceDelta | None] = []
            if not others:
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
                self._do(step)
                self.history.add(step)
            return what

    def _do(self, step: Step) -> None:
        for change in step.swatches:
            self._put_swatch(change.index, change.new)
        self._put_bodies([(delta.index, delta.old, delta.new) for delta in step.bodies])
        for delta in step.faces:
            self._put_faces(delta, back=False)

    def _put_faces(self, delta: FaceDelta, back: bool) -> None:
        self._note_faces(delta.body, delta.put(self.scene.bodies[delta.body], back))

    def _put_bodies(self, changes: Sequence[tuple[int, Body | None, Body | None]]) -> None:
        """Put bodies, each (index, what is there, what comes)."""
        others = False
        for index, old, new in changes:
            bodies = [] if new is None else [new]
            if old is not None and new is not None:  # the same one goes on
                bodies = self.scene.bodies[index : index + 1]
                for name in ("name", "mesh", "X_WB", "parent"):
                    setattr(bodies[0], name, getattr(new, name))
            there = slice(index, index + (old is not None))
            self.scene.bodies[there] = bodies
            self.shapes[there] = [self.shape_of(body.mesh) for body in bodies]
            self.defaults[there] = [body.made_of or 0 for body in bodies]
            others |= old is None or new is None or old.mesh is not new.mesh or old.name != new.name
            for names in (self.hidden, self.locked):
                if old is not None and old.name in names:
                    names.remove(old.name)
                    names |= {body.name for body in bodies}
        if changes:
            forget_unworn(self._made, self.scene.bodies)
            self.scene.pose_count += 1
            for watch in self._watches:
                watch.note_poses()
                if others:
                    watch.note_bodies(self._face_counts())

    def shape_of(self, mesh: Mesh) -> PaintableMesh:
        """A mesh prepared to be painted; the same for all bodies that share it. It takes seconds for a large one."""
        known = self._made.get(id(mesh))
        return known or self._made.setdefault(id(mesh), PaintableMesh(mesh))  # which holds the mesh: its id stays

    def note_marks(self) -> None:
        """Other bodies are hidden, or locked."""
        for watch in self._watches:
            watch.note_poses()

    def _face_counts(self) -> list[int]:
        return [len(body.mesh.faces) for body in self.scene.bodies]

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


def know_default(body: Body) -> None:
    """Have a body that is painted all over with one swatch made of it, if nobody has said of what: the eraser brings
    back the same the next time."""
    if body.made_of is None and (body.face_swatch == body.face_swatch[0]).all():
        body.made_of = int(body.face_swatch[0])


def forget_unworn(made: dict[int, Any], bodies: Sequence[Body]) -> None:
    """Of what was made of meshes, by their ids, keep what bodies wear, and the last few besides: undo may want them."""
    worn = {id(body.mesh) for body in bodies}
    for key in [key for key in list(made) if key not in worn][:-UNWORN_MAX]:
        del made[key]


def _paint_of(body: Body) -> Paint:
    return body.face_swatch, body.fine


def _shape(body: Body) -> tuple[object, ...]:
    """What tells bodies apart, but for their painting."""
    pose = body.X_WB.tobytes()
    return body.name, len(body.mesh.faces), body.mesh.digest, pose, body.two_sided, body.parent


def _swatch_states(scene: Scene) -> list[SwatchState]:
    return [SwatchState(*pair) for pair in zip(scene.swatches, scene.swatch_source, strict=True)]
