"""The brush: the path of a stroke over the surface, its mirror images and rotations."""

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

__all__ = ["NONE", "Brush", "Stroke", "Symmetry"]

TURNS_MAX: Final = 64
"""Most images around an axis [count]."""


@dataclass(frozen=True)
class Symmetry:
    """Mirrors and turns, through the middle of a body, along its axes.

    Attributes:
        mirrors: axes, of "xyz", that are mirrored: "x" paints right what is painted left.
        turns: how many images there are around the axis; 1 for none.
        axis: "x", "y" or "z".

    Raises:
        SceneError: an axis is none, or there are too many turns.
    """

    mirrors: str = ""
    turns: int = 1
    axis: str = "z"

    def __post_init__(self) -> None:
        if not set(self.mirrors) <= set("xyz") or self.axis not in ("x", "y", "z"):
            raise SceneError(f"an axis is x, y or z; the mirrors are {self.mirrors!r}, the axis is {self.axis!r}")
        if not 1 <= self.turns <= TURNS_MAX:
            raise SceneError(f"there are 1 to {TURNS_MAX} images around an axis, not {self.turns}")

    def images_W(self, body: Body) -> list[NDArray[np.float64]]:
        """Maps (4, 4) in W from a place to each of its images; the first is where it is itself."""
        around = "xyz".index(self.axis)
        i, j = (around + 1) % 3, (around + 2) % 3
        maps = []
        for k in range(self.turns):
            c, s = math.cos(2 * math.pi * k / self.turns), math.sin(2 * math.pi * k / self.turns)
            turn = np.eye(3)
            turn[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
            maps.append(turn)
        for axis in sorted(set(self.mirrors)):
            mirror = np.eye(3)
            mirror["xyz".index(axis), "xyz".index(axis)] = -1.0
            maps += [mirror @ found for found in maps]
        different: list[NDArray[np.float64]] = []
        for found in maps:  # an even number of turns has some mirrors' images already
            if not any(np.allclose(found, other) for other in different):
                different.append(found)
        used_m = body.mesh.vertices_m[np.unique(body.mesh.faces)] if different[1:] else np.zeros((1, 3))
        middle_m = (used_m.min(axis=0) + used_m.max(axis=0)) / 2
        X_BW = np.linalg.inv(body.X_WB)
        return [body.X_WB @ _about(found, middle_m) @ X_BW for found in different]


NONE: Final = Symmetry()
"""Each place is its only image."""


def _about(R: NDArray[np.float64], middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The map (4, 4) that turns or mirrors about a point (3,)."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = R, middle_m - R @ middle_m
    return found


Ray = tuple[NDArray[np.float64], NDArray[np.float64]]
"""From where (3,) [m], and which way (3,), a unit vector."""

SPLIT_MAX: Final = 64
"""Most pieces that one move of the pointer is split into [count]: a sweep over a window's width at some 20 pixels."""

STEP_SHARE: Final = 0.5
"""Longest way between two places of a stroke before the move is split, in radii of the brush [1]: a surface curved like
the brush itself is left by 3 % of the radius."""


@dataclass(frozen=True)
class Brush:
    """A brush.

    Attributes:
        radius_m: how far it paints [m].
        softness: what share of the radius its border goes over, inwards [0, 1]: 0 is sharp.
        opacity: how much of its swatch it puts over what is there [0, 1].
        through: whether it paints all that is within its radius: also what the eye does not see.
        symmetry: where else it paints.

    Raises:
        SceneError: a number is out of its range.
    """

    radius_m: float
    softness: float = 0.0
    opacity: float = 1.0
    through: bool = False
    symmetry: Symmetry = NONE

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius_m) and self.radius_m > 0.0):
            raise SceneError(f"a brush's radius must be above 0 mm, is {self.radius_m * 1e3:g} mm")
        if not (0.0 <= self.softness <= 1.0 and 0.0 < self.opacity <= 1.0):
            raise SceneError(
                f"softness is 0 to 1 and opacity above 0 to 1, they are {self.softness:g} and {self.opacity:g}"
            )


@dataclass(eq=False)
class _Tip:
    """The brush itself, or one of its images: where it was last, and the ray that led there."""

    image_W: NDArray[np.float64]
    last: Hit | None = None
    ray: Ray | None = field(default=None, repr=False)


