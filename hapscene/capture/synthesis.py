"""The acceleration of a swatch's texture along a stroke, offline: to judge a fit, and to listen to it.

The same lattice and the same noise as the renderer's effect `lpc_texture` (`hapscene.dsp.lattice`); here the models
are those of the texture itself, there they come from a table on a grid.
"""

import math
from numbers import Integral
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hapscene.capture.streams import Array
from hapscene.constants import LIFE_MAX
from hapscene.dsp.lattice import run_texture, voice_fields
from hapscene.dsp.noise import normal, seeded_state
from hapscene.dsp.slow_gain import CHANGE_S, draw_state
from hapscene.errors import CaptureError
from hapscene.old_spellings import old_spellings
from hapscene.surface.library import load_swatch
from hapscene.surface.swatch import Swatch, SwatchLike
from hapscene.surface.texture import Texture

BLOCK_S: Final = 0.01
"""How long one filter is kept [s]: force and speed are below 20 Hz, so they change little in that time. The level is
ramped over it."""

STEP_S: Final = 0.001
"""How long the slow gain and the state are kept [s], as by the renderer; the gain is ramped over it."""

SETTLE_S: Final = 0.1
"""How long the filter has been running when the stroke begins [s]: it is not silent before its first sample."""

_PART: Final = 4096  # blocks whose filters are made at once: their memory is bounded, whatever the stroke's length


@old_spellings(slip_m_s="speed_m_s")
def synthesize(
    swatch: SwatchLike,
    force_N: ArrayLike,
    speed_m_s: ArrayLike,
    *,
    rate_Hz: float | None = None,
    seed: int = 0,
    life: float = 1.0,
    third_rad: ArrayLike | None = None,
) -> Array:
    """Acceleration (n,) [m/s²] along normal forces (n,) [N] and slip speeds (n,) [m/s], sampled at `rate_Hz`.

    The texture's noise through its filter, both as `Texture.model` gives them at the middle of each block of
    `BLOCK_S`; its slow gain and its other state, where it has them, step by step of `STEP_S`. `life` is a factor on the
    spread of the gain: 0 makes it steady. `third_rad` (n,), or one number, is the direction of sliding or the angle of
    the tool, whichever the texture has layers of; without it that of all is played. Without `rate_Hz` the texture's own
    rate is meant. The same seed gives the same samples.

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
    third = None
    if third_rad is not None and swatch.texture.layers:
        third = np.asarray(third_rad, dtype=np.float64)
        if third.shape not in ((), force.shape):
            raise CaptureError(f"third_rad must be one number or of shape {force.shape}, has {third.shape}")
        third = np.broadcast_to(third, force.shape)
    output = np.zeros(len(force))
    if len(force) == 0:
        return output
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    player = _Player(texture, life, int(seed))
    for start in range(0, len(force), _PART * player.block):
        part = slice(start, start + _PART * player.block)
        player.add(force[part], slip[part], output[part], None if third is None else third[part])
    return output


class _Player:
    """A texture that is played on and on, from a running start."""

    def __init__(self, texture: Texture, life: float, seed: int) -> None:
        self.states = texture.states
        self.step = max(1, round(STEP_S * texture.rate_Hz))
        self.hold = max(1, round(BLOCK_S * texture.rate_Hz / self.step))
        self.block, self.step_s = self.hold * self.step, self.step / texture.rate_Hz
        self.order = max(one.order for one in self.states)
        self.life = np.zeros((len(self.states), 3 * LIFE_MAX))
        for row, of in zip(self.life, (one.life for one in self.states), strict=True):
            if of is not None and life > 0.0:
                row[: 3 * len(of.spread)] = np.column_stack((life * of.spread, of.decay_1_s, of.decay_1_m)).ravel()
        own = [("life", (LIFE_MAX,)), ("norm", (2,)), ("state", (2,)), ("fade", ())]
        fields = [(name, np.float64, shape) for name, shape in [*voice_fields(self.order), *own]]
        self.s = np.zeros(1, fields).view(np.recarray)[0]
        self.rng = seeded_state(seed, "synthesize")
        if self.life.any():
            self.s["life"] = [normal(self.rng) for _ in range(LIFE_MAX)]
        if texture.other is not None:
            draw_state(self.rng, float(texture.dwell_s[0]), float(texture.dwell_s[1]), self.s["state"])
        self.last: Array | None = None  # level of each state

    def add(self, force_N: Array, speed_m_s: Array, out: Array, third_rad: Array | None = None) -> None:
        """Add what is heard along forces, speeds (n,) to `out` (n,); n is a multiple of the block, or the end."""
        middle = np.minimum(np.arange(0, len(out), self.block) + self.block // 2, len(out) - 1)
        third = None if third_rad is None else third_rad[middle]
        models = [one.lattice(force_N[middle], speed_m_s[middle], third_rad=third) for one in self.states]
        k = np.zeros((len(models), max(len(k) for k, _ in models), self.order))
        for row, (own, _) in zip(k, models, strict=True):
            row[:, : own.shape[1]] = own
        level = np.sqrt([power for _, power in models])
        if self.last is None:
            before = np.zeros(round(SETTLE_S * self.states[0].rate_Hz))
            self.s["level_m_s2"] = self.s["gain"] = 1.0
            self._run(
                k[:, :1], np.ones((len(models), math.ceil(len(before) / self.step))), speed_m_s[:1], False, before
            )
            self.last = level[:, 0]
            self.s["level_m_s2"] = self.last[int(self.s["state"][0])]
        steps = np.arange(math.ceil(len(out) / self.step))
        ends = np.arange(len(middle) + 1) * self.hold
        ramped = [np.interp(steps + 1, ends, [last, *row]) for last, row in zip(self.last, level, strict=True)]
        speed = speed_m_s[np.minimum(steps * self.step + self.step // 2, len(out) - 1)]
        self._run(k, np.array(ramped), speed, True, out)
        self.last = level[:, -1]

    def _run(self, k: Array, level: Array, speed_m_s: Array, changing: bool, out: Array) -> None:
        travel_m = np.broadcast_to(np.abs(speed_m_s) * self.step_s, level.shape[1:]).copy()
        order, warp = (np.array([getattr(one, name) for one in self.states]) for name in ("order", "warp"))
        dwell_s = self.states[0].dwell_s if changing else np.zeros(2)
        run_texture(
            self.s, k, order, level, warp, self.life, dwell_s, CHANGE_S / self.step_s,
            travel_m, self.step_s, self.step, self.hold, self.rng, out,
        )  # fmt: skip
