"""The acceleration of a swatch's texture along a stroke, offline: to judge a fit, and to listen to it.

The same lattice and the same noise as the renderer's effect `lpc_texture` (`hapscene.dsp.lattice`); here the models
are those of the texture itself, there they come from a table on a grid.
"""

from numbers import Integral
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hapscene.capture.streams import Array
from hapscene.dsp.lattice import run_lattice
from hapscene.dsp.noise import seeded_state
from hapscene.errors import CaptureError
from hapscene.old_spellings import old_spellings
from hapscene.surface.library import load_swatch
from hapscene.surface.swatch import Swatch, SwatchLike

BLOCK_S: Final = 0.01
"""How long one filter is kept [s]: force and speed are below 20 Hz, so they change little in that time. The level is
ramped over it."""

SETTLE_S: Final = 0.1
"""How long the filter has been running when the stroke begins [s]: it is not silent before its first sample."""

_PART: Final = 4096  # blocks whose filters are made at once: their memory is bounded, whatever the stroke's length


@old_spellings(slip_m_s="speed_m_s")
def synthesize(
    swatch: SwatchLike, force_N: ArrayLike, speed_m_s: ArrayLike, *, rate_Hz: float | None = None, seed: int = 0
) -> Array:
    """Acceleration (n,) [m/s²] along normal forces (n,) [N] and slip speeds (n,) [m/s], sampled at `rate_Hz`.

    The texture's noise through its filter, both as `Texture.model` gives them at the middle of each block of
    `BLOCK_S`. Without `rate_Hz` the texture's own rate is meant. The same seed gives the same samples.

    Raises:
        CaptureError: the swatch has no texture, the two series differ in length, or the seed is none.
    """
    swatch = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    if not isinstance(seed, Integral) or seed < 0:
        raise CaptureError(f"seed must be a whole number, 0 or more, is {seed!r}")
    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture: there is nothing to synthesize")
    force, slip = np.asarray(force_N, dtype=np.float64), np.asarray(speed_m_s, dtype=np.float64)
    if force.ndim != 1 or force.shape != slip.shape:
        raise CaptureError(f"force_N and speed_m_s must have one shape (n,), have {force.shape} and {slip.shape}")
    output = np.empty(len(force))
    if len(force) == 0:
        return output
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    block = max(1, round(BLOCK_S * texture.rate_Hz))
    middle = np.minimum(np.arange(0, len(force), block) + block // 2, len(force) - 1)
    state, rng = np.zeros((3, texture.order + 1)), seeded_state(int(seed), "synthesize")
    last = 0.0
    for start in range(0, len(middle), _PART):
        part = middle[start : start + _PART]
        k, power = texture.lattice(force[part], slip[part])
        level = np.sqrt(power)
        if start == 0:
            before = np.empty(round(SETTLE_S * texture.rate_Hz))
            run_lattice(k[:1], np.ones(1), 1.0, len(before), rng, state, before)
            last = level[0]
        out = output[start * block : (start + _PART) * block]
        run_lattice(k, level, last, block, rng, state, out)
        last = level[-1]
    return output
