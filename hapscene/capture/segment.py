"""What the tool does when: a recording cut by interaction state, and its sliding into stationary pieces.

| state | is |
|---|---|
| AIR | no contact; without a force also any rest, for the two look alike then |
| STILL | in contact, at rest |
| SLIDING | in contact, moving along |
| TAP | an impact and its ringing, until it is over |

Thresholds come from the recording. A stream is "on" from `ABOVE_NOISE` times its noise, and at least `SHARE_ON` of its
95 % quantile; "off" again below half of that. Its noise is measured where it is quietest: the part between 20 and
100 Hz, which a hand hardly makes, taken as white. A force is expected to be zero in the air: tare it.

Without a varying force or speed the vibration has to tell. It does where its level rises by `LEVEL_RATIO` over the
quietest stretches; where not, all is taken to be one state, sliding. A raster plate of
epoxy alone makes it rise by up to 21 dB.
"""

from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.change_point import change_points
from hapscene.capture.streams import HAND_CUTOFF_HZ, Array, Streams, filtered
from hapscene.constants import ACCELERATION_BAND_HZ

Mask = NDArray[np.bool_]
Run = tuple[int, int]
"""First sample, and the one after the last."""

ABOVE_NOISE: Final = 6.0
"""Where a stream is on, in standard deviations of its noise [1]: once in 10⁸ samples by chance."""

SHARE_ON: Final = 0.02
"""Where a stream is on at least, as a share of its 95 % quantile [1]."""

OFF: Final = 0.5
"""Where it is off again, as a share of where it is on [1]."""

LEVEL_RATIO: Final = 12.0
"""Level over that of the quietest stretches from which a vibration tells rest from motion [1]. Noise 20 dB below a
vibration whose level varies as noise does is at 13; the raster plate, at most at 11.7, is taken to slide throughout."""

LEVEL_S: Final = 0.01
"""Window of the level of a vibration [s]."""

BRIEF_S: Final = 0.05
"""Sliding shorter than this is none [s]: the tool shifts as it lands."""

TAP_S: Final = 0.2
"""Longest contact that counts as a tap, and longest ringing [s]."""

REST_S: Final = 0.03
"""Quiet stretches shorter than this do not end a burst of vibration [s]: a low tone has gaps of half a period."""

IMPACT: Final = 5.0
"""Peak of an impact over the level before it, and over that of the contact after it [1]."""

ONSET_SHARE: Final = 0.25
"""Share of its peak at which an impact has begun [1]: above the ripple that the high-pass puts before it."""

ONSET_S: Final = (0.03, 0.03)
"""How long before and after the force rises an impact may lie [s]: the force is low-passed, an impact is not."""


class InteractionState(IntEnum):
    """What the tool does."""

    AIR = 0
    STILL = 1
    SLIDING = 2
    TAP = 3


@dataclass(frozen=True)
class Segmentation:
    """The states over a recording of n samples.

    Attributes:
        rate_Hz: of the recording.
        states: (n,) a `State` each sample.
        changes: samples within sliding at which its vibration changes, ascending.
        force_on_N: normal force from which the tool was taken to be in contact; None where that was not told by force.
        speed_on_m_s: speed from which it was taken to slide, or None likewise.
    """

    rate_Hz: float
    states: NDArray[np.int8]
    changes: tuple[int, ...]
    force_on_N: float | None
    speed_on_m_s: float | None

    def runs(self, state: InteractionState) -> list[Run]:
        """The stretches of a state."""
        return runs(self.states == state)

    def stationary(self) -> list[Run]:
        """The stretches of sliding, cut where their vibration changes."""
        pieces = []
        for start, end in self.runs(InteractionState.SLIDING):
            places = [start, *(c for c in self.changes if start < c < end), end]
            pieces += list(pairwise(places))
        return pieces

    def seconds(self, state: InteractionState) -> float:
        """How long a state was held in all [s]."""
        return float(np.count_nonzero(self.states == state)) / self.rate_Hz


def segment(channels: Streams) -> Segmentation:
    """Cuts a cleaned recording into states, and its sliding where the vibration changes."""
    rate = channels.rate_Hz
    level = _level(channels.acceleration_m_s2, rate)
    by_force, by_speed = np.ptp(channels.force_N) > 0.0, np.ptp(channels.speed_m_s) > 0.0
    force_on = _threshold(channels.force_N, rate) if by_force else None
    speed_on = _threshold(channels.speed_m_s, rate) if by_speed else None
    contact = channels.force_N > 0.0 if force_on is None else _switched(channels.force_N, force_on, OFF * force_on)
    moving = channels.speed_m_s > 0.0 if speed_on is None else _switched(channels.speed_m_s, speed_on, OFF * speed_on)
    told, heard = _heard(level, rate, ~contact)
    if told and not (by_force and by_speed):
        moving &= heard
    states = np.full(len(contact), InteractionState.AIR, dtype=np.int8)
    states[contact] = InteractionState.STILL if by_force else InteractionState.AIR
    sliding = _without_brief(contact & moving, round(BRIEF_S * rate))
    states[sliding] = InteractionState.SLIDING
    if by_force:
        _mark_impacts(states, contact, channels.acceleration_m_s2, level, rate)
    elif told:
        _mark_bursts(states, heard, level, rate)
    del level, heard  # of a long recording they are as large as a stream
    changes = []
    for start, end in runs(states == InteractionState.SLIDING):
        changes += [start + c for c in change_points(channels.acceleration_m_s2[start:end], rate)]
    return Segmentation(rate, states, tuple(changes), force_on, speed_on)


