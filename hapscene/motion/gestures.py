"""Gestures of a hand on a scene, as reference trajectories of the hand's target.

A hand presses by a target below the surface: a grip of stiffness k [N/m] needs a depth of F/k for a force F on a rigid
surface. A light grip has a deep target and is compliant; a firm grip has a shallow target and is stiff.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.device.sim.hand import Grip, grip_named
from hapscene.errors import PathError, no_such
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.motion.hand_path import HOVER_M, PathBuilder, explore
from hapscene.motion.look_from_above import UNSEEN, Line, Look, between, look_from_above, places_to_feel

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["GESTURES", "act"]

STROKE_N: Final = 0.6
"""Force of strokes and taps [N]. People explore textures with 0.3 to 1 N."""

PRESS_N: Final = 1.5
"""Force of a press [N]: half of the peak force of an Omni."""

SLOPE_MAX: Final = 0.25
"""Steepest slope at the ends of a line [1]. A compliant hand slides off a steeper slope."""

TOOL_KG: Final = 0.075
"""Mass of the tool that a gesture assumes [kg]: the largest of the named devices."""

CALM_PERIODS: Final = 1.5
"""Shortest movement in the air, in periods of the tool's oscillation on the spring of the grip [1]. With a third of it,
a tool in a light grip landed 12 mm beside its target, next to the bracket of the demo, and slid along its side."""


def act(name: str, scene: "Scene", tick_s: float, *, grip: str = "light") -> ReferenceTrajectory:
    """Create a gesture on the first body that is visible from above.

    Args:
        name: a name of `GESTURES`.
        scene: the scene.
        tick_s: period of a tick [s].
        grip: grip of the hand, a name of `hapscene.device.sim.hand.GRIPS`.

    Raises:
        HapsceneError: unknown gesture or grip, or a grip that does not hold the tool.
        PathError: no body has an outer face that points upwards.
    """
    if name not in GESTURES:
        raise PathError(no_such("gesture", name, GESTURES))
    held = grip_named(grip)
    if held.k_N_m == 0.0:
        raise PathError(f"grip {grip!r} does not hold the tool: choose light, medium or firm")
    if name == "explore":
        return ReferenceTrajectory.along(explore(scene, tick_s, STROKE_N / held.k_N_m, calm_s=calm_time_s(held)), held)
    place = _Place(scene, tick_s, calm_time_s(held))
    _AT_A_PLACE[name](place, held)
    place.hand.rest(0.5)  # in this time a limit cycle becomes visible
    return ReferenceTrajectory.along(place.hand.p_WT_m, held)


class _Place:
    """The place of a gesture: the best lines on the first visible body, and a tool path that starts above them."""

    def __init__(self, scene: "Scene", tick_s: float, calm_s: float) -> None:
        look = look_from_above(scene)
        lines, size_m = next(places_to_feel(scene, look), ([], 0.0))
        if not lines:
            raise PathError(f"{UNSEEN}; or use a recorded path: --hand follow --path hand.csv")
        self.line = _without_steep_ends(look, lines[0])
        self.middle_m = between(*self.line, 0.5)
        hover_m = min(HOVER_M, 0.2 * size_m)
        z_m = float(look(np.array([self.middle_m[0]]), np.array([self.middle_m[1]])).z_m[0])
        self.hand = PathBuilder((*self.middle_m, z_m + hover_m), tick_s, look, hover_m, calm_s)
        self.hand.rest(0.05)


def calm_time_s(grip: Grip) -> float:
    """Shortest movement that does not excite oscillations of the tool in a grip [s]."""
    return CALM_PERIODS * 2.0 * math.pi * math.sqrt((TOOL_KG + grip.mass_kg) / grip.k_N_m)


def _without_steep_ends(look: Look, line: Line) -> Line:
    """Shorten a line so that its first and last tenth are no steeper than `SLOPE_MAX`."""
    share = np.linspace(0.0, 1.0, 41)
    x_m, y_m = (line[0][k] + share * (line[1][k] - line[0][k]) for k in (0, 1))
    z_m = look(x_m, y_m).z_m
    rise_m = np.abs(z_m[4:] - z_m[:-4])
    gentle = np.flatnonzero(rise_m <= SLOPE_MAX * np.hypot(x_m[4] - x_m[0], y_m[4] - y_m[0]))
    if not len(gentle):
        return line
    return between(*line, share[gentle[0]]), between(*line, share[gentle[-1] + 4])


def _tap(place: _Place, grip: Grip) -> None:
    for share in (0.3, 0.5, 0.7):
        place.hand.tap(*between(*place.line, share), STROKE_N / grip.k_N_m)


def _press(place: _Place, grip: Grip) -> None:
    place.hand.press(*place.middle_m, PRESS_N / grip.k_N_m, hold_s=1.0)


def _stroke(place: _Place, grip: Grip) -> None:
    place.hand.stroke(*place.line, STROKE_N / grip.k_N_m)
    place.hand.stroke(*place.line[::-1], STROKE_N / grip.k_N_m)


def _scrub(place: _Place, grip: Grip) -> None:
    place.hand.scrub(between(*place.line, 0.3), between(*place.line, 0.7), 2 * STROKE_N / grip.k_N_m)


_AT_A_PLACE: Final[dict[str, Callable[[_Place, Grip], None]]] = {
    **{"tap": _tap, "press": _press, "stroke": _stroke, "scrub": _scrub},
}
"""Gestures at a place. Each extends the path of the hand."""

GESTURES: Final = (*_AT_A_PLACE, "explore")
"""Names of the gestures."""
