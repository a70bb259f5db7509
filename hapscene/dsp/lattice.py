"""The texture as a running filter: the normalised lattice. Compiled.

A texture is a field of models y(t) = e(t) − Σ a_k y(t−k) over normal force and slip speed. They are run as a
normalised lattice (Gray & Markel 1975): a chain of rotations by reflection coefficients k_m, with c_m = √(1 − k_m²),

    f_{m−1}(t) = c_m f_m(t) − k_m b_{m−1}(t−1)         m = p … 1,  f_p = white noise of variance 1
    b_m(t)     = k_m f_m(t) + c_m b_{m−1}(t−1)         y = √P · f_0,  b_0 = f_0

The step from (f_p, b_0 … b_{p−1}) to (b_0 … b_p) is a product of rotations: white noise of variance 1 in all of them
stays so, whatever models follow one another. So f_0 has variance 1 always, and no change of model is louder than the
models. Coefficients and the level √P are apart: the level can be ramped, so that nothing clicks.
"""

import math
from typing import Any

from hapscene.dsp.noise import normal
from hapscene.native import native


@native
def advance(k: Any, c: Any, b: Any, order: int, f: float) -> float:
    """The lattice's next sample f_0, for the excitation f_p = `f`; k, c (order+1,), memory b (order+1,).

    A chain of dependent steps, but the processor begins the next sample while one is under way: to interleave two by
    hand was measured to be no faster.
    """
    for m in range(order, 0, -1):
        f, b[m] = c[m] * f - k[m] * b[m - 1], k[m] * f + c[m] * b[m - 1]
    b[0] = f
    return f


@native
def run_lattice(k: Any, level: Any, last: float, block: int, rng: Any, state: Any, out: Any) -> None:
    """Fill `out` (n,) block by block, block i by reflection coefficients k[i] (p,) at the level level[i], √P [m/s²].

    k has one row for all blocks, or one each. The level is ramped over a block, from the one before (`last` before the
    first) to its own. `state` (3, p+1) is the lattice's k, c and b, `rng` the generator's: both are carried on.
    """
    order = k.shape[1]
    for i in range(level.size):
        if i == 0 or k.shape[0] > 1:
            for m in range(order):
                state[0, m + 1] = k[i, m]
                state[1, m + 1] = math.sqrt((1.0 - k[i, m]) * (1.0 + k[i, m]))
        step = (level[i] - last) / block
        now = last
        for t in range(i * block, min((i + 1) * block, out.size)):
            now += step
            out[t] = now * advance(state[0], state[1], state[2], order, normal(rng))
        last = level[i]
