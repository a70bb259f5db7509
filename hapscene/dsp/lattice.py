"""Normalised lattice filters, plain and frequency-warped, for texture synthesis. Compiled.

A texture consists of models y(t) = e(t) − Σ a_k y(t−k) over normal force and slip speed. Each runs as a normalised
lattice (Gray & Markel 1975), a chain of rotations by reflection coefficients k_m with c_m = √(1 − k_m²):

    f_{m−1}(t) = c_m f_m(t) − k_m b_{m−1}(t−1)         m = p … 1,  f_p = white noise of variance 1
    b_m(t)     = k_m f_m(t) + c_m b_{m−1}(t−1)         y = √P · f_0,  b_0 = f_0

The step from (f_p, b_0 … b_{p−1}) to (b_0 … b_p) is a product of rotations. If all inputs are white noise of variance
1, so are all outputs, even when the coefficients change. f_0 therefore always has variance 1, and a change of model is
never louder than the models. The level √P is separate from the coefficients, so that it can be ramped without clicks.

In a frequency-warped model, a normalised allpass replaces each delay (Strube 1980; Härmä et al. 2000). With
μ = √(1 − λ²) and the memory s_m,

    d_m = −λ b_{m−1} + μ s_m,  s_m ← μ b_{m−1} + λ s_m         and d_m replaces b_{m−1}(t−1) above.

This is a rotation as well, so all memories remain white noise of variance 1. d_m depends on b_{m−1} without delay, and
b_{m−1} on f_{m−1}, linearly: b_m = α_m f_m + β_m. With r = 1/(1 − k_m λ α_{m−1}), C_m = c_m r and K_m = k_m r, the
delay-free loop is solved upwards and then downwards:

    e_m = μ s_m − λ β_{m−1},  β_m = C_m e_m,  α_m = k_m − c_m² λ r α_{m−1}       β_0 = 0, α_0 = 1
    f_{m−1} = C_m f_m − K_m e_m

Here the variance of f_0 is a function of the model, since the memories are white. `solve_loop` computes it, and the
level is divided by its square root, so that a change of model is never louder than the models.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import INTERPRETED, native
from hapscene.dsp.lattice_lanes import lanes_of

Array = NDArray[np.float64]

__all__ = ["advance", "advance_all", "advance_warped", "solve_loop"]


@native
def advance(k: Array, c: Array, b: Array, order: int, f: float) -> float:
    """Next output sample f_0 for the excitation f_p = `f`; coefficients k, c (order+1,), memory b (order+1,)."""
    for m in range(order, 0, -1):
        f, b[m] = c[m] * f - k[m] * b[m - 1], k[m] * f + c[m] * b[m - 1]
    b[0] = f
    return f


_eight, _EIGHT_ORDER = lanes_of(8)
_four, _FOUR_ORDER = lanes_of(4)


@native
def advance_all(k: Array, c: Array, b: Array, order: int, f: Array, stop: int) -> None:
    """Replaces the samples f[:stop] by the output of `advance`.

    The compiled version processes several samples at once, with identical results in a third of the time.
    """
    i = 0
    while not INTERPRETED and order >= _EIGHT_ORDER and i + 8 <= stop:
        _eight(k.ctypes.data, c.ctypes.data, b.ctypes.data, order, f.ctypes.data + 8 * i)
        i += 8
    while not INTERPRETED and order >= _FOUR_ORDER and i + 4 <= stop:
        _four(k.ctypes.data, c.ctypes.data, b.ctypes.data, order, f.ctypes.data + 8 * i)
        i += 4
    while i < stop:
        f[i] = advance(k, c, b, order, f[i])
        i += 1


@native
def solve_loop(k: Array, order: int, warp: float, rows: Array) -> float:
    """Fills the `rows` (8, ≥ p+1) that `advance_warped` needs from k (≥ p+1,) and returns the variance of f_0 [1].

    p is `order` rounded up to a multiple of 4. The additional k are set to 0, which only adds a delay.

    f_0 is share · f_m plus a term of the memories below m. Its variance and its covariance with β_m are accumulated
    over m."""
    mu = math.sqrt((1.0 - warp) * (1.0 + warp))
    share, below, shared, beta = (
        1.0,
        0.0,
        0.0,
        0.0,
    )  # share of f_m in f_0; variance of f_0, covariance with β_m, variance of β_m
    over, under, alpha, c, product = (
        1.0,
        1.0,
        1.0,
        0.0,
        1.0,
    )  # α = over/under avoids dependent divisions
    for m in range(1, order + 4 - (order - 1) % 4):
        if m > order:
            k[m] = 0.0
        rows[0, m] = warp * c
        product = -warp * c * (1.0 if m % 4 == 1 else product)
        rows[1, m] = product
        rows[2, m], rows[3, m] = mu * alpha, mu * c
        before, bent = under, warp * over
        over, under = k[m] * before - bent, before - k[m] * bent
        inverse = 1.0 / under
        r, alpha = before * inverse, over * inverse
        c, g = math.sqrt((1.0 - k[m]) * (1.0 + k[m])) * r, k[m] * r
        rows[4, m], rows[5, m] = c, g
        into, e = share * g, mu * mu + warp * warp * beta
        below += into * (2.0 * warp * shared + into * e)
        shared = -(c * warp) * shared - c * into * e
        share, beta = share * c, c * c * mu * mu + (c * c * warp * warp) * beta
        if m % 4 == 0:
            over, under = alpha, 1.0
            rows[6, m] = c
            for i in range(m - 1, m - 4, -1):
                rows[6, i] = rows[6, i + 1] * rows[4, i]
    return share * share + below


@native
def advance_warped(rows: Array, b: Array, order: int, warp: float, f: float) -> float:
    """Next output sample of a frequency-warped lattice with the `rows` of `solve_loop`; b[m−1] holds s_m.

    Both passes are linear recursions, in which each step depends on the one before it. To use the processor in
    parallel, four steps are computed from a start value of 0, and the contribution of the true start value is added as
    a product of their factors."""
    q, joined, a, d, c, g, into, e = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7]
    mu = math.sqrt((1.0 - warp) * (1.0 + warp))
    last = 0.0
    for m in range(1, order + 1, 4):
        one = mu * b[m - 1]
        two = mu * b[m] - q[m + 1] * one
        three = mu * b[m + 1] - q[m + 2] * two
        four = mu * b[m + 2] - q[m + 3] * three
        e[m] = one + joined[m] * last
        e[m + 1] = two + joined[m + 1] * last
        e[m + 2] = three + joined[m + 2] * last
        last = four + joined[m + 3] * last
        e[m + 3] = last
    for m in range(4 * ((order + 3) // 4) - 3, 0, -4):
        four = -g[m + 3] * e[m + 3]
        three = c[m + 2] * four - g[m + 2] * e[m + 2]
        two = c[m + 1] * three - g[m + 1] * e[m + 1]
        one = c[m] * two - g[m] * e[m]
        b[m + 2] = a[m + 3] * (four + into[m + 3] * f) + d[m + 3] * e[m + 2] + warp * b[m + 2]
        b[m + 1] = a[m + 2] * (three + into[m + 2] * f) + d[m + 2] * e[m + 1] + warp * b[m + 1]
        b[m] = a[m + 1] * (two + into[m + 1] * f) + d[m + 1] * e[m] + warp * b[m]
        f = one + into[m] * f
        b[m - 1] = a[m] * f + d[m] * e[m - 1] + warp * b[m - 1]
    return f
