"""Adhesion: a sticky surface pulls on a tool that leaves it, until the tool breaks free.

    f = −A (r/δ) e^(1 − r/δ) r̂

r [m] is the displacement of the tool since it left, in the frame of the (possibly moving) body. There is no force while
the tool approaches. The pull starts at 0, has its maximum A [N] at the distance δ [m], and ends at `REACH` times δ,
where it is imperceptible. It is the gradient of the potential A e δ (1 − (1 + r/δ) e^(−r/δ)), so it never adds energy;
breaking free costs A e δ.

If the tool touches the surface again, the pull decays with the time constant `FADE_S`. A new pull starts only after the
old one has decayed, so the force has no steps. The pull ends if the body is teleported, removed or repainted.

Near the surface the pull acts as a spring of stiffness A e/δ without damping, which the device must render stably;
`hapscene.surface.device_clipping` increases δ if necessary.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.effect import Effect, Param, State

REACH: Final = 20.0
"""Distance at which the pull ends, in multiples of the range [1]; the force is then 1e-7 of its maximum."""

FADE_S: Final = 2e-3
"""Time constant with which the pull decays after a new contact [s]."""

GONE: Final = 0.01
"""Fraction of the pull below which it counts as ended [1]: 10 mN of a pull of 1 N."""


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the pull towards the point where the tool left the surface [N]."""
    if s.share == 0.0 and not touch.ended:
        return
    if touch.left_body < 0 or touch.tick != s.tick + 1.0:
        s.share = 0.0
    s.tick = touch.tick
    if touch.ended and touch.inside == 0 and touch.left_body >= 0:
        if s.share < GONE:
            s.share = 1.0 if p.adhesion_N > 0.0 and p.adhesion_range_m > 0.0 else 0.0
            s.most_N, s.range_m = p.adhesion_N, p.adhesion_range_m
            for i in range(3):
                s.way_m[i] = 0.0
        for i in range(3):
            s.from_m[i] = touch.p_WT_m[i] - touch.left_W_m[i] - s.way_m[i]
    if s.share == 0.0:
        return
    if touch.touching:
        s.share *= math.exp(-touch.tick_s / FADE_S)
    length2 = 0.0
    for i in range(3):
        s.way_m[i] = touch.p_WT_m[i] - touch.left_W_m[i] - s.from_m[i]
        length2 += s.way_m[i] * s.way_m[i]
    far = math.sqrt(length2) / s.range_m
    if far > REACH or s.share < GONE * GONE:
        s.share = 0.0
        return
    pull_N_m = s.share * s.most_N / s.range_m * math.exp(1.0 - far)
    for i in range(3):
        out.f_W_N[i] -= pull_N_m * s.way_m[i]


EFFECT = Effect(
    "adhesion",
    "Pulls on a tool that leaves the surface until it breaks free.",
    render,
    params=(
        Param("adhesion_N", 0.0, "N", "largest pull on a leaving tool", 0.0, 100.0),
        Param("adhesion_range_m", 0.0, "m", "distance of the largest pull", 0.0, 1.0),
    ),
    state=(
        State("share"),  # factor on the pull; 0: no pull
        State("tick"),  # last tick; a gap means that the surface was repainted in the meantime
        State("most_N"),
        State("range_m"),
        State("way_m", (3,)),  # displacement of the tool since it left
        State("from_m", (3,)),  # offset of the tool when it left
    ),
)
