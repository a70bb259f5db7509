"""A painting session: load a scene, paint it, save it. Each operation is a step that can be undone.

A session needs no browser; the web page is built on it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.device.model import DeviceLike
from hapscene.errors import SceneError, no_such
from hapscene.paint.model.composing import Composing
from hapscene.paint.model.document import Document, file_hash
from hapscene.paint.model.mesh import Hit
from hapscene.paint.model.painting import ERASE, Painting
from hapscene.paint.model.tuning import SwatchTuning
from hapscene.scene.fine_paint import parts
from hapscene.scene.region import Region, Sphere, Tube
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX
from hapscene.surface.swatch import Swatch, SwatchLike

__all__ = ["ERASE", "Brush", "Hit", "Session", "Stroke"]

FILLS: Final = ("facet", "whole body", "material")
"""What the fill tool fills from a point."""

FACET_RAD: Final = math.radians(10.0)
"""Default angle of a facet for the fill tool [rad]."""

Ray = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Origin (3,) [m] and direction (3,), a unit vector."""

SPLIT_MAX: Final = 64
"""Largest number of parts of one pointer move [count]: a sweep over the width of a window in steps of 20 pixels."""

STEP_SHARE: Final = 0.5
"""Longest step between two points of a stroke, in radii of the brush [1]; longer moves are split. On a surface with the
curvature of the brush, a step then deviates from the surface by 3 % of the radius."""


@dataclass(frozen=True)
class Brush:
    """Settings of the brush.

    Attributes:
        radius_m: radius [m].
        falloff: width of the soft border inside the radius, as a fraction of it [0, 1]; 0 is a sharp border.
        opacity: weight of the swatch over the present painting [0, 1].

    Raises:
        SceneError: a setting is out of range.
    """

    radius_m: float
    falloff: float = 0.0
    opacity: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius_m) and self.radius_m > 0.0):
            raise SceneError(f"brush radius {self.radius_m * 1e3:g} mm is out of range: expected more than 0 mm")
        if not 0.0 <= self.falloff <= 1.0:
            raise SceneError(f"brush falloff {self.falloff:g} is out of range: expected 0 to 1")
        if not 0.0 < self.opacity <= 1.0:
            raise SceneError(f"brush opacity {self.opacity:g} is out of range: expected more than 0, up to 1")


class Stroke:
    """A stroke: begins a step of the painting and paints in it.

    Raises:
        SceneError: the scene has no such swatch.
    """

    def __init__(self, painting: Painting, swatch: int | str, brush: Brush) -> None:
        self._painting, self._brush = painting, brush
        self._last: Hit | None = None  # last point, and the ray to it
        self._ray: Ray | None = None
        self.resume(swatch)

    def resume(self, swatch: int | str) -> None:
        """Begin another step, after an operation that has ended the step of this stroke."""
        self._step = self._painting.begin_step("eraser" if swatch == ERASE else "brush", swatch)

    @property
    def in_progress(self) -> bool:
        """Whether the step of this stroke is open. Any other operation ends it."""
        return self._painting.open_step is self._step

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """Paint up to the point where a ray from the eye meets the surface: see `Session.drag_to`."""
        hit = self._painting.pick(origin_W_m, direction_W, visible_only=True)
        origin, direction = np.asarray(origin_W_m, np.float64), np.asarray(direction_W, np.float64)
        length = float(np.linalg.norm(direction))
        if length > 0.0:
            ray = origin, direction / length
            if self._ray is not None and all(map(np.array_equal, self._ray, ray)):
                return hit  # painted already: a release where the button was pressed
            way: list[Hit | None] = []
            if self._ray is not None:
                (o, d), count = self._ray, self._pieces(ray, hit)
                for share in np.arange(1, count) / count:
                    between = o + share * (ray[0] - o), d + share * (ray[1] - d)
                    way.append(self._painting.pick(*between, visible_only=True))
            self._ray = ray
            self._draw([*way, hit], origin)
        return hit

    def _draw(self, way: list[Hit | None], eye_W_m: NDArray[np.float64]) -> None:
        """Paint from the last point along points, lifting at each None."""
        line = [self._last] if self._last is not None else []
        for hit in way:
            if line and (hit is None or hit.body != line[0].body):
                if line != [self._last]:
                    self._paint(line, eye_W_m)
                line = []
            if hit is not None:
                line.append(hit)
        if line and line != [self._last]:
            self._paint(line, eye_W_m)
        self._last = way[-1]

    def _paint(self, line: list[Hit], eye_W_m: NDArray[np.float64]) -> None:
        """Paint along points on one body."""
        brush, body, shape = self._brush, line[0].body, self._painting.shapes[line[0].body]
        falloff_m = brush.falloff * brush.radius_m  # the border is inside the radius
        points_m = np.array([hit.p_B_m for hit in line])
        region = Tube(points_m, brush.radius_m - falloff_m / 2)
        faces = shape.brush([hit.face for hit in line], points_m, brush.radius_m)
        self._painting.paint_region(body, region, faces, falloff_m, brush.opacity, eye_W_m=eye_W_m)

    def _pieces(self, now: Ray, hit: Hit | None) -> int:
        """Number of parts into which a move is split."""
        known = [h for h in (hit, self._last) if h is not None]
        was = self._ray
        if not known or was is None:
            return 1
        depth_m = max(h.distance_m for h in known)
        way_m = float(np.linalg.norm(now[0] - was[0])) + depth_m * float(np.linalg.norm(now[1] - was[1]))
        if len(known) == 2:
            way_m = max(way_m, float(np.linalg.norm(known[0].p_W_m - known[1].p_W_m)))
        return int(min(max(math.ceil(way_m / (STEP_SHARE * self._brush.radius_m)), 1), SPLIT_MAX))


