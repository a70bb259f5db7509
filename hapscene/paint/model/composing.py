"""Add, copy, delete, move, scale and attach bodies of a painted scene; each is a step that can be undone."""

import math
import re
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.geometry import rigid
from hapscene.paint.model.history import BodyDelta, SwatchDelta, SwatchState
from hapscene.paint.model.painting import Painting, know_default
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import blend, parts
from hapscene.scene.mesh import SIZE_M, Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import BODY_MAX

__all__ = ["Composing", "numbered"]

JOIN_S: Final = 1.0
"""Moves of one body that follow each other so soon are one step [s]."""

GAP_SHARE: Final = 0.1
"""Room between a body that is added and those that are there, in its longest side [1]."""

FAR: Final = 10.0
"""How far from all others a body that is added may be, in the longest side of the scene or its own [1]: what is farther
was never meant to be seen with them."""


def numbered(name: str, taken: Collection[str]) -> str:
    """A name that is free: itself, or with the number after the highest taken: "plate", "plate 2", "plate 3"."""
    if name not in taken:
        return name
    stem = re.sub(r"[ _]\d{1,6}$", "", name)
    known = (re.fullmatch(r"[ _](\d{1,6})", other.removeprefix(stem)) for other in taken if other.startswith(stem))
    return f"{stem} {max([1, *(int(match[1]) for match in known if match)]) + 1}"


