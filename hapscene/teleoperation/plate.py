"""A plate, and a hand that explores it by taps, a press and strokes."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.device.sim.hand import grip_named
from hapscene.errors import HapsceneError
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.motion.hand_path import PathBuilder
from hapscene.motion.look_from_above import TopView
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

__all__ = ["START_M", "explore", "plate"]

SIDE_M: Final = 0.2
"""Side of the plate [m]: wider than an Omni reaches."""

THICK_M: Final = 0.02
"""Thickness of the plate [m]. A tool that penetrates 2 cm comes out below."""

HOVER_M: Final = 0.006
"""Height of the hand above the plate at the start and at the end [m]."""

START_M: Final = (0.0, 0.0, HOVER_M)
"""Start position of both tools in W [m]; the top of the plate is z = 0."""

PRESS_N: Final = 1.0
"""Pressing force of the hand [N]: people press with 0.3 to 1 N to feel a texture."""

SPAN_M: Final = 0.03
"""Half the length of a stroke [m]; an Omni reaches 8 cm to either side."""

REST_S: Final = 1.5
"""Time for which the hand is at rest at the end [s]."""


class Gesture(NamedTuple):
    """A reference trajectory, and the first and last tick of each part by the part's name."""

    intent: ReferenceTrajectory
    parts: dict[str, list[tuple[int, int]]]


def plate(swatch: str | Swatch) -> Scene:
    """A scene of one plate, its top at z = 0."""
    half = SIDE_M / 2
    corners = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-THICK_M, 0.0)]
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    scene = Scene()
    scene.add(Mesh(np.array(corners), np.array(faces, np.int32)), name="plate", swatch=swatch)
    return scene


def explore(grip: str, give_N_m: float, taps: int = 3, strokes: int = 4) -> Gesture:
    """Return a gesture of taps, a press and strokes in both directions that ends at rest where it began.

    Args:
        grip: grip of the hand; a name of `hapscene.device.sim.hand.GRIPS` that has a stiffness.
        give_N_m: stiffness of everything between hand and plate; the target of the hand is deeper by its compression.
        taps, strokes: numbers of taps (at least 2) and strokes (at most 5); the haptography paper has two and five.

    Raises:
        HapsceneError: unknown grip, or a grip without stiffness.
    """
    hand, held = PathBuilder(START_M, TICK_S, _flat, HOVER_M), grip_named(grip)
    if held.k_N_m == 0.0:
        raise HapsceneError(f"grip {grip!r} does not hold the tool; expected light, medium or firm")
    depth_m = PRESS_N * (1.0 / held.k_N_m + 1.0 / give_N_m)
    parts: dict[str, list[tuple[int, int]]] = {"tap": [], "stroke": []}
    hand.rest(0.2)
    for x_m in np.linspace(-0.02, 0.02, taps).tolist():
        start = hand.tick_count
        hand.tap(x_m, 0.0, depth_m)
        parts["tap"].append((start, hand.tick_count))
    hand.press(0.0, 0.0, depth_m, hold_s=0.3)
    way = np.concatenate([hand.line((a, 0.0), (-a, 0.0), speed) for a, speed in STROKES[:strokes]])
    start, _ = hand.trace(way, depth_m)
    parts["stroke"].append((start, start + len(way)))
    hand.move(START_M, 0.4)
    hand.rest(REST_S)
    return Gesture(ReferenceTrajectory.along(hand.p_WT_m, grip), parts)


STROKES: Final = ((-SPAN_M, 0.06), (SPAN_M, 0.1), (-SPAN_M, 0.15), (SPAN_M, 0.2), (-SPAN_M, 0.1))
"""Start of each stroke [m], and its mean speed [m/s]."""


def _flat(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> TopView:
    """The height map of the plate."""
    count = len(x_m)
    return TopView(np.zeros(count), np.zeros(count, np.int64), np.zeros(count, np.int64))
