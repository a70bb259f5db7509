"""The acceleration of a swatch's texture along a stroke, offline: to judge a fit, and to listen to it.

The renderer's effect `lpc_texture` does the same tick by tick.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch

Array = NDArray[np.float64]

BLOCK_S: Final = 0.01
"""How long one filter is kept [s]: force and speed are below 20 Hz, so it changes little in that time."""

_CHUNK: Final = 1024  # blocks whose filters are made at once


def synthesize(
    swatch: Swatch, force_N: ArrayLike, slip_m_s: ArrayLike, rate_Hz: float | None = None, seed: int = 0
) -> Array:
    """Acceleration (n,) [m/s²] along normal forces (n,) [N] and slip speeds (n,) [m/s], sampled at `rate_Hz`.

    Gaussian noise of the model's variance through 1/A(z); the past of the output is carried over when the filter
    changes. Without `rate_Hz` the texture's own rate is meant.

    Raises:
        CaptureError: the swatch has no texture, or the two series differ in length.
    """
    from scipy.signal import lfilter, lfiltic

    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture: there is nothing to synthesize")
    force, slip = np.asarray(force_N, dtype=np.float64), np.asarray(slip_m_s, dtype=np.float64)
    if force.ndim != 1 or force.shape != slip.shape:
        raise CaptureError(f"force_N and slip_m_s must have one shape (n,), have {force.shape} and {slip.shape}")
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    block = max(1, round(BLOCK_S * texture.rate_Hz))
    noise = np.random.default_rng(seed).standard_normal(len(force))
    output = np.empty(len(force))
    past = np.zeros(texture.order)  # newest first
    starts = np.arange(0, len(force), block)
    for chunk in np.split(starts, range(_CHUNK, len(starts), _CHUNK)):
        middle = np.minimum(chunk + block // 2, len(force) - 1)
        a, variance = texture.models(force[middle], slip[middle])
        for start, filter_a, sigma in zip(chunk, a, np.sqrt(variance), strict=True):
            part = slice(start, start + block)
            output[part], _ = lfilter([1.0], filter_a, sigma * noise[part], zi=lfiltic([1.0], filter_a, past))
            past = np.concatenate([output[part][::-1], past])[: texture.order]
    return output
