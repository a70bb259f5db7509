"""What may be done to a scene, without a browser: every operation is a step that can be undone.

    session = Session(scene, Path("cup.scene.json"))
    session.add_swatch("wood")
    session.begin_stroke("wood", radius_m=0.004)
    session.drag_to(origin_W_m, direction_W)     # as often as the pointer moves
    session.end_stroke()
    session.tune("wood", stiffness_N_m=350.0)
    session.undo()
    session.save()

A session has a painting, a document, a tuning and a history: what its own methods do not do, these do. A swatch is
given by its name, or its index in `scene.swatches`; `ERASE` stands for the default of each body. A body is given by its
name or its index. All methods may be called from any thread.
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import TICK_S
from hapscene.device.model import DeviceLike, Limits
from hapscene.errors import SceneError, no_such
from hapscene.old_spellings import old_spellings
from hapscene.paint.document import Document, stamp_of
from hapscene.paint.paintable_mesh import Hit, Mask, PaintableMesh, face_centre, faces_in_box, faces_in_sphere
from hapscene.paint.painting import ERASE, Painting
from hapscene.paint.swatch_tuning import SwatchTuning
from hapscene.scene.body import Body
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX
from hapscene.surface.swatch import Swatch, SwatchLike

__all__ = ["ERASE", "Hit", "Session"]

Ray = tuple[NDArray[np.float64], NDArray[np.float64]]
"""From where (3,) [m], and which way (3,), a unit vector."""

FACET_RAD: Final = math.radians(10.0)
"""Angle of the bucket unless told otherwise [rad], as `hapscene.scene.region.Facet` has it."""

SPLIT_MAX: Final = 64
"""Most pieces that one move of the pointer is split into [count]: a sweep over a window's width at some 20 pixels."""

STEP_SHARE: Final = 0.5
"""Longest way between two places of a stroke before the move is split, in radii of the brush [1]: a surface curved like
the brush itself is left by 3 % of the radius."""