class Composing:
    """The bodies of a painting: what comes, goes, moves, and hangs on what.

    Args:
        painting: whose bodies they are.

    Attributes:
        clock: tells which moves follow each other soon, and are one step [s].
    """

    def __init__(self, painting: Painting) -> None:
        self._painting = painting
        self.clock: Callable[[], float] = time.monotonic
        self._moved_s = -math.inf
        self._scaled: dict[int, tuple[Mesh, float]] = {}  # by id of a scaled mesh: what it was made of, and how
        self._made: dict[tuple[int, float], Mesh] = {}

    def __repr__(self) -> str:
        bodies = self._painting.scene.bodies
        hanging = sum(body.parent is not None for body in bodies)
        return f"<Composing: {len(bodies)} bodies, {hanging} of them hanging on others>"

    def index(self, body: str) -> int:
        """Index of a body.

        Raises:
            SceneError: no such name.
        """
        scene = self._painting.scene
        return scene.bodies.index(scene.body(body))

    def tree(self) -> list[tuple[Body, int]]:
        """All bodies, each before those that hang on it, and how deep they hang."""
        with self._painting.lock:
            bodies = self._painting.scene.bodies
            names = {body.name for body in bodies}
            hanging: dict[str | None, list[Body]] = {}
            for body in bodies:
                hanging.setdefault(body.parent if body.parent in names else None, []).append(body)
            found: list[tuple[Body, int]] = []
            waiting = [(body, 0) for body in reversed(hanging.get(None, []))]
            while waiting:
                body, depth = waiting.pop()
                found.append((body, depth))
                waiting += [(child, depth + 1) for child in reversed(hanging.get(body.name, []))]
            return found

    # --- what comes and goes ---

    def add(self, scene: Scene, *, beside: bool = True, what: str = "") -> list[str]:
        """Add the bodies of another scene, with their swatches and painting, as one step; the names they have here.

        Args:
            scene: taken over: nobody else should go on with it.
            beside: put them beside those that are there, standing as low, where they would be in one another, or far.
            what: the step, in words; without it, whose they are.

        Raises:
            SceneError: too many bodies.
        """
        with self._painting.lock:
            mine = self._painting.scene
            count = len(mine.bodies)
            if not scene.bodies or count + len(scene.bodies) > BODY_MAX:
                raise SceneError(f"{len(scene.bodies):,} bodies cannot be added; a scene holds at most {BODY_MAX:,}")
            index, swatches = self._swatches_of(scene)
            step = _room_beside(scene.bodies, mine.bodies) if beside else np.zeros(3)
            taken = {body.name for body in mine.bodies}
            names: dict[str, str] = {}
            for body in scene.bodies:
                names[body.name] = numbered(body.name, taken)
                taken.add(names[body.name])
            for body in scene.bodies:
                body.name = names[body.name]
                body.parent = None if body.parent is None else names.get(body.parent, body.parent)
                know_default(body)
                body.made_of = None if body.made_of is None else int(index[body.made_of])
                body.face_swatch = index[body.face_swatch]
                if body.fine is not None:
                    one, other, weight = parts(body.fine.paint)
                    body.fine = replace(body.fine, paint=blend(index[one], index[other], weight))
                body.X_WB = body.X_WB.copy()
                body.X_WB[:3, 3] += step
            deltas = [BodyDelta(count + i, None, body) for i, body in enumerate(scene.bodies)]
            added = list(names.values())
            self._painting.change(what or f"add {_told(added)}", swatches, deltas)
            return added

    def copy(self, body: str) -> str:
        """Copy a body, with those that hang on it, beside itself: they share their meshes; the name of the copy."""
        with self._painting.lock:
            scene = self._painting.scene
            one = scene.body(body)
            copies = Scene()
            copies.swatches[:], copies.swatch_source[:] = scene.swatches, scene.swatch_source
            copies.bodies = [replace(b, face_swatch=b.face_swatch.copy()) for b in (one, *scene.descendants(body))]
            return self.add(copies, what=f"copy {body!r}")[0]

    def delete(self, body: str) -> None:
        """Take a body away; those that hang on it hang on what it hung on.

        Raises:
            SceneError: it is the last one, or locked.
        """
        with self._painting.lock:
            one = self._free(body)
            deltas = [self._other(child, parent=one.parent) for child in self._children(body)]
            deltas.append(BodyDelta(self.index(body), one, None))
            self._painting.change(f"delete {body!r}", (), deltas)

    # --- what they are called, and hang on ---

    def rename(self, body: str, name: str) -> None:
        """Give a body another name.

        Raises:
            SceneError: it is taken, or no printable text; or the body is locked.
        """
        with self._painting.lock:
            one = self._free(body)
            if name == body:
                return
            if not name.strip() or not name.isprintable():
                raise SceneError(f"a body's name is a printable text, not {name!r}")
            if any(other.name == name for other in self._painting.scene.bodies):
                raise SceneError(f"a body {name!r} is in the scene already; names are unique")
            deltas = [self._other(child, parent=name) for child in self._children(body)]
            self._painting.change(f"rename {body!r}", (), [self._other(one, name=name), *deltas])

    def hang(self, body: str, parent: str | None) -> None:
        """Hang a body on another, with which it moves; None takes it off. It stays where it is.

        Raises:
            SceneError: the parent is the body itself, or hangs on it; or the body is locked.
        """
        with self._painting.lock:
            one = self._free(body)
            trial = Scene()
            trial.bodies = [replace(other) for other in self._painting.scene.bodies]
            trial.attach(body, parent)  # refuses
            if parent != one.parent:
                what = f"take {body!r} off" if parent is None else f"hang {body!r} on {parent!r}"
                self._painting.change(what, (), [self._other(one, parent=parent)])

    # --- where they are, and how large ---

    def begin_move(self) -> None:
        """What is moved next is a step of its own, however soon it follows."""
        self._moved_s = -math.inf

    def move(self, body: str, X_WB: ArrayLike, *, goes_on: bool = False) -> None:
        """Put a body at a pose X_WB (4, 4), and those that hang on it with it.

        Args:
            body: which.
            X_WB: its pose.
            goes_on: part of the step before, if that moved it too, however long ago; else within a second.

        Raises:
            SceneError: the pose is not rigid, or the body locked.
        """
        with self._painting.lock:
            one = self._free(body)
            X_WB = rigid(X_WB, f"body {body!r}")
            if np.array_equal(X_WB, one.X_WB):
                return
            step = X_WB @ np.linalg.inv(one.X_WB)
            hanging = self._painting.scene.descendants(body)
            deltas = [self._other(b, X_WB=rigid(step @ b.X_WB, f"body {b.name!r}")) for b in hanging]
            now_s, first = self.clock(), self._moved_s == -math.inf
            join, self._moved_s = not first and (goes_on or now_s - self._moved_s <= JOIN_S), now_s
            deltas.insert(0, self._other(one, X_WB=X_WB))
            self._painting.change(f"move {body!r}", (), deltas, key=("move", body), join=join)

    def scale_of(self, body: str) -> float:
        """How many times as large as in its file a body is."""
        mesh = self._painting.scene.body(body).mesh
        return self._scaled.get(id(mesh), (None, mesh.scale))[1]

    def scale(self, body: str, factor: float, *, beside: bool = False) -> None:
        """Make a body `factor` times as large as it is, its middle where it was.

        With `beside`, that of its foot is where it was which is nearest to the other bodies: a factor of thousands
        takes it neither into them nor away.

        Raises:
            SceneError: as `scaled_mesh`.
        """
        with self._painting.lock:
            one, mesh = self._free(body), self.scaled_mesh(body, factor)
            if mesh is one.mesh:
                return
            X_WB = one.X_WB.copy()
            kept_B_m = self._near_others_B_m(one) if beside else one.mesh.bounds_m.mean(axis=0)
            X_WB[:3, 3] += X_WB[:3, :3] @ ((1 - factor) * kept_B_m)
            now_s = self.clock()
            join, self._moved_s = now_s - self._moved_s <= JOIN_S, now_s
            delta = self._other(one, mesh=mesh, X_WB=X_WB)
            self._painting.change(f"scale {body!r}", (), [delta], key=("scale", body), join=join)

    def _near_others_B_m(self, body: Body) -> NDArray[np.float64]:
        """The place (3,) of a body's box, in its frame, that is nearest to the middle below all others."""
        low, high = _box(body)
        boxes = np.array([_box(other) for other in self._painting.scene.bodies if other is not body] or [(low, high)])
        there = np.append((boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0))[:2] / 2, boxes[:, 0, 2].min())
        return np.asarray((np.clip(there, low, high) - body.X_WB[:3, 3]) @ body.X_WB[:3, :3])

    def scaled_mesh(self, body: str, factor: float) -> Mesh:
        """The mesh that `scale` gives a body; may be asked for before, in any thread: it takes seconds for a large one.

        Raises:
            SceneError: it would be too small or too large, its file has other faces by now, or the body is locked.
        """
        mesh, (low, high) = self._free(body).mesh, SIZE_M
        if not (math.isfinite(factor) and factor > 0.0 and low <= factor * mesh.diagonal_m <= high):
            raise SceneError(f"body {body!r}: a scale is above 0, and leaves it {low:g} to {high:g} m large")
        whole, known = self._scaled.get(id(mesh), (mesh, mesh.scale))
        total = float(f"{known * factor:.12g}")  # there and back is the same again
        key = id(whole), total
        if total == whole.scale:
            return whole
        if key not in self._made:
            if whole.path is not None and whole.scale != 1.0:  # to the bit as the scene file will have it
                made = load_mesh(whole.path, whole.unit, up=whole.up, scale=total)
                if not np.array_equal(made.faces, whole.faces):
                    raise SceneError(f"{whole.path}: has other faces than body {body!r}: it was changed meanwhile")
            else:
                scale = whole.scale if whole.path is None else total
                made = replace(whole, vertices_m=total / whole.scale * whole.vertices_m, scale=scale)
            self._made[key] = made
            self._scaled[id(made)] = whole, total
        return self._made[key]

    # --- what is seen, and what stays; not kept in the scene ---

    def hide(self, body: str, hidden: bool = True) -> None:
        """Hide a body, or show it again: it is neither seen nor painted; it is felt as ever."""
        self._mark(self._painting.hidden, [body], hidden)

    def isolate(self, body: str | None) -> None:
        """See one body alone, with those that hang on it; None shows all."""
        with self._painting.lock:
            scene, hidden = self._painting.scene, self._painting.hidden
            shown = scene.bodies if body is None else [scene.body(body), *scene.descendants(body)]
            names = {other.name for other in shown}
            hidden.clear()
            self._mark(hidden, [b.name for b in scene.bodies if b.name not in names], True)

    def lock(self, body: str, locked: bool = True) -> None:
        """Have a body stay as it is, or let it go: it is neither painted nor moved, but along with what it hangs on."""
        self._mark(self._painting.locked, [body], locked)

    def _mark(self, names: set[str], bodies: Iterable[str], marked: bool) -> None:
        with self._painting.lock:
            self._painting.end_step()
            for body in bodies:
                (names.add if marked else names.discard)(self._painting.scene.body(body).name)
            self._painting.note_marks()

    # --- in the small ---

    def _free(self, body: str) -> Body:
        found = self._painting.scene.body(body)
        if body in self._painting.locked:
            raise SceneError(f"body {body!r} is locked: unlock it first")
        return found

    def _children(self, body: str) -> list[Body]:
        return [child for child in self._painting.scene.bodies if child.parent == body]

    def _other(self, body: Body, **changed: object) -> BodyDelta:
        return BodyDelta(self.index(body.name), replace(body), replace(body, **changed))  # type: ignore[arg-type]

    def _swatches_of(self, scene: Scene) -> tuple[NDArray[np.int16], list[SwatchDelta]]:
        """For each swatch of a scene its index here, and what comes for that."""
        trial, count = self._painting.scene.copy(), len(self._painting.scene.swatches)
        index = []
        for swatch, source in zip(scene.swatches, scene.swatch_source, strict=True):
            try:
                index.append(trial.swatch_index(swatch))
            except SceneError:  # another one of that name
                index.append(trial.swatch_index(replace(swatch, name=numbered(swatch.name, _names(trial)))))
                source = None
            if index[-1] == len(trial.swatches) - 1 >= count:
                trial.swatch_source[-1] = source
        new = list(zip(trial.swatches, trial.swatch_source, strict=True))[count:]
        deltas = [SwatchDelta(count + i, None, SwatchState(*pair)) for i, pair in enumerate(new)]
        return np.array(index, np.int16), deltas