def runs(mask: Mask) -> list[Run]:
    """The stretches in which `mask` (n,) holds."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=np.int8(0), append=np.int8(0)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _mark_impacts(states: NDArray[np.int8], contact: Mask, acceleration: Array, level: Array, rate: float) -> None:
    """Marks the taps in `states`: contacts that begin with an impact, as a whole if they are brief."""
    before, after = (round(s * rate) for s in ONSET_S)
    touched = runs(contact)
    for i, (start, end) in enumerate(touched):
        free = touched[i - 1][1] if i else 0
        if start == 0:
            continue  # it began before the recording did
        first = max(free, start - before)
        reach = slice(first, min(start + after, len(level)))
        calm = level[max(free, first - round(0.05 * rate)) : first]
        peak = float(level[reach].max())
        quiet = float(np.median(calm)) if len(calm) else float(level[first])
        settled = level[start + round(0.1 * rate) : min(end, start + round(0.25 * rate))]
        brief = end - start <= TAP_S * rate
        if peak < IMPACT * quiet or (not brief and len(settled) and peak < IMPACT * float(np.median(settled))):
            continue
        onset = first + _onset(acceleration[reach], quiet)
        next_touch = touched[i + 1][0] - before if i + 1 < len(touched) else len(level)
        over = _rung_out(level, onset, quiet, min(next_touch, onset + round(TAP_S * rate)))
        states[onset : max(over, end) if brief else over] = InteractionState.TAP


def _mark_bursts(states: NDArray[np.int8], heard: Mask, level: Array, rate: float) -> None:
    """Marks the taps in `states` where no force tells: bursts that are brief and loudest at their start."""
    for start, end in runs(heard):
        burst = level[start:end]
        brief = start > 0 and end - start <= TAP_S * rate
        early = int(np.argmax(burst)) <= max(len(burst) // 3, round(LEVEL_S * rate))
        if brief and early and burst.max() >= IMPACT * np.median(burst[-(len(burst) // 4 + 1) :]):
            states[start:end] = InteractionState.TAP


def _onset(acceleration: Array, quiet: float) -> int:
    """The sample at which an impact begins: the first that is loud before its peak."""
    size = np.abs(acceleration)
    return int(np.argmax(size >= max(3.0 * quiet, ONSET_SHARE * float(size.max()))))


def _rung_out(level: Array, onset: int, quiet: float, last: int) -> int:
    """The sample at which the ringing of an impact is over: its level is back at what it was, or at 2 % of its peak."""
    part = level[onset:last]
    if not len(part):
        return onset + 1
    peak = int(part.argmax())
    calm = np.flatnonzero(part[peak:] < max(1.5 * quiet, 0.02 * part[peak]))
    return onset + peak + int(calm[0]) if len(calm) else last


def _heard(level: Array, rate: float, air: Mask) -> tuple[bool, Mask]:
    """Whether the vibration tells rest from motion, and where (n,) it does tell motion."""
    quiet = float(np.median(level[air])) if np.count_nonzero(air) > 0.1 * rate else float(np.quantile(level, 0.02))
    loud, usual = float(np.quantile(level, 0.95)), float(np.median(level))
    if loud < LEVEL_RATIO * quiet and usual < 2.0 * quiet:
        loud = float(level.max())  # all is quiet but for a few taps
        quiet = usual
    if loud < LEVEL_RATIO * quiet or loud <= 0.0:
        return False, np.ones(len(level), dtype=np.bool_)
    quiet = max(quiet, 1e-4 * loud)
    on = np.sqrt(quiet * loud)
    heard = _switched(level, on, OFF * on)
    return True, ~_without_brief(~heard, round(REST_S * rate))


def _level(acceleration: Array, rate: float) -> Array:
    """Root of the mean square (n,) over `LEVEL_S`."""
    from scipy.ndimage import uniform_filter1d

    power = uniform_filter1d(acceleration**2, max(1, round(LEVEL_S * rate)), mode="nearest")
    return np.asarray(np.sqrt(np.maximum(power, 0.0, out=power), out=power))


def _threshold(stream: Array, rate: float) -> float:
    """Where a low-passed stream is on."""
    return max(
        ABOVE_NOISE * noise(stream, rate),
        SHARE_ON * float(np.quantile(np.abs(stream), 0.95, overwrite_input=True)),
        1e-12,
    )


def noise(stream: Array, rate: float) -> float:
    """Standard deviation of a low-passed stream's noise, where it is quietest: a tenth of its 50 ms windows."""
    low, high = ACCELERATION_BAND_HZ[0], HAND_CUTOFF_HZ
    shaken = filtered(stream, rate, low, "highpass", order=2)
    length = max(1, round(0.05 * rate))
    windows = shaken[: len(shaken) // length * length].reshape(-1, length)
    power = np.einsum("kn,kn->k", windows, windows) / length
    return float(np.sqrt(np.quantile(power, 0.1) * high / (high - low)))


def _switched(stream: Array, on: float, off: float) -> Mask:
    """A switch with hysteresis (n,): on above `on`, off below `off`, in between as before."""
    above, known = stream > on, (stream > on) | (stream < off)
    if not known.any():
        return np.zeros(len(stream), dtype=np.bool_)
    first = int(known.argmax())
    last = np.arange(len(stream), dtype=np.int32)  # where it was told last
    last[~known] = first
    return np.asarray(above[np.maximum.accumulate(last, out=last)])


def _without_brief(mask: Mask, shortest: int) -> Mask:
    """`mask` (n,) without its stretches shorter than that; those at the ends of the recording stay."""
    kept = mask.copy()
    for start, end in runs(mask):
        if end - start < shortest and start > 0 and end < len(mask):
            kept[start:end] = False
    return kept
