"""A hand made from parts: taps, presses and strokes, for the demo and for meshes without a recorded path.

Every movement follows the minimum-jerk profile that free human movement follows (Flash & Hogan 1985).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import PathError

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

HOVER_M: Final = 0.012
"""Height over the surface from which a movement begins and at which it ends [m]."""

DEPTH_M: Final = 0.0015
"""How deep taps, presses and strokes go [m]: 0.75 N on the default stiffness."""

STROKE_M_S: Final = 0.12
"""Mean speed of a stroke [m/s]: what people choose when they feel a texture."""

SMOOTH_S: Final = 0.006
"""Standard deviation of the smoothing of a stroke's height [s]: a hand makes no steps."""

CLIMB: Final = 3.0
"""Steepest slope that a stroke follows [1], 72°. What is steeper it climbs in the air, at this slope: a tool that is
dragged along below the top of a wall would be held by the wall, not stroke over it."""

LIFT: Final = 0.5
"""How far a stroke lifts off over a wall, as a fraction of its depth [1]; a wall is what is over a fifth of this."""

TRANSFER_M_S: Final = 0.3
"""Mean speed in the air, from one place to another [m/s]."""

WINDOW_M: Final = 0.2
"""Widest part of a body that is felt [m]: about what a hand reaches without moving the arm."""

GRID: Final = 25
"""Points along each side of the grid by which a body is looked at from above [count]."""

BODY_MAX: Final = 4
"""Most bodies that `explore` feels [count]: about three seconds each."""


@dataclass(frozen=True)
class View:
    """What is seen from above at k places."""

    z_m: NDArray[np.float64]
    """(k,) height of the surface, NaN where there is none."""
    body: NDArray[np.int64]
    """(k,) index of the body, −1 where there is none; likewise `swatch`."""
    swatch: NDArray[np.int64]


Look = Callable[[NDArray[np.float64], NDArray[np.float64]], View]
"""Looks down at x_m (k,), y_m (k,)."""


