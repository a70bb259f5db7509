"""The brush: the path of a stroke over the surface, and its mirror images."""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.paint.model.mesh import Hit
from hapscene.paint.model.painting import ERASE, Painting
from hapscene.scene.body import Body
from hapscene.scene.region import Tube

__all__ = ["Brush", "Stroke", "mirror_images_W"]


Ray = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Origin (3,) [m] and direction (3,), a unit vector."""

SPLIT_MAX: Final = 64
"""Largest number of parts of one pointer move [count]: a sweep over the width of a window in steps of 20 pixels."""

STEP_SHARE: Final = 0.5
"""Longest step between two points of a stroke, in radii of the brush [1]; longer moves are split. On a surface with the
curvature of the brush, a step then deviates from the surface by 3 % of the radius."""


def mirror_images_W(body: Body, mirrors: str) -> list[NDArray[np.float64]]:
    """Maps (4, 4) in W from a point to its images, mirrored through the centre of a body; the first is the identity.

    Args:
        body: the body.
        mirrors: axes of the body, such as "x" or "xz", along which to mirror.

    Raises:
        SceneError: an axis is not x, y or z.
    """
    _check_mirrors(mirrors)
    maps = [np.eye(3)]
    for axis in sorted(set(mirrors)):
        mirror = np.eye(3)
        mirror["xyz".index(axis), "xyz".index(axis)] = -1.0
        maps += [mirror @ known for known in maps]
    used_m = body.mesh.vertices_m[np.unique(body.mesh.faces)] if mirrors else np.zeros((1, 3))
    middle_m = (used_m.min(axis=0) + used_m.max(axis=0)) / 2
    X_BW = np.linalg.inv(body.X_WB)
    images = []
    for R in maps:
        about = np.eye(4)
        about[:3, :3], about[:3, 3] = R, middle_m - R @ middle_m
        images.append(body.X_WB @ about @ X_BW)
    return images


def _check_mirrors(mirrors: str) -> None:
    if not set(mirrors) <= set("xyz"):
        raise SceneError(f"invalid mirrors {mirrors!r}: expected axes of x, y and z, such as 'x' or 'xz'")


@dataclass(frozen=True)
class Brush:
    """Settings of the brush.

    Attributes:
        radius_m: radius [m].
        falloff: width of the soft border inside the radius, as a fraction of it [0, 1]; 0 is a sharp border.
        opacity: weight of the swatch over the present painting [0, 1].
        ignore_occlusion: paint everything within the radius, including hidden surfaces and back faces.
        mirrors: axes of the body along which the stroke is mirrored, such as "x" or "xz".

    Raises:
        SceneError: a setting is out of range.
    """

    radius_m: float
    falloff: float = 0.0
    opacity: float = 1.0
    ignore_occlusion: bool = False
    mirrors: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius_m) and self.radius_m > 0.0):
            raise SceneError(f"brush radius {self.radius_m * 1e3:g} mm is out of range: expected more than 0 mm")
        if not 0.0 <= self.falloff <= 1.0:
            raise SceneError(f"brush falloff {self.falloff:g} is out of range: expected 0 to 1")
        if not 0.0 < self.opacity <= 1.0:
            raise SceneError(f"brush opacity {self.opacity:g} is out of range: expected more than 0, up to 1")
        _check_mirrors(self.mirrors)


@dataclass(eq=False)
class _Tip:
    """The brush or one of its mirror images: its map, its last point, and the ray to that point."""

    image_W: NDArray[np.float64]
    last: Hit | None = None
    ray: Ray | None = field(default=None, repr=False)


class Stroke:
    """A stroke: begins a step of the painting and paints in it.

    Raises:
        SceneError: the scene has no such swatch.
    """

    def __init__(self, painting: Painting, swatch: int | str, brush: Brush) -> None:
        self._painting, self._brush = painting, brush
        self._tips: list[_Tip] = []
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
            for tip in self._tips_of(hit):
                R = tip.image_W[:3, :3]
                self._drag(tip, (R @ origin + tip.image_W[:3, 3], R @ direction / length), hit)
        return hit

    def _drag(self, tip: _Tip, ray: Ray, first: Hit | None) -> None:
        if tip.ray is not None and all(map(np.array_equal, tip.ray, ray)):
            return  # painted already: a release where the button was pressed
        hit = self._pick(first, *ray)
        way: list[Hit | None] = []
        if tip.ray is not None:
            (o, d), count = tip.ray, self._pieces(tip, ray, hit)
            shares = np.arange(1, count) / count
            way = [self._pick(first, o + share * (ray[0] - o), d + share * (ray[1] - d)) for share in shares]
        tip.ray = ray
        self._draw(tip, [*way, hit], ray[0])

    def _pick(self, first: Hit | None, origin_W_m: NDArray[np.float64], direction_W: NDArray[np.float64]) -> Hit | None:
        """Hit of a tip's ray; for a mirror image, only on the body that the brush itself is on."""
        hit = self._painting.pick(origin_W_m, direction_W, visible_only=True)
        return hit if len(self._tips) == 1 or (hit and first and hit.body == first.body) else None

    def _tips_of(self, hit: Hit | None) -> list[_Tip]:
        """The brush and its mirror images, about the body that the stroke meets first."""
        if not self._tips or (hit is not None and len(self._tips) == 1 and self._brush.mirrors):
            bodies = self._painting.scene.bodies
            images = [np.eye(4)] if hit is None else mirror_images_W(bodies[hit.body], self._brush.mirrors)
            known = self._tips[:1]
            self._tips = [*known, *map(_Tip, images[len(known) :])]
        return self._tips

    def _draw(self, tip: _Tip, way: list[Hit | None], eye_W_m: NDArray[np.float64]) -> None:
        """Paint from the last point of a tip along points, lifting at each None."""
        line = [tip.last] if tip.last is not None else []
        for hit in way:
            if line and (hit is None or hit.body != line[0].body):
                if line != [tip.last]:
                    self._paint(line, eye_W_m)
                line = []
            if hit is not None:
                line.append(hit)
        if line and line != [tip.last]:
            self._paint(line, eye_W_m)
        tip.last = way[-1]

    def _paint(self, line: list[Hit], eye_W_m: NDArray[np.float64]) -> None:
        """Paint along points on one body."""
        brush, body, shape = self._brush, line[0].body, self._painting.shapes[line[0].body]
        falloff_m = brush.falloff * brush.radius_m  # the border is inside the radius
        points_m = np.array([hit.p_B_m for hit in line])
        region = Tube(points_m, brush.radius_m - falloff_m / 2)
        if brush.ignore_occlusion:
            faces: NDArray[np.integer] = shape.near(Tube(points_m, brush.radius_m))
            self._painting.paint_region(body, region, faces, falloff_m, brush.opacity)
            return
        ends = pairwise(line) if len(line) > 1 else [(line[0], line[0])]
        touched = [shape.brush((a.face, b.face), (a.p_B_m, b.p_B_m), brush.radius_m) for a, b in ends]
        faces = np.unique(np.concatenate(touched))
        self._painting.paint_region(body, region, faces, falloff_m, brush.opacity, eye_W_m=eye_W_m)

    def _pieces(self, tip: _Tip, now: Ray, hit: Hit | None) -> int:
        """Number of parts into which a move is split."""
        known = [h for h in (hit, tip.last) if h is not None]
        was = tip.ray
        if not known or was is None:
            return 1
        depth_m = max(h.distance_m for h in known)
        way_m = float(np.linalg.norm(now[0] - was[0])) + depth_m * float(np.linalg.norm(now[1] - was[1]))
        if len(known) == 2:
            way_m = max(way_m, float(np.linalg.norm(known[0].p_W_m - known[1].p_W_m)))
        return int(min(max(math.ceil(way_m / (STEP_SHARE * self._brush.radius_m)), 1), SPLIT_MAX))
