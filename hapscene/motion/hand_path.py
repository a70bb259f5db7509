"""Synthetic tool paths of taps, presses and strokes, for the demo and for meshes without a recorded path.

Each movement has a minimum-jerk profile, as free human movements (Flash & Hogan 1985).
"""

from itertools import islice
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import PathError
from hapscene.motion.look_from_above import UNSEEN, Look, between, look_from_above, places_to_feel

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["HOVER_M", "STROKE_M_S", "PathBuilder", "explore"]

HOVER_M: Final = 0.012
"""Height above the surface at which movements start and end [m]."""

DEPTH_M: Final = 0.0015
"""Penetration depth of taps, presses and strokes [m]: 0.75 N with the default stiffness."""

STROKE_M_S: Final = 0.12
"""Mean speed of a stroke [m/s], as people explore textures."""

SCRUB_M_S: Final = 0.25
"""Mean speed of scrubbing [m/s]."""

SMOOTH_S: Final = 0.006
"""Standard deviation of the smoothing of a stroke's height [s]. A hand does not move in steps."""

CLIMB: Final = 3.0
"""Steepest slope that a stroke follows [1], 72°. Steeper walls are climbed in the air at this slope, since a tool
dragged along below the top of a wall would be held by the wall."""

LIFT: Final = 0.5
"""Height of a stroke above a wall, relative to its depth [1]. A rise above a fifth of this height counts as a wall."""

TRANSFER_M_S: Final = 0.3
"""Mean speed of a movement in the air [m/s]."""

BODY_MAX: Final = 4
"""Most bodies that `explore` visits [count], about three seconds each."""