class Hand:
    """A path of the tool, built from movements of which each begins where the last one ended."""

    def __init__(self, p_WT_m: tuple[float, float, float], tick_s: float, look: Look, hover_m: float = HOVER_M) -> None:
        self._pieces: list[NDArray[np.float64]] = [np.array([p_WT_m], dtype=float)]
        self._tick_s = tick_s
        self._look = look
        self.hover_m = hover_m

    @property
    def p_WT_m(self) -> NDArray[np.float64]:
        """The path so far (n, 3) [m], a row per tick."""
        return np.concatenate(self._pieces)

    def move(self, to_m: tuple[float, float, float], duration_s: float) -> None:
        """Move straight to a point."""
        start_m = self._pieces[-1][-1]
        self._pieces.append(start_m + self._share(duration_s)[:, None] * (np.array(to_m) - start_m))

    def rest(self, duration_s: float) -> None:
        """Stay."""
        self._pieces.append(np.repeat(self._pieces[-1][-1:], len(self._share(duration_s)), axis=0))

    def tap(self, x_m: float, y_m: float, depth_m: float = DEPTH_M) -> None:
        """Go over a point, touch it shortly, come back."""
        self._press(x_m, y_m, depth_m, down_s=0.1, hold_s=0.0)

    def press(self, x_m: float, y_m: float, depth_m: float = 2 * DEPTH_M) -> None:
        """Go over a point, press it slowly, hold, come back."""
        self._press(x_m, y_m, depth_m, down_s=0.2, hold_s=0.2)

    def stroke(self, start_m: tuple[float, float], end_m: tuple[float, float], depth_m: float = DEPTH_M) -> None:
        """Stroke the surface along a line in x and y, from above its start to above its end."""
        span_m = np.subtract(end_m, start_m)
        share = self._share(max(float(np.hypot(*span_m)) / STROKE_M_S, 0.3))
        share = np.concatenate(([0.0], share))
        x_m, y_m = start_m[0] + share * span_m[0], start_m[1] + share * span_m[1]
        z_m = self._follow(x_m, y_m, depth_m)
        self._go_over(float(x_m[0]), float(y_m[0]), float(z_m[0]) + depth_m + self.hover_m)
        self.move((float(x_m[0]), float(y_m[0]), float(z_m[0])), 0.15)
        self._pieces.append(np.column_stack((x_m, y_m, z_m))[1:])
        self.move((float(x_m[-1]), float(y_m[-1]), float(z_m[-1]) + depth_m + self.hover_m), 0.12)

    def _press(self, x_m: float, y_m: float, depth_m: float, down_s: float, hold_s: float) -> None:
        z_m = float(self._look(np.array([x_m]), np.array([y_m])).z_m[0])
        self._go_over(x_m, y_m, z_m + self.hover_m)
        self.move((x_m, y_m, z_m - depth_m), down_s)
        if hold_s > 0:
            self.rest(hold_s)
        self.move((x_m, y_m, z_m + self.hover_m), down_s)

    def _go_over(self, x_m: float, y_m: float, z_m: float) -> None:
        """Move to a point in the air: up, across above all that lies between, down."""
        here_m = self._pieces[-1][-1]
        way_m = np.linspace(here_m[:2], (x_m, y_m), 50)
        top_m = float(np.nanmax(np.append(self._look(way_m[:, 0], way_m[:, 1]).z_m, -np.inf)))
        safe_m = max(top_m + self.hover_m / 2, float(here_m[2]), z_m)
        for point_m in ((here_m[0], here_m[1], safe_m), (x_m, y_m, safe_m), (x_m, y_m, z_m)):
            far_m = float(np.linalg.norm(np.subtract(point_m, self._pieces[-1][-1])))
            if far_m > self.hover_m * 1e-3:
                self.move(point_m, float(np.clip(far_m / TRANSFER_M_S, 0.08, 0.6)))

    def _share(self, duration_s: float) -> NDArray[np.float64]:
        """How much of a movement is done at each of its ticks, its start left out, 0 … 1: minimum jerk."""
        count = max(round(duration_s / self._tick_s), 1)
        s = np.arange(1, count + 1) / count
        return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))

    def _follow(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64], depth_m: float) -> NDArray[np.float64]:
        """Heights of a stroke: `depth_m` below the surface, off it where it is steeper than `CLIMB`, and smooth."""
        from scipy.ndimage import gaussian_filter1d, maximum_filter1d

        z_m = self._look(x_m, y_m).z_m
        seen = np.flatnonzero(np.isfinite(z_m))
        z_m = np.interp(np.arange(len(z_m)), seen, z_m[seen])
        rise_m = CLIMB * np.hypot(np.diff(x_m), np.diff(y_m))
        over_m = _climbed(_climbed(z_m, rise_m)[::-1], rise_m[::-1])[::-1]
        sigma = SMOOTH_S / self._tick_s
        lift_m = LIFT * depth_m
        lifted = maximum_filter1d((over_m - z_m > 0.2 * lift_m).astype(float), 2 * int(3 * sigma) + 1)
        return np.asarray(gaussian_filter1d(over_m - depth_m + lifted * (depth_m + lift_m), sigma, mode="nearest"))


