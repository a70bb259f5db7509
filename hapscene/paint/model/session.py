"""A painting session without a browser: every operation is a step that can be undone."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import TICK_S
from hapscene.device.model import DeviceLike, Limits
from hapscene.errors import SceneError, no_such
from hapscene.geometry import rigid
from hapscene.paint.model.composing import Composing
from hapscene.paint.model.document import Document, stamp_of
from hapscene.paint.model.mesh import Hit, Mask, face_centre
from hapscene.paint.model.painting import ERASE, Painting
from hapscene.paint.model.regions import TurnedBox, near_border
from hapscene.paint.model.strokes import NONE, Brush, Stroke, Symmetry
from hapscene.paint.model.tuning import SwatchTuning
from hapscene.scene.fine_paint import parts, swatches_of
from hapscene.scene.region import Sphere, Volume
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX
from hapscene.surface.swatch import Swatch, SwatchLike

__all__ = ["ERASE", "Hit", "Session"]

FILLS: Final = ("facet", "whole body", "material", "same swatch")
"""What the bucket fills from a place."""

FACET_RAD: Final = math.radians(10.0)
"""Angle of the bucket unless told otherwise [rad], as `hapscene.scene.region.Facet` has it."""


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
        composing: the bodies: what comes, goes and moves.
        scene, shapes, defaults, history, lock: those of the painting: see `hapscene.paint.model.painting.Painting`.
        path, dirty: those of the document: where `save` writes, and whether there is something to save.
        device, limits: those of the tuning.

    Raises:
        SceneError: a scene without bodies.
        HapsceneError: no such device.
    """

    def __init__(
        self, scene: Scene, path: str | Path | None = None, device: DeviceLike = "omni", *, tick_s: float = TICK_S
    ) -> None:
        self.painting = painting = Painting(scene)
        self.document = Document(painting, Path(path) if path is not None else None)
        self.tuning = SwatchTuning(painting, device, tick_s)
        self.composing = Composing(painting)
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

    def begin_stroke(self, swatch: int | str, radius_m: float, **more: Any) -> None:
        """Put the brush down; nothing is painted until it moves. A stroke in progress ends.

        Args:
            swatch: what to paint with.
            radius_m: of the brush [m].
            more: softness, opacity, through, symmetry: see `hapscene.paint.model.strokes.Brush`.

        Raises:
            SceneError: no such swatch, or no such brush.
        """
        with self.lock:
            self._stroke = Stroke(self.painting, swatch, Brush(radius_m, **more))

    def stroke_to(self, hit: Hit | None) -> int:
        """Draw from the last place to this one, on the surface; how many faces it reached. None lifts the brush.

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

    def _begun(self) -> Stroke:
        if self._stroke is None or not self.stroking:
            raise SceneError("no stroke to go on with: begin one first")
        return self._stroke

    # --- fill: each returns how many faces changed ---

    def fill_at(self, hit: Hit, what: str, swatch: int | str, angle_rad: float = FACET_RAD) -> int:
        """Fill from a place.

        Args:
            hit: the place.
            what: one of `FILLS`: a facet is connected over edges that bend by at most an angle.
            swatch: what to paint with.
            angle_rad: of the facet [rad].

        Raises:
            SceneError: the angle is not between 0 and π.
        """
        if what == "same swatch":
            return self.fill_swatch(hit.body, self.swatch_at(hit), swatch)
        degrees = math.degrees(angle_rad)
        if not 0.0 <= angle_rad <= math.pi:
            raise SceneError(f"a facet's angle must be between 0° and 180°, is {degrees:g}°")
        where = {"whole body": what, "material": repr(self.group_at(hit))}.get(what, f"facet within {degrees:.3g}°")
        return self._fill(where, hit.body, swatch, lambda index: self._faces_at(hit, what, angle_rad))

    def _faces_at(self, hit: Hit, what: str, angle_rad: float) -> Mask:
        shape = self.shapes[hit.body]
        if what == "whole body":
            return np.ones(len(shape.normal), np.bool_)
        if what == "material":
            return np.asarray(shape.mesh.group == shape.mesh.group[hit.face])
        return shape.facet(hit.face, angle_rad)

    def fill_body(self, body: int | str, swatch: int | str) -> int:
        """Paint a whole body."""
        return self._fill("whole body", body, swatch, lambda index: np.ones(len(self.shapes[index].normal), np.bool_))

    def fill_group(self, body: int | str, name: str, swatch: int | str) -> int:
        """Paint the faces of a group, material or object of the mesh's file, by its name or a part of that.

        Raises:
            MeshError: no face has that name.
        """
        return self._fill(repr(name), body, swatch, lambda index: self.shapes[index].mesh.faces_of(name))

    def fill_swatch(self, body: int | str | None, old: int | str, swatch: int | str) -> int:
        """Paint what is painted with one swatch with another: of one body, or (None) of all."""
        index = self.painting.swatch_index(old)
        with self.lock:
            self.painting.begin_step(f"{_verb(swatch)} swatch for swatch", swatch)
            for i in self._chosen(body):
                self.painting.replace_swatch(i, index)
            return self.painting.end_step()

    def grow(self, swatch: int | str, by_m: float, *, body: int | str | None = None) -> int:
        """Paint a band along all that a swatch is painted on: of one body, or (None) of all; how many faces it reaches.

        Args:
            swatch: which.
            by_m: how wide a band [m]. Below 0 it shrinks: what is beside it is painted over it.
            body: of which body; None for all.

        Raises:
            SceneError: the width is 0 or no number, or the border too long.
        """
        if not (math.isfinite(by_m) and by_m):
            raise SceneError(f"how far a swatch grows must be a number other than 0 mm, is {by_m * 1e3:g} mm")
        painting, index = self.painting, self.painting.swatch_index(swatch)
        with self.lock:
            what = (
                f"{'grow' if by_m > 0.0 else 'shrink'} {self.scene.swatches[index].name!r} by {abs(by_m) * 1e3:.3g} mm"
            )
            painting.begin_step(what, index)
            count = 0
            for i in self._chosen(body):
                one = self.scene.bodies[i]
                others = [None] if by_m > 0.0 else [k for k in swatches_of(one).tolist() if k != index]
                bands = [(other, near_border(one, self.shapes[i], index, other, abs(by_m))) for other in others]
                for other, band in bands:  # as they were before any was painted
                    if band is not None:
                        over = index if by_m < 0.0 else None
                        count += painting.paint_region(i, *band, swatch=other, over=over)
            painting.end_step()
            return count

    def fill_sphere(
        self, centre_W_m: ArrayLike, radius_m: float, swatch: int | str, *, body: int | str | None = None, **more: Any
    ) -> int:
        """Paint what is within a distance of a point in W: of one body, or (None) of all; how many faces it reaches.

        Args:
            centre_W_m: (3,) the point [m].
            radius_m: the distance [m].
            swatch: what to paint with.
            body: of which body; None for all.
            more: as `fill_region` has them.

        Raises:
            SceneError: the centre is not three finite numbers, or the radius not positive.
        """
        centre = np.asarray(centre_W_m, np.float64)
        if centre.shape != (3,) or not np.isfinite(centre).all():
            raise SceneError(f"a sphere's centre must be three finite numbers, is {centre_W_m!r}")
        if not (math.isfinite(radius_m) and radius_m > 0.0):
            raise SceneError(f"a sphere's radius must be above 0 mm, is {radius_m * 1e3:g} mm")
        return self.fill_region(
            "sphere", lambda X_BW: Sphere(X_BW[:3, :3] @ centre + X_BW[:3, 3], radius_m), swatch, body=body, **more
        )

    def fill_box(
        self, X_WK: ArrayLike, size_m: ArrayLike, swatch: int | str, *, body: int | str | None = None, **more: Any
    ) -> int:
        """Paint what is in a box: of one body, or (None) of all; how many faces it reaches.

        Args:
            X_WK: (4, 4) pose of the box in W: its middle, and its axes.
            size_m: (3,) its edges [m].
            swatch: what to paint with.
            body: of which body; None for all.
            more: as `fill_region` has them.

        Raises:
            SceneError: the pose is not rigid, or an edge not positive.
        """
        pose, size = rigid(X_WK, "box"), np.asarray(size_m, np.float64)
        if size.shape != (3,) or not (np.isfinite(size).all() and (size > 0.0).all()):
            raise SceneError(f"a box has three edges above 0 mm, not {size_m!r}")
        return self.fill_region("box", lambda X_BW: TurnedBox(X_BW @ pose, size), swatch, body=body, **more)

    def fill_region(
        self,
        where: str,
        region_of: Callable[[NDArray[np.float64]], Volume],
        swatch: int | str,
        *,
        body: int | str | None = None,
        eye_W_m: ArrayLike | None = None,
        opacity: float = 1.0,
        symmetry: Symmetry = NONE,
    ) -> int:
        """Paint a region of space, through faces: one step; how many faces it reaches.

        Args:
            where: what the step is called.
            region_of: the region in a frame, given the map (4, 4) from W to it, which may turn and mirror.
            swatch: what to paint with.
            body: of which body; None for all.
            eye_W_m: (3,) paint only what is seen from there [m]; None for all.
            opacity: how much of the swatch is put over what is there [0, 1].
            symmetry: where else it is painted; of each body.
        """
        with self.lock:
            self.painting.begin_step(f"{_verb(swatch)} {where}", swatch)
            count = 0
            for i in self._chosen(body):
                for image in symmetry.images_W(self.scene.bodies[i]):
                    region = region_of(np.linalg.inv(self.scene.bodies[i].X_WB) @ image)
                    faces: NDArray[np.integer] = self.shapes[i].near(region)
                    eye = None if eye_W_m is None else image[:3, :3] @ np.asarray(eye_W_m) + image[:3, 3]
                    count += self.painting.paint_region(i, region, faces, opacity=opacity, eye_W_m=eye)
            self.painting.end_step()
            return count

    def _fill(self, where: str, body: int | str, swatch: int | str, pick: Callable[[int], Mask]) -> int:
        with self.lock:
            index = self.body_index(body)
            return self.painting.paint(f"{_verb(swatch)} {where}", {index: pick(index)}, swatch)

    def _chosen(self, body: int | str | None) -> list[int]:
        """Index of a body, or (None) those of all."""
        return list(range(len(self.shapes))) if body is None else [self.body_index(body)]

    # --- what is there ---

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike, seen: bool = False) -> Hit | None:
        """The nearest place on the surface along a ray; None where there is none: see `Painting.pick`."""
        return self.painting.pick(origin_W_m, direction_W, seen)

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
        """The swatch that a place is painted with; of a blend, the heavier one."""
        body = self.scene.bodies[hit.body]
        found = None if body.fine is None else body.fine.at(hit.face, self.shapes[hit.body].bary(hit.face, hit.p_B_m))
        return int(body.face_swatch[hit.face] if found is None else parts(found)[0])

    def groups(self, body: int | str) -> list[tuple[str, int]]:
        """Names of a body's groups, materials and objects, and how many faces each has."""
        mesh = self.scene.bodies[self.body_index(body)].mesh
        counts = np.bincount(mesh.group, minlength=len(mesh.group_names))
        return [(name, int(n)) for name, n in zip(mesh.group_names, counts, strict=True) if n]

    def group_at(self, hit: Hit) -> str:
        """Name of the group that a place is in."""
        mesh = self.scene.bodies[hit.body].mesh
        return str(mesh.group_names[mesh.group[hit.face]])


def _verb(swatch: int | str) -> str:
    return "erase" if swatch == ERASE else "fill"
