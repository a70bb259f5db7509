"""How the models of a triangle become one filter, in four ways.

| interpolation | blends | stable |
|---|---|---|
| `lsf` | line spectral frequencies | always |
| `reflection` | reflection coefficients | always |
| `direct` | the coefficients a_k, as in Culbertson, Unwin & Kuchenbecker 2014 | made so, see below |
| `hatt` | line spectral frequencies and the excitation's variance, as the Penn toolkit does | always |

In the first three the power of the output is blended, and the excitation is what gives that power. In the last the
output has whatever power comes of it: that is what the toolkit's files were made for.

A weighted mean of stable filters' coefficients need not be stable: between random pairs it is not, somewhere on the
way, in 13, 73 and 99 % of cases at order 3, 8 and 20. An unstable mean has its poles drawn towards the middle,
a_k ← γ^k a_k with the largest γ = 1 − 2^−n at which the filter is stable and its power gain bounded: the spectrum's
peaks stay where they are, and get wider.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.lsf import ar_from_lsf, ar_from_reflection, power_gain, reflection_from_ar

Array = NDArray[np.float64]

INTERPOLATIONS: Final = ("lsf", "reflection", "direct", "hatt")
"""The names of the ways."""

GAIN_MAX: Final = 1e8
"""Largest power gain that a mean of coefficients may have [1]. Recordings' models have 1e1 to 1e5."""

SHRINK_BITS: Final = 12
"""γ is 1 − 2^−n for n from this down to 1: poles of a tenth of a hertz at first, then broader and broader."""


def form(interpolation: str, lsf_rad: Array) -> Array:
    """The models (m, p) in the coordinates that the interpolation is linear in."""
    if interpolation == "reflection":
        return reflection_from_ar(ar_from_lsf(lsf_rad))
    if interpolation == "direct":
        return np.asarray(ar_from_lsf(lsf_rad)[:, 1:])
    return lsf_rad


def filters(interpolation: str, blended: Array) -> Array:
    """The filters (n, p+1), all stable, of blended coordinates (n, p)."""
    if interpolation == "reflection":
        return ar_from_reflection(blended)
    if interpolation == "direct":
        return stabilised(np.concatenate([np.ones((len(blended), 1)), blended], axis=1))
    return ar_from_lsf(blended)


def stabilised(a: Array) -> Array:
    """Filters (n, p+1) with the poles of those that are unstable drawn inward; the others to the bit as they are."""
    a = a.copy()
    wild = np.flatnonzero(~(power_gain(a) < GAIN_MAX))
    k = np.arange(a.shape[1])
    original = a[wild]
    for n in range(SHRINK_BITS, 0, -1):
        if len(wild) == 0:
            break
        a[wild] = original * (1.0 - 0.5**n) ** k
        still = ~(power_gain(a[wild]) < GAIN_MAX)
        wild, original = wild[still], original[still]
    a[wild, 1:] = (
        0.0  # at γ = 1/2 nothing blended from stable filters is left; coefficients of a stranger's file may be
    )
    return a
