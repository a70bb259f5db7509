"""Blends of two swatches: finds the paint at a point of a face, and cross-fades between swatches.

Effects do not handle blends. They have two states, in *banks*: each swatch of a blend uses one bank as long as it is
rendered. A stroke from one pure swatch through a blend into another thus never resets the state of an effect.
"""

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import BLEND_S
from hapscene.records import Records
from hapscene.surface.surface_arrays import CLEARED

__all__ = ["paint_at", "take_paint"]


@native
def paint_at(leaf: Records, low: int, high: int, bary: NDArray[np.float64]) -> int:
    """Return the paint at barycentric coordinates (3,) of a face, a leaf in `low` to `high`.

    Descends the bisection tree of the face (`hapscene.scene.fine_paint`): each step halves the triangle at an edge,
    transforms the coordinates to the half that contains the point, and keeps the leaves of that half.
    """
    a, b, c = bary[0], bary[1], bary[2]
    shift = 31
    while high - low > 1 and shift >= 0:
        edge = leaf[low].edge >> 2 * shift & 3
        u, v = (b, c) if edge == 0 else (c, a) if edge == 1 else (a, b)
        first, last = low, high  # binary search for the first leaf of the second half
        while first < last:
            middle = (first + last) // 2
            if leaf[middle].path >> shift & 1 == 1:
                last = middle
            else:
                first = middle + 1
        if u >= v:
            u, v, high = u - v, 2.0 * v, first
        else:
            u, v, low = 2.0 * u, v - u, first
        if edge == 0:
            b, c = u, v
        elif edge == 1:
            c, a = u, v
        else:
            a, b = u, v
        shift -= 1
    return int(leaf[low].paint)


@native
def take_paint(
    touch: np.record, memory: np.record, states: NDArray[np.uint8], passed_on: NDArray[np.int64], paint: int
) -> None:
    """Write the swatches of a paint to `touch`; the weight of the second one follows within `BLEND_S`."""
    swatch, other, wanted = paint & 0xFFFF, paint >> 16 & 0xFFFF, (paint >> 32) / 256.0
    if wanted == 0.0:
        other = -1
    was = touch.swatch
    if swatch != was and (swatch == touch.other or (other == was and was >= 0)):
        if swatch != touch.other:  # a new swatch replaces the one that was blended in
            if touch.other < 0:
                _begin(touch, memory, states, passed_on)
            touch.crossed = 1
        memory.bank = 1 - memory.bank
        touch.other, touch.weight = was, 1.0 - touch.weight
    elif swatch != was:
        touch.crossed = 1
    touch.swatch = swatch
    if other < 0 and touch.weight == 0.0:
        touch.other = -1
    if other >= 0 and other != touch.other:
        if touch.other < 0:
            _begin(touch, memory, states, passed_on)
        touch.other, memory.other_crossed = other, 1
    if touch.other < 0:
        return
    most = 1.0 if touch.began == 1 else touch.tick_s / BLEND_S
    touch.weight += min(max(wanted - touch.weight, -most), most)


@native
def _begin(touch: np.record, memory: np.record, states: NDArray[np.uint8], passed_on: NDArray[np.int64]) -> None:
    """Start the unused bank with a copy of the used one, or from zero; its random numbers continue."""
    size = len(states) // 2
    new, used = size * (1 - memory.bank), size * memory.bank
    for k in range(len(passed_on)):
        first, stop, fate = passed_on[k]
        if fate == CLEARED:
            states[new + first : new + stop] = 0
        else:
            for i in range(first, stop):
                states[new + i] = states[used + i]
    touch.weight = 0.0
    memory.gain[memory.bank], memory.gain[1 - memory.bank] = 1.0, 0.0
