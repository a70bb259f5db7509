"""What the tool does when: a recording cut by interaction state, and its sliding into stationary pieces.

| state | is |
|---|---|
| AIR | no contact; without a force also any rest, for the two look alike then |
| STILL | in contact, at rest |
| SLIDING | in contact, moving along |
| TAP | an impact and its ringing, until it is over |

Thresholds come from the recording. A stream is "on" from `ABOVE_NOISE` times its noise, and at least `SHARE_ON` of its
95 % quantile; "off" again below half of that; a speed, above what it reads at rest. Its noise is measured where it is
quietest: the part between 20 and 100 Hz, which a hand hardly makes, taken as white. A force is expected to be zero in
the air: tare it.

Without a varying force or speed the vibration has to tell. It does where its level rises by `LEVEL_RATIO` over the
quietest stretches; where not, all is taken to be one state, sliding. A raster plate of
epoxy alone makes it rise by up to 21 dB.
"""

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
    "LEVEL_S",
    "TAP_S",
    "InteractionState",
    "Part",
    "Run",
    "Segmentation",
    "noise",
    "onset",
    "runs",
    "segment",
]

Mask = NDArray[np.bool_]
Run = tuple[int, int]
"""First sample, and the one after the last."""

ABOVE_NOISE: Final = 6.0
"""Where a stream is on, in standard deviations of its noise [1]: once in 10⁸ samples by chance."""

SHARE_ON: Final = 0.02
"""Where a stream is on at least, as a share of its 95 % quantile [1]."""

MOVING_SHARE: Final = 0.25
"""Where a speed is on at most, as a share of its 95 % quantile [1], where that is no noise."""

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
"""Quiet stretches shorter than this do not end a burst of vibration [s]: a low tone has gaps of half a period; nor do
as long ones in the air end a contact."""

IMPACT: Final = 5.0
"""Peak of an impact over that of the contact after it, where something vibrates then [1]."""

RISE: Final = 2.5
"""Peak of an impact over the level before it [1]: of white noise over `LEVEL_S` seldom above 1.5."""

ONSET_SHARE: Final = 0.25
"""Share of its peak at which an impact has begun [1]: above the ripple that the high-pass puts before it."""

ONSET_GAP_S: Final = 0.012
"""What is loud longer before the rest of an impact is none of it [s]: a faint low tone is so each half period only."""

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


Part = tuple[Streams, Segmentation]
"""A recording, cleaned, and its states."""


def segment(channels: Streams) -> Segmentation:
    """Cuts a cleaned recording into states, and its sliding where the vibration changes."""
    rate = channels.rate_Hz
    level = _level(channels.acceleration_m_s2, rate)
    by_force, by_speed = np.ptp(channels.force_N) > 0.0, np.ptp(channels.speed_m_s) > 0.0
    force_on = _threshold(channels.force_N, rate) if by_force else None
    rest = channels.speed_rest_m_s
    speed_on = rest + _speed_threshold(channels.speed_m_s, rest, rate) if by_speed else None
    contact = channels.force_N > 0.0 if force_on is None else _switched(channels.force_N, force_on, OFF * force_on)
    contact = ~_without_brief(~contact, round(REST_S * rate))  # what the low-pass rings on after an impact
    moving = channels.speed_m_s > 0.0
    if speed_on is not None:
        moving = _switched(channels.speed_m_s, speed_on, rest + OFF * (speed_on - rest))
    told, heard = _heard(level, rate, ~contact)
    if told and not (by_force and by_speed):
        moving &= heard
    states = np.full(len(contact), InteractionState.AIR, dtype=np.int8)
    states[contact] = InteractionState.STILL if by_force else InteractionState.AIR
    sliding = _without_brief(contact & moving, round(BRIEF_S * rate))
    states[sliding] = InteractionState.SLIDING
    if by_force:
        _mark_impacts(states, contact, channels.acceleration_m_s2, level, rate)
    if told:
        if force_on is not None:  # a faint tap that the force's noise hides
            for start, end in runs(heard):
                in_air = not np.any(states[start:end])
                heard[start:end] = in_air and channels.force_N[start:end].max() > OFF * force_on
        else:
            _without_ripple(heard, level, rate)
        _mark_bursts(states, heard, level, rate)
    sliding = states == InteractionState.SLIDING
    brief = sliding & ~_without_brief(sliding, round(BRIEF_S * rate))  # what a tap has left of it
    states[brief] = InteractionState.STILL if by_force else InteractionState.AIR
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
        after_it = float(np.median(settled)) if len(settled) else 0.0
        brief = end - start <= TAP_S * rate
        if peak < RISE * quiet or (not brief and after_it > 1.5 * quiet and peak < IMPACT * after_it):
            continue
        begun = first + onset(acceleration[reach], quiet, rate)
        next_touch = touched[i + 1][0] - before if i + 1 < len(touched) else len(level)
        over = _rung_out(level, begun, quiet, min(next_touch, begun + round(TAP_S * rate)))
        states[begun : max(over, end) if brief else over] = InteractionState.TAP