def _climbed(z_m: NDArray[np.float64], rise_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The lowest heights at or over `z_m` (n,) that fall from one to the next by at most `rise_m` (n − 1,)."""
    over_m = z_m.copy()
    for k, most_m in enumerate(rise_m):
        over_m[k + 1] = max(over_m[k + 1], over_m[k] - most_m)
    return over_m


def explore(scene: "Scene", tick_s: float) -> NDArray[np.float64]:
    """A hand that feels a scene from above: on each body a tap, a press, and two strokes.

    The strokes go where they cross the most borders between swatches. The path follows from the scene alone.

    Args:
        scene: with one body or more; the first `BODY_MAX` that can be seen from above are felt.
        tick_s: period of a tick [s].

    Returns:
        p_WT (n, 3) [m].

    Raises:
        PathError: no body shows an outer face upwards.
    """
    look = look_from_above(scene)
    hand: Hand | None = None
    felt_count = 0
    for index, body in enumerate(scene.bodies):
        window_m = _window(_bounds(body))
        rows = _lines(look, index, window_m)
        if len(rows) < 2 or felt_count == BODY_MAX:
            continue
        felt_count += 1
        first, second = rows
        size_m = float(np.min(window_m[1] - window_m[0]))
        depth_m, hover_m = min(DEPTH_M, 0.05 * size_m), min(HOVER_M, 0.2 * size_m)
        x_m, y_m = _between(*first, 0.2)
        if hand is None:
            z_m = float(look(np.array([x_m]), np.array([y_m])).z_m[0])
            hand = Hand((x_m, y_m, z_m + 2 * hover_m), tick_s, look)
            hand.rest(0.1)
        hand.hover_m = hover_m
        hand.tap(x_m, y_m, depth_m)
        hand.tap(*_between(*first, 0.8), depth_m)
        hand.press(*_between(*second, 0.5), 2 * depth_m)
        hand.stroke(*first, depth_m)
        hand.stroke(*second, depth_m)
    if hand is None:
        raise PathError("no body shows an outer face upwards, so no path can be made up; give one by --path")
    hand.rest(0.2)
    return hand.p_WT_m


def look_from_above(scene: "Scene") -> Look:
    """A function that looks down on the scene. What turns its inner side up is not seen, unless two-sided.

    Through trimesh's rays: float32, good to a micrometre at a scene's size, which is enough to aim.
    """
    top_m = max(float(_bounds(body)[1, 2]) for body in scene.bodies) + 1.0
    casters = {id(body.mesh): _caster(body.mesh) for body in scene.bodies}

    def look(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> View:
        count = len(x_m)
        z_m, seen_body, swatch = np.full(count, np.nan), np.full(count, -1), np.full(count, -1)
        start_m = np.column_stack((x_m, y_m, np.full(count, top_m)))
        for index, body in enumerate(scene.bodies):
            R_WB, p_WB = body.X_WB[:3, :3], body.X_WB[:3, 3]
            down_B = np.tile(-R_WB[2], (count, 1))
            at_m, ray, face = casters[id(body.mesh)].intersects_location(
                (start_m - p_WB) @ R_WB, down_B, multiple_hits=False
            )
            up = body.mesh.normals[face] @ R_WB[2]
            height_m = at_m @ R_WB[2] + p_WB[2]
            better = ((up > 0.05) | body.two_sided) & ~(height_m <= z_m[ray])
            ray = ray[better]
            z_m[ray], seen_body[ray] = height_m[better], index
            swatch[ray] = body.face_swatch[face[better]]
        return View(z_m, seen_body, swatch)

    return look


def _caster(mesh: Any) -> Any:
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    return RayMeshIntersector(trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False))


def _bounds(body: Any) -> NDArray[np.float64]:
    """Lowest and highest corner of the body in W (2, 3) [m]."""
    low_m, high_m = body.mesh.bounds_m
    corners_m = np.array(
        [[x, y, z] for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1]) for z in (low_m[2], high_m[2])]
    )
    corners_m = corners_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]
    return np.array([corners_m.min(axis=0), corners_m.max(axis=0)])


def _window(bounds_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of a body's extent in x and y that is felt (2, 2) [m]."""
    middle_m, half_m = bounds_m[:, :2].mean(axis=0), np.ptp(bounds_m[:, :2], axis=0) / 2
    half_m = np.minimum(half_m * 0.96, WINDOW_M / 2)
    return np.array([middle_m - half_m, middle_m + half_m])


def _lines(
    look: Look, body: int, window_m: NDArray[np.float64]
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The best line to stroke along x and the best along y; fewer where the body is not seen."""
    x_m, y_m = (np.linspace(window_m[0, k], window_m[1, k], GRID) for k in (0, 1))
    X_m, Y_m = np.meshgrid(x_m, y_m)
    view = look(X_m.ravel(), Y_m.ravel())
    seen = (view.body == body).reshape(GRID, GRID)
    swatch = view.swatch.reshape(GRID, GRID)
    lines = []
    for mask, colour, along_x in ((seen, swatch, True), (seen.T, swatch.T, False)):
        runs = [_longest_run(row) for row in mask]
        scores = [_score(colour[k, a:b], k) if b - a > 2 else -1.0 for k, (a, b) in enumerate(runs)]
        best = int(np.argmax(scores))
        if scores[best] < 0:
            continue
        a, b = runs[best]
        inset = 1 if b - a > 6 else 0  # not from the very edge
        ends = (a + inset, b - 1 - inset)
        place = [(X_m[best, k], Y_m[best, k]) if along_x else (X_m[k, best], Y_m[k, best]) for k in ends]
        lines.append(((float(place[0][0]), float(place[0][1])), (float(place[1][0]), float(place[1][1]))))
    return lines


def _score(swatch: NDArray[np.int64], row: int) -> float:
    """How much there is to feel on a line: borders first, then length, then nearness to the middle."""
    return 10.0 * np.count_nonzero(np.diff(swatch)) + len(swatch) / GRID - abs(row - GRID // 2) / GRID


def _longest_run(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Start and end of the longest unbroken run of True."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if not len(edges):
        return 0, 0
    start, end = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    return int(start), int(end)


def _between(start_m: tuple[float, float], end_m: tuple[float, float], share: float) -> tuple[float, float]:
    x_m, y_m = np.add(start_m, share * np.subtract(end_m, start_m))
    return float(x_m), float(y_m)
