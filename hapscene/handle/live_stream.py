"""From the acceleration channel to an output's samples: resampled, clocks brought together, limited, faded. Compiled.

write       samples of the channel into a ring
resample    a windowed sinc, read at a place that moves by the ratio of the two clocks
high-pass   Butterworth of second order
compensate  force of acceleration, where there is a compensator                                 handle_loop.py
limit       a gain that is down before the sample that needs it so                              governor.py
fade        20 ms in and out

The compensator runs by the output's clock: a sample that the output pulls is one of the compensator's, and what an
output reads back of it is heard under the same number.

The ratio is steered by what is in hand. Ticks come in blocks, and outputs pull in bursts, so the measure is the least
that was in hand within `WINDOW_S`; near enough to `lag_s` the ratio is the nominal one to the bit.
"""

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import HandleError
from hapscene.handle.governor import MASK, ONE, RELEASE_S, fade
from hapscene.handle.handle_loop import DESIRED_MAX_M_S2, HANDLE, command_force, learn
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.plant import Array
from hapscene.records import records

__all__ = ["FADE_S", "PHASES", "LiveStream", "filter_table"]

FADE_S: Final = 0.02
"""How long a fade takes [s]: no click, and shorter than what is noticed as late (24 ms, Adelstein et al. 2003)."""

LOOK_AHEAD_S: Final = 0.002
"""How long before a peak the limiter's gain begins to fall [s]."""

STOP_DB: Final = 110.0
"""What is left of images and of what would alias [−dB]: 14 dB below the rounding to 16 bits."""

PHASES: Final = 1024
"""Places between two samples for which the filter is tabled [count]; between two of them it is a straight line, off by
1e-6 of the loudest: −118 dB."""

WINDOW_S: Final = 0.25
"""Time in which the least in hand is looked for [s]: longer than the bursts in which a busy computer's audio pulls."""

NEAR_S: Final = 0.001
"""How far from `lag_s` the least in hand may be before the ratio is changed [s]: a tick."""

STEER: Final = 0.2
"""Change of the ratio by what is too much in hand [1/s]: clocks 200 ppm apart end 1 ms further off."""

STEER_MAX: Final = 0.003
"""Largest change of the ratio [1]: thrice what the worst clocks differ by; a tenth of what the skin tells apart."""

TOO_MUCH_S: Final = 0.05
"""More in hand than this beyond `lag_s` is left out, between two fades [s]: to be rid of it by the ratio takes 17 s."""

ROOM: Final = 1 << 16
"""Samples of the channel in the ring [count], a power of two: 6 s at 10 kHz."""

RING: Final = MASK + 1
"""Room for the limiter's look-ahead, as `governor.fade` has it [samples]."""

SILENT, PLAYING, FADING = 0, 1, 2

STREAM: Final = np.dtype(
    [
        # the channel's samples so far; the place of the next output sample among them, whole and part; what it moves by
        *((name, "i8") for name in ("written", "whole", "steered", "half")),
        *((name, "f8") for name in ("part", "nominal", "ratio")),
        # the window: its length and what is left of it [output samples], what was written before it, the least in hand;
        # and how many have passed in silence
        *((name, "i8") for name in ("window", "left", "before", "windows")),
        *((name, "f8") for name in ("spare", "lag", "near", "too_much", "steer", "change", "in_hand")),
        *((name, "i8") for name in ("state", "ending")),
        *((name, "f8") for name in ("faded", "fade_step", "gain", "ceiling")),
        ("high", "f8", (5,)),  # b0 b1 b2 a1 a2
        ("high_state", "f8", (2,)),
        # the limiter: fields as `governor.fade` has them, and the samples of the look-ahead
        *((name, "i8") for name in ("delay", "count", "first", "last", "total")),
        *((name, "f8") for name in ("released", "release", "share")),
        *((name, "f8", (RING,)) for name in ("line", "least")),
        *((name, "i8", (RING,)) for name in ("when", "gains")),
        # times that nothing was left to play, that too much was in hand; samples made quieter, cut, and not finite
        *((name, "i8") for name in ("gaps", "skips", "limited", "clipped", "not_finite")),
    ],
    align=True,
)
"""A stream's state."""

COUNTS: Final = ("gaps", "skips", "limited", "clipped", "not_finite")


