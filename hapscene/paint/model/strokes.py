"""The brush: the path of a stroke over the surface."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.paint.model.mesh import Hit
from hapscene.paint.model.painting import ERASE, Painting
from hapscene.scene.region import Tube

__all__ = ["Brush", "Stroke"]


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
