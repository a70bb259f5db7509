"""Convert the acceleration channel to an output's samples. Compiled.

write       samples of the channel into a ring buffer
resample    windowed sinc, at a position that advances by the ratio of the two clocks
high-pass   Butterworth filter of second order
compensate  acceleration to force, if there is a compensator                                    handle_loop.py
limit       gain with look-ahead                                                                governor.py
fade        20 ms in and out, 5 ms out where the channel ends without notice

The compensator runs at the output's clock. A sample that the output pulls is one sample of the compensator, and
measurements carry the number of the sample.

A controller synchronises the two clocks by the number of buffered samples. Ticks arrive in blocks, and outputs pull in
bursts, so it uses the minimum within `WINDOW_S`. Within `NEAR_S` of `lag_s` the ratio is exactly the nominal one.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import HandleError
from hapscene.handle.governor import ONE, RELEASE_S, fade
from hapscene.handle.handle_dynamics import MASK
from hapscene.handle.handle_loop import DESIRED_MAX_M_S2, command_force, learn
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.handle_record import HANDLE
from hapscene.handle.plant import Array
from hapscene.records import Record, Records, records

__all__ = ["FADE_S", "PHASES", "QUICK", "LiveStream", "filter_table"]

FADE_S: Final = 0.02
"""Duration of a fade [s]. No click is audible, and the delay is below the noticeable 24 ms (Adelstein et al. 2003)."""

QUICK: Final = 4.0
"""How much faster a fade is where the channel ends without notice [1], because the servo may have died."""

LOOK_AHEAD_S: Final = 0.002
"""Look-ahead of the limiter [s]."""

STOP_DB: Final = 110.0
"""Stop-band attenuation of the resampler [dB]: images and aliases are 14 dB below the rounding to 16 bits."""

PHASES: Final = 1024
"""Filter phases between two samples [count]. Linear interpolation between two phases has an error of 1e-6 of the peak,
−118 dB."""

WINDOW_S: Final = 0.25
"""Window of the minimum number of buffered samples [s], longer than the bursts of audio output on a busy computer."""

NEAR_S: Final = 0.001
"""Deviation of the buffered time from `lag_s` at which the ratio changes [s]: one tick."""

STEER: Final = 0.2
"""Gain of the ratio for the deviation of the buffered time [1/s]. Clocks that differ by 200 ppm settle 1 ms off."""

STEER_MAX: Final = 0.003
"""Largest change of the ratio [1]: three times the difference of the worst clocks, a tenth of the JND of frequency."""

TOO_MUCH_S: Final = 0.05
"""Excess of the buffered time over `lag_s` that is skipped between two fades [s]. The ratio would need 17 s for it."""

ROOM: Final = 1 << 16
"""Size of the ring buffer [samples of the channel], a power of two: 6 s at 10 kHz."""

RING: Final = MASK + 1
"""Size of the limiter's buffers [samples], as in `governor.fade`."""

SILENT, PLAYING, FADING = 0, 1, 2

STREAM: Final = np.dtype(
    [
        # samples written so far; position of the next output sample, integer and fraction; its increment
        *((name, "i8") for name in ("written", "whole", "steered", "half")),
        *((name, "f8") for name in ("part", "nominal", "ratio")),
        # window of the clock control: its length and rest [output samples], count written before it, silent windows so
        # far, minimum of the buffered samples, parameters
        *((name, "i8") for name in ("window", "left", "before", "windows")),
        *((name, "f8") for name in ("spare", "lag", "near", "too_much", "steer", "change", "in_hand")),
        *((name, "i8") for name in ("state", "ending")),
        *((name, "f8") for name in ("faded", "fade_step", "gain", "ceiling")),
        ("high", "f8", (5,)),  # b0 b1 b2 a1 a2
        ("high_state", "f8", (2,)),
        # limiter: the fields of `governor.fade`, and the samples of the look-ahead
        *((name, "i8") for name in ("delay", "count", "first", "last", "total")),
        *((name, "f8") for name in ("released", "release", "share")),
        *((name, "f8", (RING,)) for name in ("line", "least")),
        *((name, "i8", (RING,)) for name in ("when", "gains")),
        # times the buffer ran empty, and times samples were skipped; samples attenuated, clipped, and not finite
        *((name, "i8") for name in ("gaps", "skips", "limited", "clipped", "not_finite")),
    ],
    align=True,
)
"""State of a stream."""