class Session:
    """A scene that is being painted.

    Args:
        scene: painted in place; nobody else should change it meanwhile.
        path: the scene file it was loaded from, or shall be saved to; None where that is not known yet.
        device: whose limits the parameters show, by its name or itself.
        tick_s: period of the force channel [s].

    Attributes:
        painting: the scene, its steps, and who watches; `history`, what can be undone, is its.
        document: the file: saving, autosave, recovery.
        tuning: the swatches and their numbers.
        scene, shapes, defaults, history, lock: those of the painting: see `hapscene.paint.painting.Painting`.
        path, dirty: those of the document: where `save` writes, and whether there is something to save.
        device, limits: those of the tuning.

    Raises:
        SceneError: a scene without bodies.
        HapsceneError: no such device.
    """

    @old_spellings()
    def __init__(
        self, scene: Scene, path: str | Path | None = None, device: DeviceLike = "omni", *, tick_s: float = TICK_S
    ) -> None:
        self.painting = painting = Painting(scene)
        self.document = Document(painting, Path(path) if path is not None else None)
        self.tuning = SwatchTuning(painting, device, tick_s)
        self.scene, self.shapes, self.defaults = painting.scene, painting.shapes, painting.defaults
        self.history, self.lock = painting.history, painting.lock
        self._stroke: Stroke | None = None

    def __repr__(self) -> str:
        name = self.path.name if self.path is not None else "without a file"
        faces = sum(len(body.face_swatch) for body in self.scene.bodies)
        bodies, swatches = len(self.scene.bodies), len(self.scene.swatches)
        saved = "not saved" if self.dirty else "saved"
        return f"<Session {name}: {bodies} bodies, {faces:,} faces, {swatches} swatches, {saved}>"

    @classmethod
    def open(cls, path: str | Path, accept_changed: bool = False) -> Self:
        """Load a scene file to paint it.

        Args:
            path: NAME.scene.json.
            accept_changed: as `hapscene.load_scene` has it; then there is something to save: the file knows the old
                meshes.

        Raises:
            SceneError, MeshError, SwatchError: as `hapscene.load_scene`.
        """
        path = Path(path)
        real = path.resolve()
        if not path.is_symlink() or not real.name.endswith(SUFFIX):
            real = path
        stamp = stamp_of(path)  # before it is read: what changes meanwhile counts as changed
        session = cls(load_scene(path, accept_changed))
        session.document = Document(session.painting, real, stamp, changed=accept_changed)  # of the file, not of a link
        return session

    # --- what its parts do ---

    def add_swatch(self, swatch: SwatchLike) -> int:
        """Put a swatch into the scene, unless it is there; its index: see `SwatchTuning.add_swatch`."""
        return self.tuning.add_swatch(swatch)

    def tune(self, swatch: int | str, **numbers: float) -> Swatch:
        """Change numbers of a swatch; the swatch as it is now: see `SwatchTuning.tune`."""
        return self.tuning.tune(swatch, **numbers)

    def recolour(self, swatch: int | str, albedo_rgb: tuple[float, float, float]) -> Swatch:
        """Give a swatch another colour; the swatch as it is now: see `SwatchTuning.recolour`."""
        return self.tuning.recolour(swatch, albedo_rgb)

    def undo(self) -> str | None:
        """Take the last step back, a stroke in progress first of all; what it was, or None where there is none."""
        return self.painting.undo()

    def redo(self) -> str | None:
        """Do again what was undone last; what it was, or None where there is nothing."""
        return self.painting.redo()

    def save(self, path: str | Path | None = None, force: bool = False) -> Path:
        """Save the scene, to `path` from now on where one is given; its file: see `Document.save`."""
        return self.document.save(path, force)

    @property
    def path(self) -> Path | None:
        """Where `save` writes; None where that is not known yet."""
        return self.document.path

    @property
    def dirty(self) -> bool:
        """Whether there is something to save: it was changed, or there is no file of it yet."""
        return self.document.dirty

    @property
    def device(self) -> str:
        """Whose limits the parameters show."""
        return self.tuning.device

    @property
    def limits(self) -> Limits:
        """Those of the device."""
        return self.tuning.limits

    # --- the brush ---

    def begin_stroke(self, swatch: int | str, radius_m: float) -> None:
        """Put the brush down; nothing is painted until it moves. A stroke in progress ends.

        Raises:
            SceneError: no such swatch, or no radius.
        """
        with self.lock:
            self._stroke = Stroke(self.painting, swatch, radius_m)

    def stroke_to(self, hit: Hit | None) -> int:
        """Draw from the last place to this one, on the surface; how many faces became others. None lifts the brush.

        Where the last place was on another body, or none, only this place is painted.

        Raises:
            SceneError: no stroke was begun.
        """
        with self.lock:
            return self._begun().to(hit)

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """Draw to where a ray from the eye through the pointer meets the surface; that place, or None beside it.

        A long move is split: rays between the last one and this one find the way on the surface that the eye saw.

        Raises:
            SceneError: no stroke was begun.
        """
        with self.lock:
            return self._begun().drag_to(origin_W_m, direction_W)

    def end_stroke(self) -> int:
        """Lift the brush: the stroke is one step; how many faces it changed."""
        return self.painting.end_step()

    @property
    def stroking(self) -> bool:
        """Whether a stroke is in progress: whatever else is done ends it."""
        return self.painting.step_is_open

    def _begun(self) -> "Stroke":
        if self._stroke is None or not self.stroking:
            raise SceneError("no stroke to go on with: begin one first")
        return self._stroke

    # --- fill: each returns how many faces became others ---

    def fill_body(self, body: int | str, swatch: int | str) -> int:
        """Paint a whole body."""
        return self._fill("whole body", body, swatch, lambda found, shape: np.ones(len(shape.normal), np.bool_))

    def fill_facet(self, hit: Hit, swatch: int | str, angle_rad: float = FACET_RAD) -> int:
        """Paint all faces connected with a place over edges that bend by at most an angle.

        Raises:
            SceneError: the angle is not between 0 and π.
        """
        degrees = math.degrees(angle_rad)
        if not 0.0 <= angle_rad <= math.pi:
            raise SceneError(f"a facet's angle must be between 0° and 180°, is {degrees:g}°")
        where = f"facet within {degrees:.3g}°"
        return self._fill(where, hit.body, swatch, lambda found, shape: shape.facet(hit.face, angle_rad))

    def fill_group(self, body: int | str, name: str, swatch: int | str) -> int:
        """Paint the faces of a group, material or object of the mesh's file, by its name or a part of that.

        Raises:
            MeshError: no face has that name.
        """
        return self._fill(repr(name), body, swatch, lambda found, shape: shape.mesh.faces_of(name))

    def fill_group_at(self, hit: Hit, swatch: int | str) -> int:
        """Paint the faces of the very group that a place is in."""
        where = repr(self.group_at(hit))
        return self._fill(where, hit.body, swatch, lambda found, shape: shape.mesh.group == shape.mesh.group[hit.face])

    def fill_swatch(self, body: int | str | None, old: int | str, swatch: int | str) -> int:
        """Paint what is painted with one swatch with another: of one body, or (None) of all."""
        index = self.painting.swatch_index(old)
        return self._fill("swatch for swatch", body, swatch, lambda found, shape: found.face_swatch == index)

    @old_spellings()
    def fill_sphere(
        self, centre_W_m: ArrayLike, radius_m: float, swatch: int | str, *, body: int | str | None = None
    ) -> int:
        """Paint the faces whose centroid is within a distance of a point in W: of one body, or (None) of all.

        Raises:
            SceneError: the centre is not three finite numbers, or the radius not positive.
        """
        return self._fill("sphere", body, swatch, partial(faces_in_sphere, centre_W_m, radius_m))

    @old_spellings()
    def fill_box(self, X_WK: ArrayLike, size_m: ArrayLike, swatch: int | str, *, body: int | str | None = None) -> int:
        """Paint the faces whose centroid is in a box: of one body, or (None) of all.

        Args:
            X_WK: (4, 4) pose of the box in W: its middle, and its axes.
            size_m: (3,) its edges [m].
            swatch: what to paint with.
            body: of which body; None for all.

        Raises:
            SceneError: the pose is not rigid, or an edge not positive.
        """
        return self._fill("box", body, swatch, partial(faces_in_box, X_WK, size_m))

    def _fill(
        self, where: str, body: int | str | None, swatch: int | str, pick: Callable[[Body, PaintableMesh], Mask]
    ) -> int:
        with self.lock:
            chosen = range(len(self.shapes)) if body is None else [self.body_index(body)]
            masks = {i: pick(self.scene.bodies[i], self.shapes[i]) for i in chosen}
            return self.painting.paint(f"{'erase' if swatch == ERASE else 'fill'} {where}", masks, swatch)

    # --- what is there ---

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """The nearest place on the surface along a ray; None where there is none: see `Painting.pick`."""
        return self.painting.pick(origin_W_m, direction_W)

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
        return face_centre(self.scene.bodies, self.shapes, index, int(face))

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

    def swatch_at(self, hit: Hit) -> int:
        """The swatch that a place is painted with."""
        return int(self.scene.bodies[hit.body].face_swatch[hit.face])

    def groups(self, body: int | str) -> list[tuple[str, int]]:
        """Names of a body's groups, materials and objects, and how many faces each has."""
        mesh = self.scene.bodies[self.body_index(body)].mesh
        counts = np.bincount(mesh.group, minlength=len(mesh.group_names))
        return [(name, int(n)) for name, n in zip(mesh.group_names, counts, strict=True) if n]

    def group_at(self, hit: Hit) -> str:
        """Name of the group that a place is in."""
        mesh = self.scene.bodies[hit.body].mesh
        return str(mesh.group_names[mesh.group[hit.face]])


