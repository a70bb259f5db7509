"""Adhesion: what leaves a sticky surface is held back until it is torn off.

    f = −A (r/δ) e^(1 − r/δ) r̂

with the way r [m] of the tool since it left, on the body that it left, as that moves. Nothing is felt on the way in;
the pull begins at no force, is at its most, A [N], at the distance δ [m], and is over at `REACH` times δ, where it is
too weak to be felt. It is the gradient of the potential A e δ (1 − (1 + r/δ) e^(−r/δ)) that begins at 0: what it gives
back was put in, whichever way the tool goes, and a tool that is torn off loses A e δ.

A tool that touches again while it is held is let go within some `FADE_S`. Until the old hold has gone a new one does
not begin: neither steps. Where the body is put elsewhere, removed or painted anew, nothing holds any more.

Near the surface it is a spring of A e/δ, which the device must bear without damping (`hapscene.surface.device_clipping`
widens δ where it does not).
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.effect import Effect, Param, State

REACH: Final = 20.0
"""Distance at which it is over, in ranges [1]: a force of 1e-7 of the largest is left."""

FADE_S: Final = 2e-3
"""Time constant in which a new contact ends an old hold [s]: a step spread over some ticks."""

GONE: Final = 0.01
"""Share of a hold that counts as none [1]: of a pull of a newton, 10 mN."""


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the pull towards where the tool left [N]."""
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
    "Holds back a tool that leaves until it is torn off.",
    render,
    params=(
        Param("adhesion_N", 0.0, "N", "largest pull on a tool that leaves", 0.0, 100.0),
        Param("adhesion_range_m", 0.0, "m", "distance at which it pulls so", 0.0, 1.0),
    ),
    state=(
        State("share"),  # of the hold that is left; 0 is none
        State("tick"),  # in which it was asked last: a surface that is painted anew has none in the air
        State("most_N"),
        State("range_m"),
        State("way_m", (3,)),  # the tool's since it left
        State("from_m", (3,)),  # where it began, from where it left
    ),
)
