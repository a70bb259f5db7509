"""Segmentation: divides a recording by interaction state, and sliding into stationary segments.

| state | meaning |
|---|---|
| AIR | no contact; if the force was not recorded, also contact at rest |
| STILL | contact at rest |
| SLIDING | sliding contact |
| TAP | an impact until its ringing has ended |

Thresholds are derived from the recording. A stream is "on" above `ABOVE_NOISE` standard deviations of its noise and
above `SHARE_ON` of its 95 % quantile, and "off" below half of that threshold; speed is measured relative to its value
at rest. The noise is that of the quietest windows between 20 and 100 Hz, where hand motion has little power, and is
assumed to be white. The force must be 0 without contact (tare the sensor).

If force or speed was not recorded, the vibration decides, provided that its level rises by `LEVEL_RATIO` above the
quietest parts. Otherwise the whole recording counts as sliding. (The level on a raster plate of epoxy alone varies by
up to 21 dB.)"""

from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.change_point import change_points
from hapscene.capture.io.streams import BLOCK, HAND_CUTOFF_HZ, Array, Streams, blocks, filtered
from hapscene.constants import ACCELERATION_BAND_HZ

__all__ = [
    "BRIEF_S",
    "IMPACT",
    "InteractionState",
    "Run",
    "Segmentation",
    "SegmentedRecording",
    "noise",
    "onset",
    "runs",
    "segment",
]

Mask = NDArray[np.bool_]
Run = tuple[int, int]
"""Index of the first sample, and index after the last sample."""

ABOVE_NOISE: Final = 6.0
"""Threshold of a stream in standard deviations of its noise [1]; noise exceeds it once in 10⁸ samples."""

SHARE_ON: Final = 0.02
"""Smallest threshold of a stream, relative to its 95 % quantile [1]."""

MOVING_SHARE: Final = 0.25
"""Largest threshold of the speed, relative to its 95 % quantile, if that is above the noise [1]."""

OFF: Final = 0.5
"""Lower threshold of the hysteresis, relative to the upper one [1]."""

LEVEL_RATIO: Final = 12.0
"""Smallest ratio of the vibration level to its level in the quietest parts that distinguishes motion from rest [1].
Noise 20 dB below a stationary vibration gives 13; sliding on the raster plate gives at most 11.7."""

LEVEL_S: Final = 0.01
"""Window of the vibration level [s]."""

BRIEF_S: Final = 0.05
"""Shortest sliding [s]; a shorter one is a shift of the tool at landing."""

TAP_S: Final = 0.2
"""Longest contact that counts as a tap, and longest ringing of a tap [s]."""

REST_S: Final = 0.03
"""Shortest quiet interval that ends a burst of vibration, and shortest lift that ends a contact [s]. A low tone has
quiet intervals of half a period."""

IMPACT: Final = 5.0
"""Smallest ratio of the peak of an impact to the vibration of the contact after it [1]."""

RISE: Final = 2.5
"""Smallest ratio of the peak of an impact to the level before it [1]; white noise rarely exceeds 1.5."""

ONSET_SHARE: Final = 0.25
"""Fraction of its peak that marks the onset of an impact [1]; above the pre-ripple of the high-pass."""

ONSET_GAP_S: Final = 0.012
"""Longest quiet interval within an impact [s]; a vibration before a longer one is not part of the impact."""

ONSET_S: Final = (0.03, 0.03)
"""Time before and after the rise of the low-passed force in which the impact is searched [s]."""


class InteractionState(IntEnum):
    """Interaction state of the tool."""

    AIR = 0
    STILL = 1
    SLIDING = 2
    TAP = 3

    @property
    def word(self) -> str:
        """Name of the state for the user."""
        return ("no contact", "at rest", "sliding", "tap")[self]


@dataclass(frozen=True)
class Segmentation:
    """Interaction states of a recording of n samples.

    Attributes:
        rate_Hz: sample rate.
        states: (n,) `InteractionState` of each sample.
        changes: samples at which the vibration of sliding changes, ascending.
        force_on_N: threshold of the normal force for contact; None if the force was not recorded.
        speed_on_m_s: threshold of the speed for sliding; None if the speed was not recorded.
    """

    rate_Hz: float
    states: NDArray[np.int8]
    changes: tuple[int, ...]
    force_on_N: float | None
    speed_on_m_s: float | None

    def runs(self, state: InteractionState) -> list[Run]:
        """Runs of samples in a state."""
        return runs(self.states == state)

    def stationary(self) -> list[Run]:
        """Runs of sliding, divided at the changes of the vibration."""
        segments = []
        for start, end in self.runs(InteractionState.SLIDING):
            borders = [start, *(c for c in self.changes if start < c < end), end]
            segments += list(pairwise(borders))
        return segments

    def seconds(self, state: InteractionState) -> float:
        """Total time in a state [s]."""
        return float(np.count_nonzero(self.states == state)) / self.rate_Hz


