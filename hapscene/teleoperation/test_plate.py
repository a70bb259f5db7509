"""What is touched in the experiments, and the hand that touches it: a flat plate, taps, a press and strokes."""

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

__all__ = ["START_M", "Gesture", "explore", "plate"]

SIDE_M: Final = 0.2
"""Side of the plate [m]: wider than an Omni reaches."""

THICK_M: Final = 0.02
"""Thickness of the plate [m]: a tool that is pushed 2 cm deep comes out below."""

HOVER_M: Final = 0.006
"""Height over the plate at which a hand begins and ends [m]."""

START_M: Final = (0.0, 0.0, HOVER_M)
"""Where both tools are at the start, in W [m]: the plate's top is z = 0."""

PRESS_N: Final = 1.0
"""What the hand presses with [N]: people who feel a texture press with 0.3 to 1 N."""

SPAN_M: Final = 0.03
"""Half a stroke's length [m]: an Omni reaches 8 cm to either side."""

REST_S: Final = 1.5
"""How long the hand is still at the end [s]."""


class Gesture(NamedTuple):
    """What a hand means to do, and when: first and last tick of each part by its name."""

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
    """Taps, a press, strokes to and fro, and rest where it began.

    Args:
        grip: how firmly the tool is held; a name of `hapscene.device.sim.hand.GRIPS` with a spring.
        give_N_m: stiffness of all that gives between the hand and the plate: to press, it aims so much deeper.
        taps, strokes: how many, 2 or more and up to 5; the haptography paper has two taps and five drags.

    Raises:
        HapsceneError: no such grip, or one without a spring.
    """
    hand, held = PathBuilder(START_M, TICK_S, _flat, HOVER_M), grip_named(grip)
    if held.k_N_m == 0.0:
        raise HapsceneError(f"a hand with grip {grip!r} does not hold the tool; choose light, medium or firm")
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
"""Where each stroke begins [m], and its mean speed [m/s]."""


def _flat(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> TopView:
    """The plate as it is seen from above."""
    count = len(x_m)
    return TopView(np.zeros(count), np.zeros(count, np.int64), np.zeros(count, np.int64))