def _mark_bursts(states: NDArray[np.int8], heard: Mask, level: Array, rate: float) -> None:
    """Marks the taps in `states` where no force tells: bursts that are brief and loudest at their start."""
    for start, end in runs(heard):
        burst = level[start:end]
        brief = start > 0 and end - start <= TAP_S * rate
        early = int(np.argmax(burst)) <= max(len(burst) // 3, round(LEVEL_S * rate))
        calm, end_level = level[max(0, start - round(0.05 * rate)) : start], np.median(burst[-(len(burst) // 4 + 1) :])
        if brief and early and (burst.max() >= IMPACT * end_level or end_level <= 2.0 * np.median(calm)):
            states[start:end] = InteractionState.TAP


def _without_ripple(heard: Mask, level: Array, rate: float) -> None:
    """Takes out of `heard` what the high-pass puts before an impact: half a period of its cut-off."""
    for start, end in runs(heard):
        peak = start + int(np.argmax(level[start:end]))
        if start > 0 and peak - start <= 0.5 / ACCELERATION_BAND_HZ[0] * rate + LEVEL_S * rate:
            heard[start : max(start, peak - round(LEVEL_S * rate))] = False


def onset(acceleration: Array, quiet: float, rate: float) -> int:
    """The sample at which an impact begins: the first that is loud before its peak, without a gap."""
    size = np.abs(acceleration)
    peak = int(size.argmax())
    loud = np.flatnonzero(size[: peak + 1] >= min(max(3.5 * quiet, ONSET_SHARE * size[peak]), size[peak]))
    gaps = np.flatnonzero(np.diff(loud) > ONSET_GAP_S * rate)
    return int(loud[gaps[-1] + 1 if len(gaps) else 0])


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
    taps_alone = loud < LEVEL_RATIO * quiet and usual < 2.0 * quiet
    if taps_alone:
        loud = float(level.max())  # all is quiet but for a few taps
        quiet = usual
    if loud < LEVEL_RATIO * quiet or loud <= 0.0:
        return False, np.ones(len(level), dtype=np.bool_)
    quiet = max(quiet, 1e-4 * loud)
    on = RISE * quiet if taps_alone else np.sqrt(quiet * loud)
    heard = _switched(level, on, OFF * on)
    return True, ~_without_brief(~heard, round(REST_S * rate))


def _level(acceleration: Array, rate: float) -> Array:
    """Root of the mean square (n,) over `LEVEL_S`."""
    length = max(1, round(LEVEL_S * rate))
    power = np.empty_like(acceleration)
    for block in blocks(len(power), BLOCK):
        first = max(0, block.start - length)
        near = scipy.ndimage.uniform_filter1d(acceleration[first : block.stop + length] ** 2, length, mode="nearest")
        power[block] = near[block.start - first :][:BLOCK]
    return np.asarray(np.sqrt(np.maximum(power, 0.0, out=power), out=power))


def _threshold(stream: Array, rate: float) -> float:
    """Where a low-passed stream is on."""
    return max(
        ABOVE_NOISE * noise(stream, rate),
        SHARE_ON * float(np.quantile(np.abs(stream), 0.95, overwrite_input=True)),
        1e-12,
    )


def _speed_threshold(speed: Array, rest: float, rate: float) -> float:
    """How far above rest a speed is on; a tool that sticks and slips all the time is no noise."""
    on, usual = _threshold(speed, rate), float(np.quantile(speed, 0.95))
    return min(on, MOVING_SHARE * (usual - rest)) if usual > 3.0 * rest else on


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