COUNTS: Final = ("gaps", "skips", "limited", "clipped", "not_finite")


class LiveStream:
    """The source from which an output pulls its samples, as a `Feed`."""

    def __init__(
        self,
        fetch: Callable[[int], Array | None],
        rate_Hz: float,
        output: HandleOutput,
        *,
        handle: "Records | None" = None,
        steered: bool,
    ) -> None:
        """Create a stream.

        Args:
            fetch: returns the samples that the channel received since the last call. Its argument is the number of
                samples that are needed; only recordings use it.
            rate_Hz: sample rate of the channel.
            output: the output that pulls.
            handle: a record (1,) `HANDLE` at the output's rate, whose compensator computes force from acceleration, and
                which learns from measurements; None for no compensator.
            steered: whether the channel has its own clock. Otherwise it follows the output's clock, and playing starts
                with the first samples.

        Raises:
            HandleError: the ratio of the rates is out of range.
        """
        self.rate_Hz, self.output_rate_Hz = rate_Hz, output.rate_Hz
        self._fetch, self._gain = fetch, output.gain
        self._handle = records(0, HANDLE) if handle is None else handle
        if not 0.02 <= rate_Hz / self.output_rate_Hz <= 50.0:
            raise HandleError(
                f"a channel at {rate_Hz:g} Hz cannot be played at {self.output_rate_Hz:g} Hz: "
                "their ratio must be 0.02 to 50"
            )
        self._table = filter_table(rate_Hz, self.output_rate_Hz)
        self._ring = np.zeros(ROOM)
        self._state = records(1, STREAM)
        s = self._state[0]
        s.written = s.whole = ROOM  # the buffer starts with silence
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
        write(s, self._ring, np.zeros(0))  # compile before the output starts
        render(s, self._ring, self._table, self._handle, np.zeros(0))
        self.receive_feedback(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))

    def pull(self, out: Array) -> bool:
        s = self._state[0]
        samples = self._fetch(max(0, s.whole + s.half + 2 + math.ceil(len(out) * s.ratio) - s.written))
        if samples is not None:
            write(s, self._ring, samples[-(ROOM >> 1) :])
        render(s, self._ring, self._table, self._handle, out)
        return samples is None

    def receive_feedback(self, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
        """Pass measurements of samples that were pulled to the compensator, as `Feed`."""
        _learn_all(self._handle, numbers - self._state[0].delay, force_N, acceleration_m_s2)

    def fade_in(self) -> None:
        """Discard the samples that were pulled, and start again from silence."""
        s = self._state[0]
        s.state, s.faded, s.windows = SILENT, 0.0, 0

    def set_volume(self, volume: float) -> None:
        """Set the share of the output's gain, 0 … 1."""
        self._state[0].gain = min(max(volume, 0.0), 1.0) * self._gain

    def end(self) -> None:
        """Fade out and remain silent."""
        self._state[0].ending = 1

    @property
    def over(self) -> bool:
        """Whether the stream has ended and faded out."""
        s = self._state[0]
        return bool(s.ending == 1 and s.state == SILENT)

    @property
    def played(self) -> int:
        """Number of channel samples that have been played."""
        return int(self._state[0].whole) - ROOM

    @property
    def latency_s(self) -> float:
        """Delay of a sample from the channel to the output's pull [s], averaged over the last seconds."""
        ahead = float(self._state[0].delay) + float(self._handle["delay"].sum())  # limiter, compensator
        return max(0.0, float(self._state[0].in_hand)) / self.rate_Hz + ahead / self.output_rate_Hz

    @property
    def drift(self) -> float:
        """Relative deviation of the clock of the channel from the clock of the output, as currently corrected [1]."""
        return float(self._state[0].ratio / self._state[0].nominal - 1.0)

    @property
    def counts(self) -> dict[str, int]:
        """Error counts so far, by the names `COUNTS`."""
        return {name: int(getattr(self._state[0], name)) for name in COUNTS}


def filter_table(rate_Hz: float, output_rate_Hz: float) -> Array:
    """Weights (PHASES + 1, taps) of the resampling filter, one row for each phase.

    The pass band ends at a quarter of the lower rate, or at 1 kHz if that is higher; the stop band starts at half of
    the lower rate.
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
    """Coefficients b0 b1 b2 a1 a2 of a Butterworth high-pass."""
    if corner_Hz <= 0.0:
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    b, a = scipy.signal.butter(2, corner_Hz, "highpass", fs=rate_Hz)
    return np.concatenate([b, a[1:]])


@native
def _learn_all(handle: Records, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
    """Pass measurements (n,) of the numbered samples to the compensator, if there is one."""
    for k in range(len(numbers)):
        if len(handle) > 0 and numbers[k] >= 0:  # negative numbers are samples of the limiter's initial silence
            learn(handle[0], numbers[k], force_N[k], acceleration_m_s2[k])


@native
def write(s: Record, ring: Array, samples: Array) -> None:
    """Write samples of the channel into the ring buffer. A sample that is not finite counts as 0."""
    for k in range(len(samples)):
        x = samples[k]
        if not math.isfinite(x):
            x = 0.0
            s.not_finite += 1
        ring[s.written & (ROOM - 1)] = min(max(x, -DESIRED_MAX_M_S2), DESIRED_MAX_M_S2)
        s.written += 1


@native
def render(s: Record, ring: Array, table: Array, handle: Records, out: Array) -> None:
    """Fill `out` (n,) with the next samples of a stream. `handle` is (1,), or (0,) for no compensator."""
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
        gap = s.steered == 1 and s.ending == 0 and s.written <= s.whole + s.half
        step = s.fade_step * (QUICK if gap else 1.0)
        s.faded = min(s.faded + s.fade_step, 1.0) if s.state == PLAYING else max(s.faded - step, 0.0)
        if s.state == FADING and s.faded == 0.0:
            s.state, s.windows = SILENT, 0
        out[k] = x if s.faded == 1.0 else x * 0.5 * (1.0 - math.cos(math.pi * s.faded))
    if len(out) > 0:
        _synchronise(s, len(out))


@native
def _resampled(s: Record, ring: Array, table: Array) -> float:
    """The channel at the position of the next output sample. Beyond the newest sample, that one is repeated."""
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
def _high_passed(s: Record, x: float) -> float:
    y = s.high[0] * x + s.high_state[0]
    s.high_state[0] = s.high[1] * x - s.high[3] * y + s.high_state[1]
    s.high_state[1] = s.high[2] * x - s.high[4] * y
    return float(y)


@native
def _limited(s: Record, x: float) -> float:
    """The sample of one look-ahead ago, limited to the ceiling."""
    gain = fade(s, min(1.0, s.ceiling / max(abs(x), 1e-12)))
    s.line[s.count & MASK] = x
    y = gain * s.line[(s.count - s.delay) & MASK]
    s.count += 1
    if gain < 0.999:
        s.limited += 1
    if abs(y) > s.ceiling:  # rounding errors, or a gain that changes too fast
        s.clipped += int(abs(y) > (1.0 + 1e-9) * s.ceiling)
        y = math.copysign(s.ceiling, y)
    return float(y)


@native
def _synchronise(s: Record, count: int) -> None:
    """Update the minimum of the buffered samples after `count` output samples. At the end of a window adjust the
    ratio."""
    spare = s.written - s.whole - s.part - s.half
    s.spare = min(s.spare, spare)
    s.in_hand += min(1.0, count / (8.0 * s.window)) * (spare + s.half - s.in_hand)
    s.left -= count
    if s.left > 0 or s.steered == 0:
        return
    error, came = s.spare - s.lag, s.written - s.before
    if s.state == SILENT and s.ending == 0:
        s.windows = s.windows + 1 if came > 0.9 * s.nominal * s.window else 0
        if s.windows > 1:  # the first window may contain a burst at the start of an output
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