class LiveStream:
    """What an output pulls its samples from."""

    def __init__(
        self, fetch: Callable[[int], Array], rate_Hz: float, output: HandleOutput, *, handle: Any = None, steered: bool
    ) -> None:
        """A stream that is silent until it is pulled from.

        Args:
            fetch: gives what the channel has got since it was last called; the argument says how many samples are
                needed, which only what is recorded has to look at.
            rate_Hz: of the channel.
            output: what pulls.
            handle: a record (1,) `HANDLE` at the output's rate, whose compensator makes force of acceleration, and
                learns from what is read back; None for none.
            steered: whether the channel has a clock of its own. Without, the output's is followed, and what `fetch`
                gives begins to play at once.

        Raises:
            HandleError: rates that are too far apart.
        """
        self.rate_Hz, self.output_rate_Hz = rate_Hz, output.rate_Hz
        self._fetch, self._gain = fetch, output.gain
        self._handle = records(0, HANDLE) if handle is None else handle
        if not 0.02 <= rate_Hz / self.output_rate_Hz <= 50.0:
            raise HandleError(f"a channel of {rate_Hz:g} Hz cannot be played at {self.output_rate_Hz:g} Hz")
        self._table = filter_table(rate_Hz, self.output_rate_Hz)
        self._ring = np.zeros(ROOM)
        self._state = records(1, STREAM)
        s = self._state[0]
        s.written = s.whole = ROOM  # what is before it is silence
        s.half = self._table.shape[1] // 2
        s.nominal = s.ratio = rate_Hz / self.output_rate_Hz
        s.steered = int(steered)
        s.window = s.left = round(WINDOW_S * self.output_rate_Hz)
        s.before, s.spare = s.written, math.inf
        s.lag, s.near, s.too_much = output.lag_s * rate_Hz, NEAR_S * rate_Hz, TOO_MUCH_S * rate_Hz
        s.steer = STEER / rate_Hz
        s.gain, s.ceiling, s.fade_step = output.gain, output.ceiling, 1.0 / (FADE_S * self.output_rate_Hz)
        s.high = _high_pass(output.highpass_Hz, self.output_rate_Hz)
        s.delay = min(round(LOOK_AHEAD_S * self.output_rate_Hz), RING - 2)
        s.released, s.release = 1.0, -math.expm1(-1.0 / (RELEASE_S * self.output_rate_Hz))
        s.gains[:] = ONE
        s.total = (s.delay + 1) * ONE
        s.share = 1.0 / float(s.total)
        write(s, self._ring, np.zeros(0))  # has it compiled before anybody waits
        render(s, self._ring, self._table, self._handle, np.zeros(0))
        self.hear(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))

    def pull(self, out: Array) -> None:
        """Fill `out` (n,) with the next samples."""
        s = self._state[0]
        samples = self._fetch(max(0, s.whole + s.half + 2 + math.ceil(len(out) * s.ratio) - s.written))
        write(s, self._ring, samples[-(ROOM >> 1) :])
        render(s, self._ring, self._table, self._handle, out)

    def hear(self, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
        """Have the compensator learn from what came of samples that were pulled, as `Feed` says."""
        hear(self._handle, numbers - self._state[0].delay, force_N, acceleration_m_s2)

    def fade_in(self) -> None:
        """What was pulled before is lost: begin with silence anew."""
        s = self._state[0]
        s.state, s.faded, s.windows = SILENT, 0.0, 0

    def turn(self, volume: float) -> None:
        """Play from now on at this share of the output's gain, 0 … 1."""
        self._state[0].gain = min(max(volume, 0.0), 1.0) * self._gain

    def end(self) -> None:
        """Fade out, and stay silent."""
        self._state[0].ending = 1

    @property
    def over(self) -> bool:
        """Whether it has faded out for good."""
        s = self._state[0]
        return bool(s.ending == 1 and s.state == SILENT)

    @property
    def played(self) -> int:
        """How many samples of the channel have been pulled past."""
        return int(self._state[0].whole) - ROOM

    @property
    def latency_s(self) -> float:
        """How long after it came from the channel a sample is pulled [s], on average over the last seconds."""
        ahead = float(self._state[0].delay) + float(self._handle["delay"].sum())  # limiter, compensator
        return max(0.0, float(self._state[0].in_hand)) / self.rate_Hz + ahead / self.output_rate_Hz

    @property
    def drift(self) -> float:
        """How much faster than it says the channel's clock runs than the output's, as far as it is steered [1]."""
        return float(self._state[0].ratio / self._state[0].nominal - 1.0)

    @property
    def counts(self) -> dict[str, int]:
        """What went wrong so far, by name: `COUNTS`."""
        return {name: int(getattr(self._state[0], name)) for name in COUNTS}


def filter_table(rate_Hz: float, output_rate_Hz: float) -> Array:
    """Weights (PHASES + 1, taps) of the samples around a place, by how far it is past the one in the middle.

    Flat to a quarter of the lower rate, and to 1 kHz where that is more; nothing passes from half of it on.
    """
    lower_Hz = min(rate_Hz, output_rate_Hz)
    edge_Hz = max(0.25 * lower_Hz, min(1000.0, 0.42 * lower_Hz))
    width = (0.5 * lower_Hz - edge_Hz) / rate_Hz
    half = math.ceil((STOP_DB - 7.95) / (4.0 * math.pi * 2.285 * width))  # Kaiser 1974
    window, cut_Hz = ("kaiser", float(scipy.signal.kaiser_beta(STOP_DB))), 0.5 * (edge_Hz + 0.5 * lower_Hz)
    whole = scipy.signal.firwin(2 * half * PHASES + 1, cut_Hz, window=window, fs=rate_Hz * PHASES)
    table = np.stack([whole[p : p + (2 * half - 1) * PHASES + 1 : PHASES][::-1] for p in range(PHASES + 1)])
    return np.asarray(table / table.sum(axis=1, keepdims=True))


def _high_pass(corner_Hz: float, rate_Hz: float) -> Array:
    """b0 b1 b2 a1 a2 of a Butterworth filter."""
    if corner_Hz <= 0.0:
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    b, a = scipy.signal.butter(2, corner_Hz, "highpass", fs=rate_Hz)
    return np.concatenate([b, a[1:]])


@native
def hear(handle: Any, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
    """Tell a compensator, if there is one, what came of its samples of those numbers (n,)."""
    for k in range(len(numbers)):
        if len(handle) > 0 and numbers[k] >= 0:  # what the limiter had before the first is none of them
            learn(handle[0], numbers[k], force_N[k], acceleration_m_s2[k])


@native
def write(s: Any, ring: Array, samples: Array) -> None:
    """Samples of the channel into the ring; what is not finite counts as 0."""
    for k in range(len(samples)):
        x = samples[k]
        if not math.isfinite(x):
            x = 0.0
            s.not_finite += 1
        ring[s.written & (ROOM - 1)] = min(max(x, -DESIRED_MAX_M_S2), DESIRED_MAX_M_S2)
        s.written += 1


@native
def render(s: Any, ring: Array, table: Array, handle: Any, out: Array) -> None:
    """Fill `out` (n,) with the next samples of a stream, by the compensator of `handle` (1,), or none (0,)."""
    if s.state == SILENT and s.steered == 0 and s.ending == 0 and s.written > s.whole + s.half:
        s.state = PLAYING
    for k in range(len(out)):
        if s.state == PLAYING and (s.ending == 1 or s.written <= s.whole + s.half):
            s.gaps += s.steered * (1 - s.ending)
            s.state = FADING
        x = _high_passed(s, _resampled(s, ring, table))
        if len(handle) > 0:
            x = command_force(handle[0], x)
            s.limited += 1 if handle[0].due_gain[(handle[0].count - 1) & MASK] < 0.999 else 0
        x = _limited(s, s.gain * x)
        s.faded = min(s.faded + s.fade_step, 1.0) if s.state == PLAYING else max(s.faded - s.fade_step, 0.0)
        if s.state == FADING and s.faded == 0.0:
            s.state, s.windows = SILENT, 0
        out[k] = x if s.faded == 1.0 else x * 0.5 * (1.0 - math.cos(math.pi * s.faded))
    if len(out) > 0:
        _look(s, len(out))


@native
def _resampled(s: Any, ring: Array, table: Array) -> float:
    """The channel at the place of the next output sample; past its newest sample that is held."""
    total = 0.0
    if s.state != SILENT:
        at = s.part * PHASES
        row = int(at)
        share = at - row
        first, newest = s.whole - s.half + 1, s.written - 1
        for j in range(table.shape[1]):
            weight = table[row, j] + share * (table[row + 1, j] - table[row, j])
            total += weight * ring[min(first + j, newest) & (ROOM - 1)]
    s.part += s.ratio
    step = int(s.part)
    s.part -= step
    s.whole += step
    return total


@native
def _high_passed(s: Any, x: float) -> float:
    y = s.high[0] * x + s.high_state[0]
    s.high_state[0] = s.high[1] * x - s.high[3] * y + s.high_state[1]
    s.high_state[1] = s.high[2] * x - s.high[4] * y
    return float(y)


@native
def _limited(s: Any, x: float) -> float:
    """The sample of a look-ahead ago, never above the ceiling."""
    gain = fade(s, min(1.0, s.ceiling / max(abs(x), 1e-12)))
    s.line[s.count & MASK] = x
    y = gain * s.line[(s.count - s.delay) & MASK]
    s.count += 1
    if gain < 0.999:
        s.limited += 1
    if abs(y) > s.ceiling:  # the last net
        s.clipped += int(abs(y) > (1.0 + 1e-9) * s.ceiling)
        y = math.copysign(s.ceiling, y)
    return float(y)


@native
def _look(s: Any, count: int) -> None:
    """How much is in hand after so many samples; at a window's end the ratio is steered by the least of it."""
    spare = s.written - s.whole - s.part - s.half
    s.spare = min(s.spare, spare)
    s.in_hand += min(1.0, count / (8.0 * s.window)) * (spare + s.half - s.in_hand)
    s.left -= count
    if s.left > 0 or s.steered == 0:
        return
    error, came = s.spare - s.lag, s.written - s.before
    if s.state == SILENT and s.ending == 0:
        s.windows = s.windows + 1 if came > 0.9 * s.nominal * s.window else 0
        if s.windows > 1:  # the first may hold what an output pulls at once as it begins
            s.whole += int(error)
            s.in_hand = spare + s.half - error
            s.state = PLAYING
    elif s.state == PLAYING and error > s.too_much:
        s.skips += 1
        s.state = FADING
    elif s.state == PLAYING:
        beyond = error - min(max(error, -s.near), s.near)
        s.change += 0.2 * (beyond - s.change)
        s.ratio = s.nominal * (1.0 + min(max(s.steer * s.change, -STEER_MAX), STEER_MAX))
    s.left, s.before, s.spare = s.window, s.written, math.inf