class Stroke:
    """Where the brush goes while it is down: opens a step of the painting, and paints in it at once.

    Raises:
        SceneError: no such swatch, or no radius.
    """

    def __init__(self, painting: Painting, swatch: int | str, radius_m: float) -> None:
        if not (math.isfinite(radius_m) and radius_m > 0.0):
            raise SceneError(f"a brush's radius must be above 0 mm, is {radius_m * 1e3:g} mm")
        painting.begin_step("eraser" if swatch == ERASE else "brush", swatch)
        self._painting, self._radius_m = painting, float(radius_m)
        self._last: Hit | None = None
        self._ray: Ray | None = None

    def to(self, hit: Hit | None) -> int:
        """As `Session.stroke_to`."""
        last, self._last = self._last, hit
        if hit is None:
            return 0
        if last is None or last.body != hit.body:
            last = hit
        shape = self._painting.shapes[hit.body]
        faces = shape.brush((last.face, hit.face), (last.p_B_m, hit.p_B_m), self._radius_m)
        return self._painting.paint_faces(hit.body, faces)

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """As `Session.drag_to`."""
        hit = self._painting.pick(origin_W_m, direction_W)
        origin, direction = np.asarray(origin_W_m, np.float64), np.asarray(direction_W, np.float64)
        length = float(np.linalg.norm(direction))
        ray = (origin, direction / length) if length > 0.0 else None
        if ray is not None and self._ray is not None:
            count = self._pieces(self._ray, ray, hit)
            for share in np.arange(1, count) / count:
                o, d = (was + share * (now - was) for was, now in zip(self._ray, ray, strict=True))
                self.to(self._painting.pick(o, d))
        self._ray = ray
        self.to(hit)
        return hit

    def _pieces(self, was: Ray, now: Ray, hit: Hit | None) -> int:
        """How many pieces a move is split into."""
        known = [h for h in (hit, self._last) if h is not None]
        if not known:
            return 1
        depth_m = max(h.distance_m for h in known)
        way_m = float(np.linalg.norm(now[0] - was[0])) + depth_m * float(np.linalg.norm(now[1] - was[1]))
        if len(known) == 2:
            way_m = max(way_m, float(np.linalg.norm(known[0].p_W_m - known[1].p_W_m)))
        return int(min(max(math.ceil(way_m / (STEP_SHARE * self._radius_m)), 1), SPLIT_MAX))
