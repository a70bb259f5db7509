"""The acceleration of a swatch's texture along a stroke, offline: to judge a fit, and to listen to it.

The same state machine and the same noise as in the effect `lpc_texture` (`hapscene.dsp.texture_voice`); here the models
are those of the texture itself, there they come from a table on a grid.
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

__all__ = ["BLOCK_S", "synthesize"]

BLOCK_S: Final = 0.01
"""How long one filter is kept [s]: force and speed are below 20 Hz, so they change little in that time. The level is
ramped over it."""

STEP_S: Final = 0.001
"""How long the slow gain is kept [s], as by the renderer; it is ramped over it."""

SETTLE_S: Final = 0.1
"""How long the filter has been running when the stroke begins [s]: it is not silent before its first sample."""

_PART: Final = 4096  # blocks whose filters are made at once: their memory is bounded, whatever the stroke's length


def synthesize(
    swatch: SwatchLike,
    force_N: ArrayLike,
    speed_m_s: ArrayLike,
    *,
    rate_Hz: float | None = None,
    seed: int = 0,
    life: float = 1.0,
) -> Array:
    """Acceleration (n,) [m/s²] along normal forces (n,) [N] and slip speeds (n,) [m/s], sampled at `rate_Hz`.

    The texture's noise through its filter, both as `Texture.model` gives them at the middle of each block of
    `BLOCK_S`; its slow gain, where it has one, step by step of `STEP_S`. `life` is a factor on the spread of the gain:
    0 makes it steady. Without `rate_Hz` the texture's own rate is used. The same seed gives the same samples.

    Raises:
        CaptureError: the swatch has no texture, the two series differ in length, or seed or life are none.
    """
    swatch = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    if not isinstance(seed, Integral) or seed < 0:
        raise CaptureError(f"seed must be a whole number, 0 or more, is {seed!r}")
    if not 0.0 <= life <= 2.0:
        raise CaptureError(f"life must be a number from 0 to 2, is {life!r}")
    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture: there is nothing to synthesize")
    force, slip = np.asarray(force_N, dtype=np.float64), np.asarray(speed_m_s, dtype=np.float64)
    if force.ndim != 1 or force.shape != slip.shape:
        raise CaptureError(f"force_N and speed_m_s must have one shape (n,), have {force.shape} and {slip.shape}")
    output = np.zeros(len(force))
    if len(force) == 0:
        return output
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    player = _Player(texture, life, int(seed))
    for start in range(0, len(force), _PART * player.block):
        part = slice(start, start + _PART * player.block)
        player.add(force[part], slip[part], output[part])
    return output


class _Player:
    """A texture that is played on and on, from a running start."""

    def __init__(self, texture: Texture, life: float, seed: int) -> None:
        self.texture = texture
        self.step = max(1, round(STEP_S * texture.rate_Hz))
        self.hold = max(1, round(BLOCK_S * texture.rate_Hz / self.step))
        self.block, self.step_s = self.hold * self.step, self.step / texture.rate_Hz
        self.rates, of = np.zeros(0), texture.modulation
        if of is not None:
            self.rates = np.column_stack((of.spread, of.decay_1_s, of.decay_1_m)).ravel()
        fields = [(name, np.float64, shape) for name, shape in voice_fields(texture.order)]
        self.s = np.zeros(1, [*fields, ("rng", np.uint64, (4,))]).view(np.recarray)[0]
        self.s["order"], self.s["warp"], self.s["spread_scale"] = texture.order, texture.warp, life
        self.s["rng"] = seeded_state(seed, "synthesize")
        self.last: float | None = None  # level at the end of what was played

    def add(self, force_N: Array, speed_m_s: Array, out: Array) -> None:
        """Add what is heard along forces, speeds (n,) to `out` (n,); n is a multiple of the block, or the end."""
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