SegmentedRecording = tuple[Streams, Segmentation]
"""A filtered recording and its segmentation."""


def segment(channels: Streams) -> Segmentation:
    """Segments a filtered recording by interaction state, and sliding where the vibration changes."""
    rate = channels.rate_Hz
    level = _level(channels.acceleration_m_s2, rate)
    by_force, by_speed = np.ptp(channels.force_N) > 0.0, np.ptp(channels.speed_m_s) > 0.0
    force_on = _threshold(channels.force_N, rate) if by_force else None
    rest = channels.speed_rest_m_s
    speed_on = rest + _speed_threshold(channels.speed_m_s, rest, rate) if by_speed else None
    contact = channels.force_N > 0.0 if force_on is None else _switched(channels.force_N, force_on, OFF * force_on)
    # removes gaps due to the ringing of the low-pass after an impact
    contact = ~_without_brief(~contact, round(REST_S * rate))
    moving = channels.speed_m_s > 0.0
    if speed_on is not None:
        moving = _switched(channels.speed_m_s, speed_on, rest + OFF * (speed_on - rest))
    separates, vibrating = _vibrating(level, rate, ~contact)
    if separates and not (by_force and by_speed):
        moving &= vibrating
    states = np.full(len(contact), InteractionState.AIR, dtype=np.int8)
    states[contact] = InteractionState.STILL if by_force else InteractionState.AIR
    sliding = _without_brief(contact & moving, round(BRIEF_S * rate))
    states[sliding] = InteractionState.SLIDING
    if by_force:
        _mark_impacts(states, contact, channels.acceleration_m_s2, level, rate)
    if separates:
        if force_on is not None:  # light taps below the threshold of the force
            for start, end in runs(vibrating):
                in_air = not np.any(states[start:end])
                vibrating[start:end] = in_air and channels.force_N[start:end].max() > OFF * force_on
        else:
            _remove_ripple(vibrating, level, rate)
        _mark_bursts(states, vibrating, level, rate)
    sliding = states == InteractionState.SLIDING
    brief = sliding & ~_without_brief(sliding, round(BRIEF_S * rate))  # remainders of sliding next to a tap
    states[brief] = InteractionState.STILL if by_force else InteractionState.AIR
    del level, vibrating  # free memory: each is as large as a stream
    changes = []
    for start, end in runs(states == InteractionState.SLIDING):
        changes += [start + c for c in change_points(channels.acceleration_m_s2[start:end], rate)]
    return Segmentation(rate, states, tuple(changes), force_on, speed_on)