class Session:
    """A scene that is being painted.

    Args:
        scene: the scene, painted in place; do not change it elsewhere.
        path: scene file that it was loaded from or will be saved to; None if not known yet.
        device: device whose limits apply to the parameters of swatches.

    Attributes:
        painting: the scene and the steps that can be undone.
        document: the scene file: saving, autosave, recovery.
        tuning: the swatches and their parameters.
        composing: the bodies: add, delete, move, attach.
        scene, shapes, defaults, history, lock: see `hapscene.paint.model.painting.Painting`.

    Raises:
        SceneError: the scene has no bodies.
        HapsceneError: the device is unknown.
    """

    def __init__(self, scene: Scene, path: str | Path | None = None, device: DeviceLike = "omni") -> None:
        self.painting = painting = Painting(scene)
        self.document = Document(painting, Path(path) if path is not None else None)
        self.tuning = SwatchTuning(painting, device)
        self.composing = Composing(painting)
        self.scene, self.shapes, self.defaults = painting.scene, painting.shapes, painting.defaults
        self.history, self.lock = painting.history, painting.lock
        self._stroke: Stroke | None = None

    @classmethod
    def open(cls, path: str | Path, accept_changed: bool = False) -> Self:
        """Load a scene file.

        Args:
            path: NAME.scene.json.
            accept_changed: see `hapscene.load_scene`. The session is then unsaved, since the file refers to the
                previous meshes.

        Raises:
            SceneError, MeshError, SwatchError: see `hapscene.load_scene`.
        """
        path = Path(path)
        real = path.resolve()
        if not path.is_symlink() or not real.name.endswith(SUFFIX):
            real = path
        loaded_hash = file_hash(path)  # taken before loading, so that later changes of the file are detected
        session = cls(load_scene(path, accept_changed))
        session.document = Document(session.painting, real, loaded_hash, changed=accept_changed)
        return session

    # --- shortcuts to the parts ---

    def add_swatch(self, swatch: SwatchLike) -> int:
        """Add a swatch to the scene unless it is there; returns its index. See `SwatchTuning.add_swatch`."""
        return self.tuning.add_swatch(swatch)

    def tune(self, swatch: int | str, **numbers: float) -> Swatch:
        """Change parameters of a swatch; returns the new swatch. See `SwatchTuning.tune`."""
        return self.tuning.tune(swatch, **numbers)

    def undo(self) -> str | None:
        """Undo the last step, including a stroke in progress; returns its description, or None."""
        return self.painting.undo()

    def redo(self) -> str | None:
        """Redo the step undone last; returns its description, or None."""
        return self.painting.redo()

    def save(self, path: str | Path | None = None, force: bool = False) -> Path:
        """Save the scene; returns the file. See `Document.save`."""
        return self.document.save(path, force)

    @property
    def path(self) -> Path | None:
        """File that `save` writes; None if not known yet."""
        return self.document.path

    @property
    def dirty(self) -> bool:
        """Whether there is something to save: the scene was changed, or has no file yet."""
        return self.document.dirty

    # --- the brush ---

    def begin_stroke(self, swatch: int | str, radius_m: float, **more: Any) -> None:
        """Begin a stroke and end a stroke in progress. `drag_to` paints.

        Args:
            swatch: swatch to paint with.
            radius_m: radius of the brush [m].
            more: falloff, opacity: see `Brush`.

        Raises:
            SceneError: the swatch is unknown, or a setting of the brush is out of range.
        """
        with self.lock:
            self._stroke = Stroke(self.painting, swatch, Brush(radius_m, **more))

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """Paint to the point where a ray from the eye meets the surface; returns that point, or None without a hit.

        A long move is split by rays between the last ray and this one, so that the stroke follows the visible surface.

        Raises:
            SceneError: no stroke is in progress.
        """
        with self.lock:
            if self._stroke is None or not self._stroke.in_progress:
                raise SceneError("there is no stroke in progress: call begin_stroke first")
            return self._stroke.drag_to(origin_W_m, direction_W)

    def end_stroke(self) -> int:
        """End the stroke, which becomes one step; returns the number of faces that it changed."""
        return self.painting.end_step()

    # --- fills; each returns the number of faces that changed ---

    def fill_at(self, hit: Hit, what: str, swatch: int | str, angle_rad: float = FACET_RAD) -> int:
        """Fill from a point.

        Args:
            hit: the point.
            what: one of `FILLS`. A facet consists of faces connected over edges that bend by at most an angle.
            swatch: swatch to paint with.
            angle_rad: angle of the facet [rad].

        Raises:
            SceneError: the angle is out of range.
        """
        if what == "whole body":
            return self.fill_body(hit.body, swatch)
        shape, degrees = self.shapes[hit.body], math.degrees(angle_rad)
        if what == "material":
            group = shape.mesh.group[hit.face]
            where, chosen = repr(shape.mesh.group_names[group]), shape.mesh.group == group
        elif 0.0 <= angle_rad <= math.pi:
            where, chosen = f"facet within {degrees:.3g}°", shape.facet(hit.face, angle_rad)
        else:
            raise SceneError(f"facet angle {degrees:g}° is out of range: expected 0° to 180°")
        return self.painting.paint(f"{_verb(swatch)} {where}", {hit.body: chosen}, swatch)

    def fill_body(self, body: int | str, swatch: int | str) -> int:
        """Paint a body all over."""
        index = self.body_index(body)
        every = np.ones(len(self.shapes[index].normal), np.bool_)
        return self.painting.paint(f"{_verb(swatch)} whole body", {index: every}, swatch)

    def fill_sphere(self, centre_W_m: ArrayLike, radius_m: float, swatch: int | str, **more: Any) -> int:
        """Paint the inside of a sphere; returns the number of faces reached.

        Args:
            centre_W_m: (3,) centre [m].
            radius_m: radius [m].
            swatch: swatch to paint with.
            more: see `fill_region`.

        Raises:
            SceneError: the centre or the radius is invalid.
        """
        centre = np.asarray(centre_W_m, np.float64)
        if centre.shape != (3,) or not np.isfinite(centre).all():
            raise SceneError(f"invalid sphere centre {centre_W_m!r}: expected three finite numbers")
        if not (math.isfinite(radius_m) and radius_m > 0.0):
            raise SceneError(f"sphere radius {radius_m * 1e3:g} mm is out of range: expected more than 0 mm")
        return self.fill_region(
            "sphere", lambda X_BW: Sphere(X_BW[:3, :3] @ centre + X_BW[:3, 3], radius_m), swatch, **more
        )

    def fill_region(
        self,
        where: str,
        region_of: Callable[[NDArray[np.float64]], Region],
        swatch: int | str,
        *,
        eye_W_m: ArrayLike | None = None,
        opacity: float = 1.0,
    ) -> int:
        """Paint the inside of a region in one step, cutting faces; returns the number of faces reached.

        Args:
            where: description of the region for the user.
            region_of: returns the region in the frame of a body, given the map (4, 4) from W to that frame.
            swatch: swatch to paint with.
            eye_W_m: (3,) paint only what is visible from this point [m]; None to ignore occlusion.
            opacity: weight of the swatch over the present painting [0, 1].
        """
        with self.lock:
            self.painting.begin_step(f"{_verb(swatch)} {where}", swatch)
            count = 0
            for i, body in enumerate(self.scene.bodies):
                region = region_of(np.asarray(np.linalg.inv(body.X_WB), np.float64))
                count += self.painting.paint_region(
                    i, region, self.shapes[i].near(region), opacity=opacity, eye_W_m=eye_W_m
                )
            self.painting.end_step()
            return count

    # --- queries ---

    def pick(self, origin_W_m: ArrayLike, direction_W: ArrayLike, visible_only: bool = False) -> Hit | None:
        """The nearest point on the surface along a ray; None without a hit. See `Painting.pick`."""
        return self.painting.pick(origin_W_m, direction_W, visible_only)

    def body_index(self, body: int | str) -> int:
        """Index of a body, given by name or index.

        Raises:
            SceneError: there is no such body.
        """
        bodies = self.scene.bodies
        if isinstance(body, str):
            names = [b.name for b in bodies]
            if body not in names:
                raise SceneError(no_such("body", body, names))
            return names.index(body)
        if not 0 <= body < len(bodies):
            raise SceneError(f"body index {body} is out of range: expected 0 to {len(bodies) - 1}")
        return int(body)

    def swatch_at(self, hit: Hit) -> int:
        """Index of the swatch at a point; of a blend, the swatch with the larger weight."""
        body = self.scene.bodies[hit.body]
        found = None if body.fine is None else body.fine.at(hit.face, self.shapes[hit.body].bary(hit.face, hit.p_B_m))
        return int(body.face_swatch[hit.face] if found is None else parts(found)[0])


def _verb(swatch: int | str) -> str:
    return "erase" if swatch == ERASE else "fill"
