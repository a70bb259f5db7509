"""All-pole filters and their equivalent forms: line spectral frequencies and reflection coefficients; power gain.

Sign convention: y(t) = e(t) − Σ a_k y(t−k), so a[0] = 1 and the filter is 1/A(z) with A(z) = Σ a_k z^−k. A shape
(..., p) means that a function accepts stacks of filters in the leading axes.

Line spectral frequencies (Itakura 1975) are the angles in (0, π) of the roots of P(z) = A(z) + z^−(p+1) A(1/z) and Q(z)
= A(z) − z^−(p+1) A(1/z). The roots lie on the unit circle and interlace if and only if 1/A is stable. Any ascending set
of frequencies gives a stable filter, and a weighted mean of ascending sets ascends. Textures therefore interpolate
their models in line spectral frequencies."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SwatchError

__all__ = ["ar_from_lsf", "ar_from_reflection", "lsf_from_ar", "power_gain", "power_response", "reflection_from_ar"]

Array = NDArray[np.float64]

STEP_MAX = 12
"""Largest number of Newton steps for a root. Four are usual; a root that needs more is close to another one."""

_LSF_BYTES = 1 << 22  # memory of a block in ar_from_lsf: small enough that BLAS uses one thread, which is faster here


def ar_from_lsf(lsf_rad: ArrayLike) -> Array:
    """Converts line spectral frequencies (..., p) [rad], ascending in (0, π), to AR coefficients (..., p+1).

    P and Q are evaluated in product form on p+1 points of the unit circle, and A = (P + Q)/2 follows by an inverse
    Fourier transform. The rounding error is 1e-13 at order 120, where multiplication of the factors loses all digits.
    """
    lsf = np.asarray(lsf_rad, dtype=np.float64)
    rows = lsf.reshape(-1, lsf.shape[-1])
    order = rows.shape[1]
    part = max(1, _LSF_BYTES // (8 * (order + 1) ** 2))
    if len(rows) > part:
        done = [ar_from_lsf(rows[i : i + part]) for i in range(0, len(rows), part)]
        return np.concatenate(done).reshape(*lsf.shape[:-1], order + 1)
    cos_2, gain_p, gain_q, to_p, to_q = _circle(order)
    p, q = np.ones((2, len(rows), len(cos_2)))
    roots_2 = 2.0 * np.cos(rows)
    for k in range(order):
        factor = p if k % 2 == 0 else q
        factor *= cos_2 - roots_2[:, k, None]
    a: Array = (p * gain_p) @ to_p + (q * gain_q) @ to_q
    a[:, 0] = 1.0
    return a.reshape(*lsf.shape[:-1], order + 1)


@lru_cache(maxsize=16)
def _circle(order: int) -> tuple[Array, Array, Array, Array, Array]:
    """Tables for `ar_from_lsf`: points on the unit circle, factors of P and Q at ±1, inverse Fourier transforms.

    On the circle 1 − 2 cos w z^−1 + z^−2 = e^−jθ (2 cos θ − 2 cos w), so P and Q are real except for e^−jθ(p+1)/2.
    Only half of the p+1 points are needed, because the other half is the complex conjugate.
    """
    n = order + 1
    half = np.arange(n // 2 + 1)
    theta = 2.0 * np.pi * half / n
    twice = np.where((half == 0) | (2 * half == n), 1.0, 2.0)[:, None]  # counts the conjugate points
    phase = theta[:, None] * (np.arange(n) - 0.5 * n)
    if order % 2 == 0:
        gain_p, gain_q = 2.0 * np.cos(theta / 2), 2.0 * np.sin(theta / 2)
    else:
        gain_p, gain_q = np.ones_like(theta), 2.0 * np.sin(theta)
    to_p, to_q = twice * np.cos(phase) / (2 * n), -twice * np.sin(phase) / (2 * n)
    return 2.0 * np.cos(theta), gain_p, gain_q, to_p, to_q


def lsf_from_ar(a: ArrayLike) -> Array:
    """Converts a stable filter `a` (p+1,), p ≥ 1, to line spectral frequencies (p,) [rad], ascending.

    P and Q, with their roots at ±1 divided out, are cosine sums of half the order. A fine grid brackets their roots by
    changes of sign, and Newton steps in θ refine them. If roots are too close for the grid, the sums are treated as
    Chebyshev series in cos θ, whose roots are the eigenvalues of a colleague matrix (backward stable, much slower).

    Raises:
        SwatchError: the filter is unstable, or so close to instability that its roots cannot be separated.
    """
    a = np.asarray(a, dtype=np.float64)
    order = len(a) - 1
    longer = np.append(a, 0.0)
    p, q = longer + longer[::-1], longer - longer[::-1]
    if order % 2 == 0:
        p, q = _divide(p, 1.0), _divide(q, -1.0)
    else:
        q = _divide(_divide(q, -1.0), 1.0)
    lsf = np.empty(order)
    lsf[0::2], lsf[1::2] = _cosine_roots(p), _cosine_roots(q)
    if not (lsf[0] > 0.0 and lsf[-1] < np.pi and np.all(np.diff(lsf) > 0.0)):
        raise SwatchError("the filter is unstable: its line spectral frequencies do not ascend in (0, π)")
    return lsf


def _divide(c: Array, sign: float) -> Array:
    """Divides the polynomial `c` by (1 + sign z^−1), which must be a factor."""
    quotient = np.empty(len(c) - 1)
    rest = 0.0
    for i in range(len(quotient)):
        rest = c[i] - sign * rest
        quotient[i] = rest
    return quotient


def _cosine_roots(c: Array) -> Array:
    """Ascending roots in (0, π) of the symmetric polynomial `c` (2n+1,) on the unit circle, as angles (n,)."""
    n = len(c) // 2
    if n == 0:
        return np.empty(0)
    series = np.concatenate([c[n : n + 1], 2.0 * c[n + 1 :]])
    found = _bracketed_roots(series)
    if found is not None:
        return found
    x = np.polynomial.chebyshev.chebroots(series)
    if len(x) != n:
        raise SwatchError("the filter is at the edge of stability: its line spectral frequencies coincide")
    theta = np.sort(np.arccos(np.clip(x.real, -1.0, 1.0)))
    for _ in range(2):
        value, slope = _cosine_sum(series, theta)
        step = np.divide(value, slope, out=np.zeros(n), where=slope != 0.0)
        gap = np.diff(theta, prepend=0.0, append=np.pi)
        reach = 0.25 * np.minimum(gap[:-1], gap[1:])  # a step must not pass a neighbouring root
        theta = theta - np.clip(step, -reach, reach)
    return theta


def _cosine_sum(series: Array, theta: Array) -> tuple[Array, Array]:
    """Σ series_k cos kθ at angles (n,), and its derivative."""
    k = np.arange(len(series))
    angle = theta[:, None] * k
    return np.cos(angle) @ series, -np.sin(angle) @ (k * series)


def _bracketed_roots(series: Array) -> Array | None:
    """The n roots in (0, π) of a sum of cosines (n+1,), by bracketed Newton steps; None if they are too close."""
    n = len(series) - 1
    half = np.concatenate([series[:1], 0.5 * series[1:]])
    for cells in (8 * n, 64 * n):
        value = np.fft.hfft(half, 2 * cells)[: cells + 1]
        at = np.flatnonzero(np.signbit(value[1:]) != np.signbit(value[:-1]))
        if len(at) == n:
            break
    else:
        return None
    low, high = at * np.pi / cells, (at + 1) * np.pi / cells
    sign = np.signbit(value[at])
    theta = low + (high - low) * value[at] / (value[at] - value[at + 1])
    for _ in range(STEP_MAX):
        now, slope = _cosine_sum(series, theta)
        before = np.signbit(now) == sign
        low, high = np.where(before, theta, low), np.where(before, high, theta)
        newton = theta - np.divide(now, slope, out=np.full(n, np.inf), where=slope != 0.0)
        new = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        moved, theta = float(np.abs(new - theta).max()), new
        if moved < 1e-13:
            return theta
    return None


def reflection_from_ar(a: ArrayLike) -> Array:
    """Converts filters (..., p+1) to reflection coefficients (..., p) by the step-down recursion.

    For an unstable filter, the first |k| ≥ 1 from the highest order down is returned and the lower ones are NaN. Test
    with `np.all(np.abs(k) < 1)`.
    """
    a = np.asarray(a, dtype=np.float64)
    order = a.shape[-1] - 1
    rest = a.reshape(-1, order + 1).copy()
    k = np.full((len(rest), order), np.nan)
    for m in range(order, 0, -1):
        last = rest[:, m, None]
        k[:, m - 1] = rest[:, m]
        scale = (1.0 - last) * (1.0 + last)
        over = np.divide(1.0, scale, out=np.full_like(scale, np.nan), where=scale > 0.0)  # NaN below an unstable step
        rest[:, 1:m] = (rest[:, 1:m] - last * rest[:, m - 1 : 0 : -1]) * over
    return k.reshape(*a.shape[:-1], order)


def ar_from_reflection(k: ArrayLike) -> Array:
    """Converts reflection coefficients (..., p) to AR coefficients (..., p+1) by the step-up recursion."""
    k = np.asarray(k, dtype=np.float64)
    order = k.shape[-1]
    a = np.zeros((*k.shape[:-1], order + 1))
    a[..., 0] = 1.0
    for m in range(1, order + 1):
        a[..., 1 : m + 1] += k[..., m - 1, None] * a[..., m - 1 :: -1][..., :m]
    return a


def power_response(a: ArrayLike, omega_rad: ArrayLike, warp: float = 0.0) -> Array:
    """Power response 1/|A|² (..., n) of filters (..., p+1) at frequencies (n,) [rad/sample].

    `warp` is the allpass coefficient λ of a frequency-warped filter, in which an allpass D(z) = (z⁻¹ − λ)/(1 − λ z⁻¹)
    replaces each unit delay (Strube 1980; Härmä et al. 2000). The response is then that of 1/A(D(z)).
    """
    a = np.asarray(a, dtype=np.float64)
    delay = np.exp(-1j * np.asarray(omega_rad, dtype=np.float64))
    if warp != 0.0:
        delay = (delay - warp) / (1.0 - warp * delay)
    return np.asarray(1.0 / np.abs(a @ np.vander(delay, a.shape[-1], increasing=True).T) ** 2)


def power_gain(a: ArrayLike, warp: float = 0.0) -> Array:
    """Output variance (...) of filters (..., p+1) for white excitation of variance 1: 1 / Π (1 − k²).

    It is infinite for an unstable filter. For a frequency-warped filter with allpass coefficient λ = `warp`, it is
    (1 − λ²) times that of the AR filter (1 + λ z⁻¹) A(z).
    """
    if warp != 0.0:
        a = np.asarray(a, dtype=np.float64)
        zero = np.zeros((*a.shape[:-1], 1))
        longer = np.concatenate([a, zero], axis=-1) + warp * np.concatenate([zero, a], axis=-1)
        return np.asarray((1.0 - warp) * (1.0 + warp) * power_gain(longer))
    k = reflection_from_ar(a)
    rest = np.prod((1.0 - k) * (1.0 + k), axis=-1)
    with np.errstate(divide="ignore"):
        return np.where(np.all(np.abs(k) < 1.0, axis=-1), 1.0 / np.abs(rest), np.inf)