class Stroke:
    """Where the brush goes while it is down: opens a step of the painting, and paints in it at once.

    Raises:
        SceneError: no such swatch.
    """

    def __init__(self, painting: Painting, swatch: int | str, brush: Brush) -> None:
        painting.begin_step("eraser" if swatch == ERASE else "brush", swatch)
        self._painting, self._brush = painting, brush
        self._tips: list[_Tip] = []

    def to(self, hit: Hit | None) -> int:
        """Draw to a place, or lift the brush: see `Session.stroke_to`."""
        tips = self._tips_of(hit)
        count = self._draw(tips[0], [hit])
        for tip in tips[1:]:
            image = hit
            if hit is not None:
                R, above_W_m = tip.image_W[:3, :3], hit.p_W_m + self._brush.radius_m * hit.nhat_W
                image = self._pick(hit, R @ above_W_m + tip.image_W[:3, 3], -R @ hit.nhat_W)
            count += self._draw(tip, [image])
        return count

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """Draw to where a ray from the eye meets the surface: see `Session.drag_to`."""
        hit = self._painting.pick(origin_W_m, direction_W, seen=True)
        origin, direction = np.asarray(origin_W_m, np.float64), np.asarray(direction_W, np.float64)
        length = float(np.linalg.norm(direction))
        if length > 0.0:
            for tip in self._tips_of(hit):
                R = tip.image_W[:3, :3]
                self._drag(tip, (R @ origin + tip.image_W[:3, 3], R @ direction / length), hit)
        return hit

    def _drag(self, tip: _Tip, ray: Ray, first: Hit | None) -> None:
        hit = self._pick(first, *ray)
        way: list[Hit | None] = []
        if tip.ray is not None:
            (o, d), count = tip.ray, self._pieces(tip, ray, hit)
            shares = np.arange(1, count) / count
            way = [self._pick(first, o + share * (ray[0] - o), d + share * (ray[1] - d)) for share in shares]
        tip.ray = ray
        self._draw(tip, [*way, hit], ray[0])

    def _pick(self, first: Hit | None, origin_W_m: NDArray[np.float64], direction_W: NDArray[np.float64]) -> Hit | None:
        """What a tip's ray meets; of an image, on the body that the brush itself is on."""
        hit = self._painting.pick(origin_W_m, direction_W, seen=True)
        return hit if len(self._tips) == 1 or (hit and first and hit.body == first.body) else None

    def _tips_of(self, hit: Hit | None) -> list[_Tip]:
        """The brush and its images, which are those of the body that it met first."""
        if not self._tips or (hit is not None and len(self._tips) == 1 and self._brush.symmetry != NONE):
            bodies, symmetry = self._painting.scene.bodies, self._brush.symmetry
            images = [np.eye(4)] if hit is None else symmetry.images_W(bodies[hit.body])
            known = self._tips[:1]
            self._tips = [*known, *map(_Tip, images[len(known) :])]
        return self._tips

    def _draw(self, tip: _Tip, way: list[Hit | None], eye_W_m: NDArray[np.float64] | None = None) -> int:
        """Paint from where a tip was over places, lifted at each None; how many faces it reached."""
        count, line = 0, [tip.last] if tip.last is not None else []
        for hit in way:
            if line and (hit is None or hit.body != line[0].body):
                count += self._paint(line, eye_W_m) if line != [tip.last] else 0
                line = []
            if hit is not None:
                line.append(hit)
        count += self._paint(line, eye_W_m) if line and line != [tip.last] else 0
        tip.last = way[-1]
        return count

    def _paint(self, line: list[Hit], eye_W_m: NDArray[np.float64] | None) -> int:
        """Paint along places on one body; how many faces it reached."""
        brush, body, shape = self._brush, line[0].body, self._painting.shapes[line[0].body]
        falloff_m = brush.softness * brush.radius_m  # inwards: nothing outside of the ring
        points_m = np.array([hit.p_B_m for hit in line])
        region = Tube(points_m, brush.radius_m - falloff_m / 2)
        if brush.through:
            faces: NDArray[np.integer] = shape.near(Tube(points_m, brush.radius_m))
            return self._painting.paint_region(body, region, faces, falloff_m, brush.opacity)
        ends = pairwise(line) if len(line) > 1 else [(line[0], line[0])]
        touched = [shape.brush((a.face, b.face), (a.p_B_m, b.p_B_m), brush.radius_m) for a, b in ends]
        faces = np.unique(np.concatenate(touched))
        return self._painting.paint_region(body, region, faces, falloff_m, brush.opacity, eye_W_m=eye_W_m)

    def _pieces(self, tip: _Tip, now: Ray, hit: Hit | None) -> int:
        """How many pieces a move is split into."""
        known = [h for h in (hit, tip.last) if h is not None]
        was = tip.ray
        if not known or was is None:
            return 1
        depth_m = max(h.distance_m for h in known)
        way_m = float(np.linalg.norm(now[0] - was[0])) + depth_m * float(np.linalg.norm(now[1] - was[1]))
        if len(known) == 2:
            way_m = max(way_m, float(np.linalg.norm(known[0].p_W_m - known[1].p_W_m)))
        return int(min(max(math.ceil(way_m / (STEP_SHARE * self._brush.radius_m)), 1), SPLIT_MAX))