class PathBuilder:
    """Builds a path of the tool from movements. Each movement starts at the end of the last one.

    Args:
        p_WT_m: start position.
        tick_s: period of a tick [s].
        look: view of the scene from above.
        hover_m: height above the surface at which movements start and end.
        calm_s: for a tool on the spring of a grip, the shortest movement that does not excite oscillations [s]. No
            movement in the air is shorter, and a trace slows down where it climbs. 0 for an ideal position source.
    """

    def __init__(
        self,
        p_WT_m: tuple[float, float, float],
        tick_s: float,
        look: Look,
        hover_m: float = HOVER_M,
        calm_s: float = 0.0,
    ) -> None:
        self._calm_s = calm_s
        self._pieces: list[NDArray[np.float64]] = [np.array([p_WT_m], dtype=float)]
        self._tick_s = tick_s
        self._look = look
        self.hover_m = hover_m

    @property
    def p_WT_m(self) -> NDArray[np.float64]:
        """The path so far (n, 3) [m], one row a tick."""
        return np.concatenate(self._pieces)

    @property
    def tick_count(self) -> int:
        """Number of ticks so far."""
        return sum(len(piece) for piece in self._pieces)

    def move(self, to_m: tuple[float, float, float], duration_s: float) -> None:
        """Move to a point in a straight line."""
        start_m = self._pieces[-1][-1]
        self._pieces.append(start_m + self._share(duration_s)[:, None] * (np.array(to_m) - start_m))

    def rest(self, duration_s: float) -> None:
        """Stay at the current position."""
        self._pieces.append(np.repeat(self._pieces[-1][-1:], len(self._share(duration_s)), axis=0))

    def tap(self, x_m: float, y_m: float, depth_m: float = DEPTH_M) -> None:
        """Move above a point, touch it briefly, and return."""
        self._press(x_m, y_m, depth_m, down_s=0.1, hold_s=0.0)

    def press(self, x_m: float, y_m: float, depth_m: float = 2 * DEPTH_M, hold_s: float = 0.2) -> None:
        """Move above a point, press slowly, hold, and return."""
        self._press(x_m, y_m, depth_m, 0.2, hold_s)

    def stroke(self, start_m: tuple[float, float], end_m: tuple[float, float], depth_m: float = DEPTH_M) -> None:
        """Stroke the surface along a line in x and y, from above its start to above its end."""
        self.trace(self.line(start_m, end_m, STROKE_M_S), depth_m)

    def scrub(self, start_m: tuple[float, float], end_m: tuple[float, float], depth_m: float, count: int = 4) -> None:
        """Move back and forth along a line `count` times, without lifting."""
        way = self.line(start_m, end_m, SCRUB_M_S)
        self.trace(np.concatenate([way if k % 2 == 0 else way[::-1] for k in range(2 * count)]), depth_m)

    def trace(
        self, way_m: NDArray[np.float64], depth_m: float | NDArray[np.float64]
    ) -> tuple[int, NDArray[np.float64]]:
        """Follow the surface along a curve (k, 2), one row a tick, from above its start to above its end.

        Args:
            way_m: the curve in x and y [m].
            depth_m: penetration depth, one value or (k,) [m].

        Returns:
            The tick at which the curve starts; and for each tick from there on the row of the curve, with fractions
            between rows where the hand slows down.
        """
        depths_m = np.broadcast_to(depth_m, len(way_m))
        way = np.column_stack((way_m, self._follow(way_m[:, 0], way_m[:, 1], depths_m)))
        rows = np.arange(len(way), dtype=float)
        if self._calm_s > 0.0:
            rows = _slowed(way)
            way = np.column_stack([np.interp(rows, np.arange(len(way)), column) for column in way.T])
        (x0, y0, z0), (x1, y1, z1) = way[0].tolist(), way[-1].tolist()
        self._go_over(x0, y0, z0 + float(depths_m[0]) + self.hover_m)
        self.move((x0, y0, z0), max(0.15, self._calm_s))
        start = self.tick_count - 1
        self._pieces.append(way[1:])
        self.move((x1, y1, z1 + float(depths_m[-1]) + self.hover_m), max(0.12, self._calm_s))
        return start, rows

    def line(self, start_m: tuple[float, float], end_m: tuple[float, float], speed_m_s: float) -> NDArray[np.float64]:
        """A line in x and y (k, 2) at a mean speed, one row a tick."""
        span_m = np.subtract(end_m, start_m)
        share = self._share(max(float(np.hypot(*span_m)) / speed_m_s, 0.3))
        return np.asarray(start_m + np.append(0.0, share)[:, None] * span_m)

    def _press(self, x_m: float, y_m: float, depth_m: float, down_s: float, hold_s: float) -> None:
        z_m = float(self._look(np.array([x_m]), np.array([y_m])).z_m[0])
        self._go_over(x_m, y_m, z_m + self.hover_m)
        self.move((x_m, y_m, z_m - depth_m), down_s)
        if hold_s > 0:
            self.rest(hold_s)
        self.move((x_m, y_m, z_m + self.hover_m), down_s)

    def _go_over(self, x_m: float, y_m: float, z_m: float) -> None:
        """Move to a point in the air: up, across above all obstacles, down."""
        here_m = self._pieces[-1][-1]
        way_m = np.linspace(here_m[:2], (x_m, y_m), 50)
        top_m = float(np.nanmax(np.append(self._look(way_m[:, 0], way_m[:, 1]).z_m, -np.inf)))
        safe_m = max(top_m + self.hover_m / 2, float(here_m[2]), z_m)
        for point_m in ((here_m[0], here_m[1], safe_m), (x_m, y_m, safe_m), (x_m, y_m, z_m)):
            far_m = float(np.linalg.norm(np.subtract(point_m, self._pieces[-1][-1])))
            if far_m > self.hover_m * 1e-3:
                self.move(point_m, max(float(np.clip(far_m / TRANSFER_M_S, 0.08, 0.6)), self._calm_s))

    def _share(self, duration_s: float) -> NDArray[np.float64]:
        """Minimum-jerk profile: the completed share of a movement at each of its ticks, 0 … 1, without the start."""
        count = max(round(duration_s / self._tick_s), 1)
        s = np.arange(1, count + 1) / count
        return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))

    def _follow(
        self, x_m: NDArray[np.float64], y_m: NDArray[np.float64], depth_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Smoothed heights of a stroke: `depth_m` (k,) below the surface, and above it where it is steeper than
        `CLIMB`."""
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


def _slowed(way_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of a curve (k, 3) for each tick that limit its speed to the largest speed in x and y.

    A hand that climbs a wall at the speed of a stroke would throw a loosely held tool off the surface.
    """
    step_m = np.linalg.norm(np.diff(way_m, axis=0), axis=1)
    most_m = max(float(np.hypot(*np.diff(way_m[:, :2], axis=0).T).max(initial=0.0)), 1e-12)
    tick = np.append(0.0, np.cumsum(np.maximum(step_m / most_m, 1.0)))
    return np.interp(np.arange(np.ceil(tick[-1] - 1e-9) + 1.0), tick, np.arange(len(way_m)))


def _climbed(z_m: NDArray[np.float64], rise_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The lowest heights ≥ `z_m` (n,) that decrease from one to the next by at most `rise_m` (n − 1,)."""
    over_m = z_m.copy()
    for k, most_m in enumerate(rise_m):
        over_m[k + 1] = max(over_m[k + 1], over_m[k] - most_m)
    return over_m


def explore(scene: "Scene", tick_s: float, depth_m: float | None = None, *, calm_s: float = 0.0) -> NDArray[np.float64]:
    """Create a tool path that explores a scene from above: two taps, a press and two strokes on each body.

    The strokes cross as many borders between swatches as possible. The path depends on the scene only.

    Args:
        scene: scene with one body or more. The first `BODY_MAX` that are visible from above are explored.
        tick_s: period of a tick [s].
        depth_m: penetration depth of taps and strokes [m]; by default `DEPTH_M`, or a twentieth of a small body's size.
        calm_s: as for `PathBuilder` [s].

    Returns:
        p_WT (n, 3) [m].

    Raises:
        PathError: no body has an outer face that points upwards.
    """
    look = look_from_above(scene)
    hand: PathBuilder | None = None
    for (first, second), size_m in islice(places_to_feel(scene, look), BODY_MAX):
        hover_m = min(HOVER_M, 0.2 * size_m)
        deep_m = min(DEPTH_M, 0.05 * size_m) if depth_m is None else depth_m
        x_m, y_m = between(*first, 0.2)
        if hand is None:
            z_m = float(look(np.array([x_m]), np.array([y_m])).z_m[0])
            hand = PathBuilder((x_m, y_m, z_m + 2 * hover_m), tick_s, look, calm_s=calm_s)
            hand.rest(0.1)
        hand.hover_m = hover_m
        hand.tap(x_m, y_m, deep_m)
        hand.tap(*between(*first, 0.8), deep_m)
        hand.press(*between(*second, 0.5), 2 * deep_m)
        hand.stroke(*first, deep_m)
        hand.stroke(*second, deep_m)
    if hand is None:
        raise PathError(f"{UNSEEN}; or use a recorded path: --path FILE")
    hand.rest(0.2)
    return hand.p_WT_m