def runs(mask: Mask) -> list[Run]:
    """Runs of True in `mask` (n,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=np.int8(0), append=np.int8(0)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _mark_impacts(states: NDArray[np.int8], contact: Mask, acceleration: Array, level: Array, rate: float) -> None:
    """Marks taps in `states`: impacts at the start of contacts, and whole contacts if they are brief."""
    before, after = (round(s * rate) for s in ONSET_S)
    touched = runs(contact)
    for i, (start, end) in enumerate(touched):
        free = touched[i - 1][1] if i else 0
        if start == 0:
            continue  # the contact began before the recording
        first = max(free, start - before)
        reach = slice(first, min(start + after, len(level)))
        calm = level[max(free, first - round(0.05 * rate)) : first]
        peak = float(level[reach].max())
        quiet = float(np.median(calm)) if len(calm) else float(level[first])
        settled = level[start + round(0.1 * rate) : min(end, start + round(0.25 * rate))]
        after_it = float(np.median(settled)) if len(settled) else 0.0
        brief = end - start <= TAP_S * rate
        if peak < RISE * quiet or (not brief and after_it > 1.5 * quiet and peak < IMPACT * after_it):
            continue
        begun = first + onset(acceleration[reach], quiet, rate)
        next_touch = touched[i + 1][0] - before if i + 1 < len(touched) else len(level)
        over = _rung_out(level, begun, quiet, min(next_touch, begun + round(TAP_S * rate)))
        states[begun : max(over, end) if brief else over] = InteractionState.TAP


def _mark_bursts(states: NDArray[np.int8], vibrating: Mask, level: Array, rate: float) -> None:
    """Marks taps in `states` by vibration alone: brief bursts that are strongest at their start."""
    for start, end in runs(vibrating):
        burst = level[start:end]
        brief = start > 0 and end - start <= TAP_S * rate
        early = int(np.argmax(burst)) <= max(len(burst) // 3, round(LEVEL_S * rate))
        calm, end_level = level[max(0, start - round(0.05 * rate)) : start], np.median(burst[-(len(burst) // 4 + 1) :])
        if brief and early and (burst.max() >= IMPACT * end_level or end_level <= 2.0 * np.median(calm)):
            states[start:end] = InteractionState.TAP


def _remove_ripple(vibrating: Mask, level: Array, rate: float) -> None:
    """Removes from `vibrating` the pre-ripple of the high-pass: half a period of its cut-off before an impact."""
    for start, end in runs(vibrating):
        peak = start + int(np.argmax(level[start:end]))
        if start > 0 and peak - start <= 0.5 / ACCELERATION_BAND_HZ[0] * rate + LEVEL_S * rate:
            vibrating[start : max(start, peak - round(LEVEL_S * rate))] = False


def onset(acceleration: Array, quiet: float, rate: float) -> int:
    """Sample at which an impact begins: the first above the threshold without a gap before its peak."""
    size = np.abs(acceleration)
    peak = int(size.argmax())
    loud = np.flatnonzero(size[: peak + 1] >= min(max(3.5 * quiet, ONSET_SHARE * size[peak]), size[peak]))
    gaps = np.flatnonzero(np.diff(loud) > ONSET_GAP_S * rate)
    return int(loud[gaps[-1] + 1 if len(gaps) else 0])


def _rung_out(level: Array, onset: int, quiet: float, last: int) -> int:
    """Return the sample at which an impact has decayed to the level before it or to 2 % of its peak."""
    part = level[onset:last]
    if not len(part):
        return onset + 1
    peak = int(part.argmax())
    calm = np.flatnonzero(part[peak:] < max(1.5 * quiet, 0.02 * part[peak]))
    return onset + peak + int(calm[0]) if len(calm) else last


def _vibrating(level: Array, rate: float, air: Mask) -> tuple[bool, Mask]:
    """Return whether the vibration distinguishes rest from motion, and the mask (n,) of samples with vibration."""
    quiet = float(np.median(level[air])) if np.count_nonzero(air) > 0.1 * rate else float(np.quantile(level, 0.02))
    loud, usual = float(np.quantile(level, 0.95)), float(np.median(level))
    taps_alone = loud < LEVEL_RATIO * quiet and usual < 2.0 * quiet
    if taps_alone:
        loud = float(level.max())  # only a few taps are above the noise
        quiet = usual
    if loud < LEVEL_RATIO * quiet or loud <= 0.0:
        return False, np.ones(len(level), dtype=np.bool_)
    quiet = max(quiet, 1e-4 * loud)
    on = RISE * quiet if taps_alone else np.sqrt(quiet * loud)
    vibrating = _switched(level, on, OFF * on)
    return True, ~_without_brief(~vibrating, round(REST_S * rate))


def _level(acceleration: Array, rate: float) -> Array:
    """Moving root mean square (n,) over `LEVEL_S`."""
    length = round(LEVEL_S * rate)
    power = np.empty_like(acceleration)
    for block in blocks(len(power), BLOCK):
        first = max(0, block.start - length)
        near = scipy.ndimage.uniform_filter1d(acceleration[first : block.stop + length] ** 2, length, mode="nearest")
        power[block] = near[block.start - first :][:BLOCK]
    return np.asarray(np.sqrt(np.maximum(power, 0.0, out=power), out=power))


def _threshold(stream: Array, rate: float) -> float:
    """Threshold of a low-passed stream."""
    return max(
        ABOVE_NOISE * noise(stream, rate),
        SHARE_ON * float(np.quantile(np.abs(stream), 0.95, overwrite_input=True)),
        1e-12,
    )


def _speed_threshold(speed: Array, rest: float, rate: float) -> float:
    """Threshold of the speed above its value at rest; limited, because stick–slip motion raises the noise estimate."""
    on, usual = _threshold(speed, rate), float(np.quantile(speed, 0.95))
    return min(on, MOVING_SHARE * (usual - rest)) if usual > 3.0 * rest else on


def noise(stream: Array, rate: float) -> float:
    """Standard deviation of the noise of a low-passed stream, from the quietest tenth of its 50 ms windows."""
    low, high = ACCELERATION_BAND_HZ[0], HAND_CUTOFF_HZ
    fast = filtered(stream, rate, low, "highpass", order=2)
    length = round(0.05 * rate)
    windows = fast[: len(fast) // length * length].reshape(-1, length)
    power = np.einsum("kn,kn->k", windows, windows) / length
    return float(np.sqrt(np.quantile(power, 0.1) * high / (high - low)))


def _switched(stream: Array, on: float, off: float) -> Mask:
    """Switch with hysteresis (n,): True above `on`, False below `off`, unchanged in between."""
    above, known = stream > on, (stream > on) | (stream < off)
    if not known.any():
        return np.zeros(len(stream), dtype=np.bool_)
    first = int(known.argmax())
    last = np.arange(len(stream), dtype=np.int32)  # index of the last sample outside the hysteresis band
    last[~known] = first
    return np.asarray(above[np.maximum.accumulate(last, out=last)])


def _without_brief(mask: Mask, shortest: int) -> Mask:
    """`mask` (n,) without runs shorter than `shortest`; runs at the ends of the recording are kept."""
    kept = mask.copy()
    for start, end in runs(mask):
        if end - start < shortest and start > 0 and end < len(mask):
            kept[start:end] = False
    return kept