def _names(scene: Scene) -> list[str]:
    return [swatch.name for swatch in scene.swatches]


def _told(names: list[str]) -> str:
    return f"{names[0]!r}" + (f" and {len(names) - 1} more" if len(names) > 1 else "")


def _box(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner of a body where it is [m]."""
    places_m = body.mesh.vertices_m @ body.X_WB[:3, :3].T
    return places_m.min(axis=0) + body.X_WB[:3, 3], places_m.max(axis=0) + body.X_WB[:3, 3]


def _room_beside(bodies: list[Body], there: list[Body]) -> NDArray[np.float64]:
    """How far (3,) bodies go to be beside those that are there [m]; nowhere, where they are near, and in none."""
    boxes, mine = (np.array([_box(body) for body in some]) for some in (there, bodies))
    low, high = mine[:, 0].min(axis=0), mine[:, 1].max(axis=0)
    all_low, all_high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    far_m = FAR * max(float((all_high - all_low).max()), float((high - low).max()))
    inside = ((boxes[:, 0] < high) & (boxes[:, 1] > low)).all(axis=1).any()
    if not inside and max(float((all_low - high).max()), float((low - all_high).max())) <= far_m:
        return np.zeros(3)
    step = (all_low + all_high - low - high) / 2
    step[0] = all_high[0] - low[0] + GAP_SHARE * float((high - low).max())
    step[2] = all_low[2] - low[2]
    return np.asarray(step)
