"""Offline synthesis of a texture: acceleration for given force and speed, to evaluate a fit or to listen to it.

The synthesis is that of the effect `lpc_texture` (`hapscene.dsp.texture_voice`). Here the models are computed from the
texture; the effect interpolates them in a table.
"""

import math
from numbers import Integral
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hapscene.capture.io.streams import Array
from hapscene.dsp.noise import seeded_state
from hapscene.dsp.texture_voice import Stroke, run_texture, voice_fields
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch, SwatchLike
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

__all__ = ["synthesize"]

BLOCK_S: Final = 0.01
"""Update interval of the filter [s]. Force and speed change at less than 20 Hz; the level is ramped over the
interval."""

STEP_S: Final = 0.001
"""Update interval of the amplitude modulation [s], as in the renderer; the gain is ramped over it."""

SETTLE_S: Final = 0.1
"""Time for which the filter runs before the first sample [s], so that its output is stationary."""

_BATCH: Final = 4096  # blocks whose filters are computed at once; this limits the memory


def synthesize(
    swatch: SwatchLike,
    force_N: ArrayLike,
    speed_m_s: ArrayLike,
    *,
    rate_Hz: float | None = None,
    seed: int = 0,
    modulation: float = 1.0,
) -> Array:
    """Synthesises the texture of a swatch for given force and speed.

    Args:
        swatch: a swatch, or the name or file of one.
        force_N: normal force (n,) [N].
        speed_m_s: slip speed (n,) [m/s].
        rate_Hz: sample rate of all signals; None: that of the texture.
        seed: seed of the random numbers; the same seed gives the same samples.
        modulation: factor on the depth of the amplitude modulation, 0 to 2; 0 disables it.

    Returns:
        Acceleration (n,) [m/s²].

    Raises:
        CaptureError: the swatch has no texture, force and speed differ in length, or seed or modulation are invalid.
    """
    swatch = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    if not isinstance(seed, Integral) or seed < 0:
        raise CaptureError(f"seed is {seed!r}; expected an integer, 0 or more")
    if not 0.0 <= modulation <= 2.0:
        raise CaptureError(f"modulation is {modulation!r}; expected a number from 0 to 2")
    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture")
    force, slip = np.asarray(force_N, dtype=np.float64), np.asarray(speed_m_s, dtype=np.float64)
    if force.ndim != 1 or force.shape != slip.shape:
        raise CaptureError(
            f"force_N and speed_m_s have shapes {force.shape} and {slip.shape}; expected equal shapes (n,)"
        )
    output = np.zeros(len(force))
    if len(force) == 0:
        return output
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    synthesizer = _Synthesizer(texture, modulation, int(seed))
    for start in range(0, len(force), _BATCH * synthesizer.block):
        part = slice(start, start + _BATCH * synthesizer.block)
        synthesizer.add(force[part], slip[part], output[part])
    return output


class _Synthesizer:
    """Continuous synthesis of a texture in consecutive calls."""

    def __init__(self, texture: Texture, modulation: float, seed: int) -> None:
        self.texture = texture
        self.step = max(1, round(STEP_S * texture.rate_Hz))
        self.hold = max(1, round(BLOCK_S * texture.rate_Hz / self.step))
        self.block, self.step_s = self.hold * self.step, self.step / texture.rate_Hz
        self.rates, gain = np.zeros(0), texture.modulation
        if gain is not None:
            self.rates = np.column_stack((gain.spread, gain.decay_1_s, gain.decay_1_m)).ravel()
        fields = [(name, np.float64, shape) for name, shape in voice_fields(texture.order)]
        self.s = np.zeros(1, [*fields, ("rng", np.uint64, (4,))]).view(np.recarray)[0]
        self.s["order"], self.s["warp"], self.s["spread_scale"] = texture.order, texture.warp, modulation
        self.s["rng"] = seeded_state(seed, "synthesize")
        self.last: float | None = None  # level at the end of the last call

    def add(self, force_N: Array, speed_m_s: Array, out: Array) -> None:
        """Adds the output for forces and speeds (n,) to `out` (n,); n is a multiple of `block`, except at the end."""
        middle = np.minimum(np.arange(0, len(out), self.block) + self.block // 2, len(out) - 1)
        k, power = self.texture.lattice(force_N[middle], speed_m_s[middle])
        level = np.sqrt(power)
        if self.last is None:
            before = np.zeros(round(SETTLE_S * self.texture.rate_Hz))
            self.s["level_m_s2"] = self.s["gain"] = 1.0
            self._run(k[:1], np.ones(math.ceil(len(before) / self.step)), speed_m_s[:1], before)
            self.last = self.s["level_m_s2"] = level[0]
        steps = np.arange(math.ceil(len(out) / self.step))
        ends = np.arange(len(middle) + 1) * self.hold
        ramped = np.interp(steps + 1, ends, [self.last, *level])
        self._run(k, ramped, speed_m_s[np.minimum(steps * self.step + self.step // 2, len(out) - 1)], out)
        self.last = level[-1]

    def _run(self, k: Array, level: Array, speed_m_s: Array, out: Array) -> None:
        travel_m = np.broadcast_to(np.abs(speed_m_s) * self.step_s, level.shape).copy()
        k = np.ascontiguousarray(k)
        run_texture(self.s, Stroke(k, level, travel_m, self.rates, self.step_s, self.step, self.hold), out)
