"""Scene composition: add, copy, delete, rename, move, scale and attach bodies. Each operation can be undone."""

import math
import re
from collections.abc import Collection
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.geometry import rigid
from hapscene.paint.model.history import BodyDelta, SwatchDelta, SwatchState
from hapscene.paint.model.painting import Painting, set_default_swatch
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import blend, parts
from hapscene.scene.mesh import SIZE_M, Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import BODY_MAX

__all__ = ["Composing", "numbered"]

GAP_SHARE: Final = 0.1
"""Gap between an added body and the existing ones, as a fraction of its longest side [1]."""

FAR: Final = 10.0
"""Distance beyond which an added body is moved next to the others, in longest sides of the scene or the body [1]."""


def numbered(name: str, taken: Collection[str]) -> str:
    """The name itself if it is free; else the name with the next free number: "plate", "plate 2", "plate 3"."""
    if name not in taken:
        return name
    stem = re.sub(r"[ _]\d{1,6}$", "", name)
    known = (re.fullmatch(r"[ _](\d{1,6})", other.removeprefix(stem)) for other in taken if other.startswith(stem))
    return f"{stem} {max([1, *(int(match[1]) for match in known if match)]) + 1}"


class Composing:
    """Edits the bodies of a painting.

    Args:
        painting: the painted scene.
    """

    def __init__(self, painting: Painting) -> None:
        self._painting = painting
        self._drag = object()
        self._scaled: dict[int, tuple[Mesh, float]] = {}  # id of a scaled mesh: the unscaled mesh, and the scale
        self._made: dict[tuple[int, float], Mesh] = {}  # id of the unscaled mesh, and the scale: the scaled mesh

    def index(self, body: str) -> int:
        """Index of a body.

        Raises:
            SceneError: the scene has no body of that name.
        """
        scene = self._painting.scene
        return scene.bodies.index(scene.body(body))

    def tree(self) -> list[tuple[Body, int]]:
        """All bodies with their depth in the tree; each parent precedes its children."""
        with self._painting.lock:
            bodies = self._painting.scene.bodies
            names = {body.name for body in bodies}
            children: dict[str | None, list[Body]] = {}
            for body in bodies:
                children.setdefault(body.parent if body.parent in names else None, []).append(body)
            ordered: list[tuple[Body, int]] = []
            stack = [(body, 0) for body in reversed(children.get(None, []))]
            while stack:
                body, depth = stack.pop()
                ordered.append((body, depth))
                stack += [(child, depth + 1) for child in reversed(children.get(body.name, []))]
            return ordered

    # --- add, copy, delete ---

    def add(self, scene: Scene, what: str = "") -> list[str]:
        """Add the bodies of another scene with their swatches and painting, in one step; returns their new names.

        Bodies that would overlap the existing ones or lie far away are moved next to them.

        Args:
            scene: the other scene. It is modified, so the caller must not use it afterwards.
            what: description of the step; by default made of the names.

        Raises:
            SceneError: the scene is empty, or the limit of bodies would be exceeded.
        """
        with self._painting.lock:
            mine = self._painting.scene
            count = len(mine.bodies)
            if not scene.bodies or count + len(scene.bodies) > BODY_MAX:
                raise SceneError(
                    f"cannot add {len(scene.bodies):,} bodies to {count:,}: a scene holds 1 to {BODY_MAX:,} bodies"
                )
            index, swatches = self._swatches_of(scene)
            step = _room_beside(scene.bodies, mine.bodies)
            taken = {body.name for body in mine.bodies}
            names: dict[str, str] = {}
            for body in scene.bodies:
                names[body.name] = numbered(body.name, taken)
                taken.add(names[body.name])
            for body in scene.bodies:
                body.name = names[body.name]
                body.parent = None if body.parent is None else names.get(body.parent, body.parent)
                set_default_swatch(body)
                body.made_of = None if body.made_of is None else int(index[body.made_of])
                body.face_swatch = index[body.face_swatch]
                if body.fine is not None:
                    one, other, weight = parts(body.fine.paint)
                    body.fine = replace(body.fine, paint=blend(index[one], index[other], weight))
                body.X_WB = body.X_WB.copy()
                body.X_WB[:3, 3] += step
            deltas = [BodyDelta(count + i, None, body) for i, body in enumerate(scene.bodies)]
            added = list(names.values())
            more = f" and {len(added) - 1} more" if len(added) > 1 else ""
            self._painting.change(what or f"add {added[0]!r}{more}", swatches, deltas)
            return added

    def copy(self, body: str) -> str:
        """Copy a body and the bodies attached to it, next to the original; returns the name of the copy.

        Copies share the meshes of the originals.
        """
        with self._painting.lock:
            scene = self._painting.scene
            one = scene.body(body)
            copies = Scene()
            copies.swatches[:], copies.swatch_source[:] = scene.swatches, scene.swatch_source
            copies.bodies = [replace(b, face_swatch=b.face_swatch.copy()) for b in (one, *scene.descendants(body))]
            return self.add(copies, what=f"copy {body!r}")[0]

    def delete(self, body: str) -> None:
        """Delete a body; bodies attached to it become attached to its parent.

        Raises:
            SceneError: it is the last body.
        """
        with self._painting.lock:
            one = self._painting.scene.body(body)
            deltas = [self._delta(child, parent=one.parent) for child in self._children(body)]
            deltas.append(BodyDelta(self.index(body), one, None))
            self._painting.change(f"delete {body!r}", (), deltas)

    # --- names and parents ---

    def rename(self, body: str, name: str) -> None:
        """Rename a body.

        Raises:
            SceneError: the name is taken or not printable.
        """
        with self._painting.lock:
            one = self._painting.scene.body(body)
            if name == body:
                return
            if not name.strip() or not name.isprintable():
                raise SceneError(f"invalid body name {name!r}: expected printable text")
            if any(other.name == name for other in self._painting.scene.bodies):
                raise SceneError(f"the scene already has a body {name!r}: choose another name")
            deltas = [self._delta(child, parent=name) for child in self._children(body)]
            self._painting.change(f"rename {body!r}", (), [self._delta(one, name=name), *deltas])

    def attach(self, body: str, parent: str | None) -> None:
        """Attach a body to a parent, so that it moves with it; None detaches it. The pose does not change.

        Raises:
            SceneError: the parent is the body itself or one of its descendants.
        """
        with self._painting.lock:
            one = self._painting.scene.body(body)
            trial = Scene()
            trial.bodies = [replace(other) for other in self._painting.scene.bodies]
            trial.attach(body, parent)  # raises on a cycle
            if parent != one.parent:
                what = f"detach {body!r}" if parent is None else f"attach {body!r} to {parent!r}"
                self._painting.change(what, (), [self._delta(one, parent=parent)])

    # --- pose and size ---

    def begin_move(self) -> None:
        """Start a new undo step with the next move, however soon it follows."""
        self._drag = object()

    def move(self, body: str, X_WB: ArrayLike, *, goes_on: bool = False) -> None:
        """Move a body to a pose, together with the bodies attached to it.

        Args:
            body: name of the body.
            X_WB: (4, 4) new pose.
            goes_on: join this move with the previous move of the same body, regardless of the time between them.

        Raises:
            SceneError: the pose is not rigid.
        """
        with self._painting.lock:
            one = self._painting.scene.body(body)
            X_WB = rigid(X_WB, f"body {body!r}")
            if np.array_equal(X_WB, one.X_WB):
                return
            step = X_WB @ np.linalg.inv(one.X_WB)
            attached = self._painting.scene.descendants(body)
            deltas = [self._delta(b, X_WB=rigid(step @ b.X_WB, f"body {b.name!r}")) for b in attached]
            deltas.insert(0, self._delta(one, X_WB=X_WB))
            key = ("move", body, self._drag)
            self._painting.change(f"move {body!r}", (), deltas, key=key, goes_on=goes_on)

    def scale_of(self, body: str) -> float:
        """Scale of a body relative to its mesh file."""
        mesh = self._painting.scene.body(body).mesh
        return self._scaled.get(id(mesh), (None, mesh.scale))[1]

    def scale(self, body: str, factor: float, *, beside: bool = False) -> None:
        """Scale a body about its centre.

        Args:
            body: name of the body.
            factor: new size divided by present size.
            beside: move it next to the others where it would overlap them or lie far away, as `add` does.

        Raises:
            SceneError: see `scaled_mesh`.
        """
        with self._painting.lock:
            one, mesh = self._painting.scene.body(body), self.scaled_mesh(body, factor)
            if mesh is one.mesh:
                return
            X_WB = one.X_WB.copy()
            X_WB[:3, 3] += X_WB[:3, :3] @ ((1 - factor) * one.mesh.bounds_m.mean(axis=0))
            others = [other for other in self._painting.scene.bodies if other is not one]
            if beside and others:
                X_WB[:3, 3] += _room_beside([replace(one, mesh=mesh, X_WB=X_WB)], others)
            delta = self._delta(one, mesh=mesh, X_WB=X_WB)
            self._painting.change(f"scale {body!r}", (), [delta], key=("scale", body))

    def scaled_mesh(self, body: str, factor: float) -> Mesh:
        """The mesh that `scale` would give a body.

        This may take seconds for a large mesh. Call it in another thread first: `scale` then reuses the result.

        Raises:
            SceneError: the size would be out of range, or the mesh file has changed.
        """
        mesh, (low, high) = self._painting.scene.body(body).mesh, SIZE_M
        if not (math.isfinite(factor) and factor > 0.0 and low <= factor * mesh.diagonal_m <= high):
            raise SceneError(
                f"body {body!r}: invalid scale factor {factor:g}: expected a factor above 0 that makes the body "
                f"{low:g} to {high:g} m large"
            )
        original, known = self._scaled.get(id(mesh), (mesh, mesh.scale))
        total = float(f"{known * factor:.12g}")  # rounded, so that scaling up and down again restores the mesh
        key = id(original), total
        if total == original.scale:
            return original
        if key not in self._made:
            if original.path is not None and original.scale != 1.0:  # bit-identical to loading the saved scene
                made = load_mesh(original.path, original.unit, up=original.up, scale=total)
                if not np.array_equal(made.faces, original.faces):
                    raise SceneError(
                        f"{original.path}: the faces differ from those of body {body!r}: the file has changed since it "
                        "was opened; open the scene again"
                    )
            else:
                scale = original.scale if original.path is None else total
                made = replace(original, vertices_m=total / original.scale * original.vertices_m, scale=scale)
            self._made[key] = made
            self._scaled[id(made)] = original, total
        return self._made[key]

    # --- visibility, which is not saved with the scene ---

    def hide(self, body: str, hidden: bool = True) -> None:
        """Hide or show a body. A hidden body is neither drawn nor painted; it is still touched."""
        with self._painting.lock:
            self._painting.end_step()
            names = self._painting.hidden
            (names.add if hidden else names.discard)(self._painting.scene.body(body).name)
            self._painting.note_poses()

    def _children(self, body: str) -> list[Body]:
        return [child for child in self._painting.scene.bodies if child.parent == body]

    def _delta(self, body: Body, **changed: object) -> BodyDelta:
        return BodyDelta(self.index(body.name), replace(body), replace(body, **changed))  # type: ignore[arg-type]

    def _swatches_of(self, scene: Scene) -> tuple[NDArray[np.int16], list[SwatchDelta]]:
        """Index in this scene of each swatch of another scene, and the swatches that must be added for that."""
        trial, count = self._painting.scene.copy(), len(self._painting.scene.swatches)
        index = []
        for swatch, source in zip(scene.swatches, scene.swatch_source, strict=True):
            try:
                index.append(trial.swatch_index(swatch))
            except SceneError:  # the name is taken by a different swatch
                index.append(trial.swatch_index(replace(swatch, name=numbered(swatch.name, _names(trial)))))
                source = None
            if index[-1] == len(trial.swatches) - 1 >= count:
                trial.swatch_source[-1] = source
        new = list(zip(trial.swatches, trial.swatch_source, strict=True))[count:]
        deltas = [SwatchDelta(count + i, None, SwatchState(*pair)) for i, pair in enumerate(new)]
        return np.array(index, np.int16), deltas


def _names(scene: Scene) -> list[str]:
    return [swatch.name for swatch in scene.swatches]


def _box(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner of a body's bounding box in W [m]."""
    places_m = body.mesh.vertices_m @ body.X_WB[:3, :3].T
    return places_m.min(axis=0) + body.X_WB[:3, 3], places_m.max(axis=0) + body.X_WB[:3, 3]


def _room_beside(bodies: list[Body], there: list[Body]) -> NDArray[np.float64]:
    """Translation (3,) that puts bodies next to existing ones [m]; 0 if they are near and do not overlap."""
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
