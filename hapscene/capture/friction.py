"""Friction coefficients from tangential and normal force."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError
from hapscene.surface.swatch import FRICTION_MAX

Array = NDArray[np.float64]

SLIDING_M_S: Final = 0.005
"""Speed above which the tool is taken to slide [m/s]."""

STATIC_QUANTILE: Final = 0.95
"""Quantile of the friction ratio that static friction is taken from [1]."""


def fit_friction(tangential_N: Array, normal_N: Array, speed_m_s: Array) -> tuple[float, float]:
    """Static and dynamic Coulomb coefficients from low-passed forces (n,) and speed (n,).

    Dynamic: the line through the origin with the least sum of absolute errors, Σ |F_t − μ F_n|, over the samples in
    which the tool slides; it is the median of F_t/F_n weighted by F_n, and half the samples may be outliers. A free
    offset is not fitted: the forces of one stroke span too little to tell it from the slope.
    Static: the `STATIC_QUANTILE` of F_t/F_n over all samples pressed with a tenth of the largest force or more, the
    pulls at which a hand-held tool lets go; never below dynamic.

    Raises:
        CaptureError: the tool never slides under a normal force, or the coefficients are beyond `FRICTION_MAX`.
    """
    pressed = normal_N > 0.1 * normal_N.max()
    sliding = pressed & (speed_m_s > SLIDING_M_S)
    if normal_N.max() <= 0.0 or not np.any(sliding):
        raise CaptureError(f"no friction can be fitted: no sample with force_N above 0 slides over {SLIDING_M_S} m/s")
    ratio = np.abs(tangential_N) / np.where(pressed, normal_N, 1.0)
    order = np.argsort(ratio[sliding])
    weight = np.cumsum(normal_N[sliding][order])
    dynamic = float(ratio[sliding][order][np.searchsorted(weight, 0.5 * weight[-1])])
    static = max(dynamic, float(np.quantile(ratio[pressed], STATIC_QUANTILE)))
    if static > FRICTION_MAX:
        raise CaptureError(f"friction coefficients of {dynamic:.3g} and {static:.3g}: are both forces in newtons?")
    return static, dynamic
