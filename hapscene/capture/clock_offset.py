"""How the clocks of two recordings of one event differ: offset and drift, and how certain they are.

What both felt need not be the same quantity: a force at 1 kHz and an acceleration at 10 kHz begin at the same moment as
the tool taps, and rise and fall together as it strokes.

- **Taps** are found where a signal suddenly has far more power than just before, and timed where its variance begins
  to be another one (Maeda 1985, as seismology picks the first arrival of a wave). Of all pairs of a tap here and a tap
  there, those that lie on one line over time are the same taps.
- **Envelopes**: how strongly each stream moves over time, in windows. The cross-correlations of the windows are summed
  along every line of offset and drift; where the sum is highest is the answer, and how far it stands above the highest
  one elsewhere says how certain it is. The windows drawn anew, again and again (bootstrap), give its interval.

Where neither is certain, nothing is guessed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError

Array = NDArray[np.float64]

OFFSET_MAX_S: Final = 3.0
"""Largest difference of two beginnings that is looked for [s]: that of two buttons pressed by one person."""

DRIFT_MAX: Final = 300e-6
"""Largest drift that is looked for [1]: two ordinary crystals, each off by 100 ppm, and warm."""

DRIFT_SD: Final = 100e-6
"""Drift of two clocks before anything is known of it, standard deviation [1]: of a short recording it says the rest."""

WITHIN_S: Final = 5e-3
"""Largest 95 % interval that is taken for an answer, to either side, at any time that the two share [s]."""

ADVICE: Final = "tap three times at the begin and three times at the end, on what both feel"


@dataclass(frozen=True)
class ClockedStreams:
    """The streams (n,) of a recording, evenly spaced by its own clock, which reads 0 at the first sample."""

    rate_Hz: float
    streams: Mapping[str, Array]

    @property
    def duration_s(self) -> float:
        return len(next(iter(self.streams.values()))) / self.rate_Hz


@dataclass(frozen=True)
class ClockOffset:
    """Where the second clock reads t, the first reads `offset_s` + (1 + `drift`) t."""

    offset_s: float
    drift: float
    interval_s: float
    """half of the 95 % interval of the first clock's reading, where it is largest while both record"""
    by: str
    """"taps"; "vibrations", whose envelopes were compared; "envelopes" of unlike quantities; the computer's "clock\""""
    count: int
    """how many taps or windows were used"""
    ratio: float
    """how far the answer stands above the next best one: matched taps over matched taps, or peak over peak"""

    def __str__(self) -> str:
        windows = f"in {self.count} windows"
        how = {"taps": f"{self.count} taps", "vibrations": f"vibrations {windows}", "envelopes": f"envelopes {windows}"}
        return (
            f"offset {1e3 * self.offset_s:+.2f} ms, drift {1e6 * self.drift:+.1f} ppm, within "
            f"{1e3 * self.interval_s:.2g} ms (95 %), by {how.get(self.by, 'the clock of the computer')}"
        )


def clock_offset(
    first: ClockedStreams, second: ClockedStreams, *, near_s: float = 0.0, within_s: float = WITHIN_S
) -> ClockOffset:
    """How the second recording's clock stands against the first one's.

    Args:
        first: a recording.
        second: another one of the same event; of the same or of other quantities, at any rate.
        near_s: where the offset is looked for: up to `OFFSET_MAX_S` from there [s].
        within_s: the interval that is good enough [s].

    Raises:
        CaptureError: it is not certain, or not known as well as that; too short.
    """
    shared_s = min(first.duration_s, second.duration_s)
    slow_Hz = min(first.rate_Hz, second.rate_Hz)
    if slow_Hz < RATE_MIN_HZ:
        raise CaptureError(f"{slow_Hz:g} Hz are too slow to compare clocks: at least {RATE_MIN_HZ:g} Hz are needed")
    if shared_s < SHARED_MIN_S:
        raise CaptureError(f"{shared_s:.2g} s are too short to compare clocks: at least {SHARED_MIN_S:g} s are needed")
    found: ClockOffset | None = None
    for way in (_by_taps, _by_vibrations, _by_envelopes):
        if found is None or found.interval_s > within_s:
            other = way(first, second, near_s)
            if found is None or (other is not None and other.interval_s < found.interval_s):
                found = other
    if found is None:
        raise CaptureError(
            f"the two recordings share nothing that tells their clocks' offset for sure (looked for within "
            f"{OFFSET_MAX_S:g} s of {near_s:+.3g} s): {ADVICE}"
        )
    if found.interval_s > within_s:
        raise CaptureError(f"only known to {1e3 * found.interval_s:.2g} ms ({found}): {ADVICE}")
    return found


RATE_MIN_HZ: Final = 100.0
"""Slowest streams whose clocks are compared [Hz]: half of a sample is what an answer may be off."""

SHARED_MIN_S: Final = 1.0
"""Shortest recordings whose clocks are compared [s]."""


def vibrates(name: str) -> bool:
    """Whether a stream of this name swings about nothing: an acceleration, a channel of sound."""
    return name.lower().startswith("acc") or name.isdigit()


# By taps.

RISE: Final = 30.0
"""How many times more power a tap has than what was before it [1]."""

FAINT: Final = 1e-3
"""Power that counts as nothing, against the mean one [1]."""

HIGH_HZ, LOW_HZ = 20.0, 200.0
"""What of a vibration, and what of a force and the like, is looked at: above, and below, of this [Hz]."""

BEFORE_S, AFTER_S, APART_S = 0.1, 0.01, 0.1
"""What is compared before and after a moment; least time between two taps [s]."""

BRIEF: Final = 0.3
"""What is left of a tap two tenths of a second after it began, at most, against its first tenth [1]."""

ONSET_MAX: Final = 300
"""Most taps of a recording that are compared, the clearest [count]."""

MATCH_S: Final = 5e-3
"""Width of the band along a line in which taps are the same [s]: how exactly the worse stream times one."""

MATCH_MIN: Final = 3
MATCH_RATIO: Final = 1.5
CHANCE_MAX: Final = 1e-4
"""Least matched taps, how many times those of the next best line, and how likely as many may be by chance."""


def onsets(x: Array, rate_Hz: float, vibrates: bool = True) -> Array:
    """When taps begin in a stream (n,), of vibrations or of a force and the like: times (k,) in order [s]."""
    from scipy.signal import butter, find_peaks, sosfilt, sosfiltfilt

    before, after = round(BEFORE_S * rate_Hz), max(4, round(AFTER_S * rate_Hz))
    if len(x) < 4 * (before + after):
        return np.empty(0)
    if vibrates:
        moved = sosfilt(
            butter(2, min(HIGH_HZ, 0.2 * rate_Hz), "highpass", fs=rate_Hz, output="sos"), x - x[:after].mean()
        )
    else:
        x = sosfiltfilt(butter(2, min(LOW_HZ, 0.4 * rate_Hz), fs=rate_Hz, output="sos"), x)
        moved = sosfilt(butter(1, 0.5 * HIGH_HZ, "highpass", fs=rate_Hz, output="sos"), x - x[:after].mean())
    power = np.concatenate([[0.0], np.cumsum(moved**2)])
    at = np.arange(before, len(x) - after)
    quiet = (power[at] - power[at - before]) / before
    loud = (power[at + after] - power[at]) / after
    rise = loud / (quiet + FAINT * loud.mean() + 1e-300)
    peaks, _ = find_peaks(np.log(rise + 1e-300), height=np.log(RISE), distance=max(1, round(APART_S * rate_Hz)))
    clearest = np.sort(peaks[np.argsort(rise[peaks])[-ONSET_MAX:]]) + before
    timed, first = (moved, _first_arrival) if vibrates else (x, _first_rise)
    return np.array(
        [
            (peak - before // 4 + first(timed[peak - before // 4 : peak + after])) / rate_Hz
            for peak in clearest
            if _is_brief(timed[peak - before // 4 :], before)
        ]
    )


def _is_brief(rest: Array, before: int) -> bool:
    """Whether what begins here is soon over, as a tap is. A stroke is not, and begins less suddenly than it seems.

    Args:
        rest: (n,) the signal from shortly before it begins on.
        before: `BEFORE_S` in samples.
    """
    after = rest[2 * before : 3 * before]
    away = np.abs(rest[: 3 * before] - np.median(rest[: before // 4]))
    level = float(np.sqrt((away[:before] ** 2).mean()))
    return len(after) == before and float(np.sqrt((away[2 * before :] ** 2).mean())) < BRIEF * level


def _first_arrival(part: Array) -> float:
    """The sample before which a part of a signal has one variance, and from which on it has another."""
    n = np.arange(1, len(part))
    below, above = np.cumsum(part**2)[:-1], np.cumsum(part[::-1] ** 2)[::-1][1:]
    tiny = 1e-12 * float((part**2).max()) + 1e-300
    criterion = n * np.log(below / n + tiny) + (len(part) - n) * np.log(above / (len(part) - n) + tiny)
    return 1.0 + float(np.argmin(criterion[2:-2]) + 2)


def _first_rise(part: Array) -> float:
    """The sample, with its fraction, from which on a part of a signal rises as a straight line, level before."""
    away = np.abs(part - np.median(part[: len(part) // 2]))
    high = int(np.argmax(away >= 0.6 * away.max())) + 1
    away, n = part[:high], np.arange(high)
    bends = np.arange(2.0, max(3.0, high - 2.0), 0.1)
    ramps = np.maximum(n - bends[:, None], 0.0)
    ramps -= ramps.mean(axis=1, keepdims=True)
    explained = (ramps @ (away - away.mean())) ** 2 / ((ramps**2).sum(axis=1) + 1e-300)
    return float(bends[explained.argmax()])


def _by_taps(first: ClockedStreams, second: ClockedStreams, near_s: float) -> ClockOffset | None:
    best: ClockOffset | None = None
    theirs = [onsets(stream, second.rate_Hz, vibrates(name)) for name, stream in second.streams.items()]
    for name, stream in first.streams.items():
        ours = onsets(stream, first.rate_Hz, vibrates(name))
        for other in theirs:
            found = _matched(ours, other, near_s, first.duration_s, second.duration_s)
            if found is not None and (best is None or found.interval_s < best.interval_s):
                best = found
    return best


def _matched(ours: Array, theirs: Array, near_s: float, first_s: float, second_s: float) -> ClockOffset | None:
    """The line on which most pairs of taps lie; None where so many may do so by chance."""
    from scipy.stats import poisson

    apart = ours[:, None] - theirs[None]
    i, j = np.nonzero(np.abs(apart - near_s) <= OFFSET_MAX_S)
    t_s, d_s = theirs[j], apart[i, j]
    if len(t_s) < MATCH_MIN:
        return None
    count, on = _fullest(t_s, d_s)
    chance = poisson.sf(count - 2, len(t_s) * MATCH_S / (2.0 * OFFSET_MAX_S))
    chance *= len(t_s) * (1.0 + DRIFT_MAX * np.ptp(t_s) / MATCH_S)
    beside = np.abs(d_s - np.polyval(np.polyfit(t_s[on], d_s[on], 1 if count > 2 else 0), t_s)) > 4.0 * MATCH_S
    next_best = _fullest(t_s[beside], d_s[beside])[0] if beside.any() else 1
    if count < MATCH_MIN or chance > CHANCE_MAX or count < MATCH_RATIO * next_best:
        return None
    t_s, d_s = t_s[on], d_s[on]
    shared = _shared(float(np.median(d_s)), first_s, second_s)
    offset_s, drift, half_s = _line(t_s, d_s, shared)
    for _ in range(3):  # what a slide's begin has among the taps is off by more than they are
        away = np.abs(d_s - offset_s - drift * t_s)
        kept = away <= np.sort(away)[len(away) // 2] * 3.0 + SPREAD_MIN_S
        offset_s, drift, half_s = _line(t_s[kept], d_s[kept], shared)
    return ClockOffset(offset_s, drift, half_s, "taps", count, count / next_best)


def _fullest(t_s: Array, d_s: Array) -> tuple[int, NDArray[np.bool_]]:
    """How many pairs lie in a band of `MATCH_S` along the fullest line, and which."""
    middle_s, span_s = float(np.median(t_s)), float(np.ptp(t_s))
    best, on = 0, np.zeros(len(t_s), bool)
    for drift in np.linspace(-DRIFT_MAX, DRIFT_MAX, 1 + 2 * int(np.ceil(2.0 * DRIFT_MAX * span_s / MATCH_S))):
        level = d_s - drift * (t_s - middle_s)
        order = np.sort(level)
        counts = np.searchsorted(order, order + MATCH_S, "right") - np.arange(len(order))
        if counts.max() > best:
            low = order[counts.argmax()]
            best, on = int(counts.max()), (level >= low) & (level <= low + MATCH_S)
    return best, on


def _line(t_s: Array, d_s: Array, ends_s: tuple[float, float]) -> tuple[float, float, float]:
    """Offset, drift, and half of the 95 % interval at the worse of two times; drifts beforehand as `DRIFT_SD`."""
    middle_s, free = float(t_s.mean()), max(1, len(t_s) - 2)
    x, away = t_s - middle_s, d_s - d_s.mean()
    drift, variance = 0.0, SPREAD_MIN_S**2
    for _ in range(3):  # how far the taps are off the line says how much is to be made of what is known of drifts
        drift = float(x @ away) / (float(x @ x) + variance / DRIFT_SD**2)
        variance = max(float(np.sum((away - drift * x) ** 2)) / free, SPREAD_MIN_S**2)
    far_s = max(abs(end_s - middle_s) for end_s in ends_s)
    of_drift = 1.0 / (float(x @ x) / variance + DRIFT_SD**-2)
    spread_s = np.sqrt(variance / len(t_s) + far_s**2 * of_drift + SYSTEMATIC_S["taps"] ** 2)
    return float(d_s.mean() - drift * middle_s), drift, float(_student(free) * spread_s)


def _student(free: int) -> float:
    from scipy.stats import t

    return float(t.ppf(0.975, free))


SYSTEMATIC_S: Final = {"taps": 0.2e-3, "vibrations": 0.3e-3, "envelopes": 1e-3}
"""By how much two streams begin, or rise and fall, apart, standard deviation [s]: of made recordings. No recording by
itself can know it, nor what a sensor's filter delays: that is part of the offset."""

SPREAD_MIN_S: Final = 0.2e-3
"""Least spread of the times of a tap that is believed [s]."""


def _shared(offset_s: float, first_s: float, second_s: float) -> tuple[float, float]:
    """From when to when, by the second's clock, both record."""
    return max(0.0, -offset_s), min(second_s, first_s - offset_s)


# By envelopes.

FEATURE_HZ: Final = 500.0
"""Rate of the envelopes [Hz]."""

SMOOTH_S: Final = 0.01
"""Time over which an envelope is smoothed, standard deviation [s]."""

FLOOR: Final = 0.1
"""What counts as nothing, against the root mean square [1]."""

WINDOW_S: Final = 2.0
WINDOW_COUNT: Final = (10, 64)
"""Length of the windows that is aimed at [s], and fewest and most of them."""

BESIDE_S: Final = 0.15
"""How far from its peak another one is elsewhere [s]."""

RATIO_MIN: Final = 2.5
"""How far the answer must stand above the next best one [1]. Of 1650 pairs of noise, 1.5 to 12 s long, that had nothing
in common one stood above 2.3 times; strokes that were told had 3.5 to 16."""

DRAW_COUNT: Final = 300
"""How often the windows are drawn anew [count]."""


def activity(x: Array, rate_Hz: float, vibrates: bool) -> Array:
    """How fast the level of a stream rises and falls over time, at `FEATURE_HZ`, of variance 1 and bounded."""
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import butter, sosfiltfilt

    if vibrates:
        x = sosfiltfilt(butter(2, min(HIGH_HZ, 0.2 * rate_Hz), "highpass", fs=rate_Hz, output="sos"), x) ** 2
    count = int(len(x) / rate_Hz * FEATURE_HZ)
    total = np.concatenate([[0.0], np.cumsum(x)])
    edges = np.interp(np.arange(count + 1) / FEATURE_HZ * rate_Hz, np.arange(len(total)), total)
    level = np.diff(edges) * FEATURE_HZ / rate_Hz
    level = gaussian_filter1d(level, SMOOTH_S * FEATURE_HZ)
    level = np.sqrt(np.maximum(level, 0.0)) if vibrates else np.abs(level)
    level = np.log(level + FLOOR * np.sqrt((level**2).mean()) + 1e-300)
    slope = gaussian_filter1d(level, SMOOTH_S * FEATURE_HZ, order=1)
    spread = slope.std()
    slope = slope / spread if spread > 0.0 else slope
    return np.asarray(np.clip(slope, -4.0, 4.0))


def _by_vibrations(first: ClockedStreams, second: ClockedStreams, near_s: float) -> ClockOffset | None:
    """By what vibrates alone, where both have that: no sensor's filter stands between."""
    both = []
    for each in (first, second):
        streams = {name: stream for name, stream in each.streams.items() if vibrates(name)}
        if not streams:
            return None
        both.append(replace(each, streams=streams))
    return _by_envelopes(both[0], both[1], near_s, "vibrations")


def _activities(recording: ClockedStreams) -> list[Array]:
    """Of every stream how its vibrations rise and fall, and of one that does not vibrate how it does itself."""
    kinds = [(stream, kind) for name, stream in recording.streams.items() for kind in {True, vibrates(name)}]
    return [activity(stream, recording.rate_Hz, kind) for stream, kind in kinds]


def _by_envelopes(
    first: ClockedStreams, second: ClockedStreams, near_s: float, by: str = "envelopes"
) -> ClockOffset | None:
    """The line along which the windows' cross-correlations sum up to most; None where another does about as well."""
    start_s, stop_s = _shared(near_s, first.duration_s, second.duration_s)
    if stop_s - start_s < SHARED_MIN_S:
        return None
    count = int(np.clip((stop_s - start_s) / WINDOW_S, *WINDOW_COUNT))
    edges = np.linspace(start_s * FEATURE_HZ, stop_s * FEATURE_HZ, count + 1).astype(int)
    middles_s = 0.5 * (edges[1:] + edges[:-1]) / FEATURE_HZ
    x_s = middles_s - middles_s.mean()
    half = int(np.ceil(DRIFT_MAX * x_s[-1] * FEATURE_HZ)) + 1
    drifts = DRIFT_MAX * np.arange(-half, half + 1) / half
    shifts = np.rint(drifts[:, None] * x_s * FEATURE_HZ).astype(int)
    extra, most = int(np.abs(shifts).max()) + round(REFINED_S * FEATURE_HZ) + 2, round(OFFSET_MAX_S * FEATURE_HZ)
    scores, windows = [], []
    theirs = _activities(second)
    for ours in _activities(first):
        for other in theirs:
            lagged = _correlations(ours, other, edges, round(near_s * FEATURE_HZ), most + extra)
            score = np.stack([_along(lagged, row, extra) for row in shifts])
            noise = 1.4826 * float(np.median(np.abs(score))) + 1e-300
            scores.append(np.maximum(score / noise, 0.0))
            windows.append(lagged / noise)
    total = np.sqrt(np.sum([score**2 for score in scores], axis=0))
    best, lag = np.unravel_index(int(total.argmax()), total.shape)
    beside = np.abs(np.arange(total.shape[1]) - lag) > BESIDE_S * FEATURE_HZ
    ratio = float(total[best, lag] / (total[:, beside].max() + 1e-300))
    if not total[best, lag] > 0.0 or ratio < RATIO_MIN:
        return None
    joint = np.sum([score[best, lag] * each for score, each in zip(scores, windows, strict=True)], axis=0)
    around_s = near_s + (int(lag) - most) / FEATURE_HZ
    found, covariance = _drawn(joint, x_s, int(lag) + extra)
    ends = np.array([[1.0, time_s - middles_s.mean()] for time_s in (start_s, stop_s)])
    spread_s = np.sqrt(float(np.diag(ends @ covariance @ ends.T).max()) + SYSTEMATIC_S[by] ** 2)
    half_s = float(_student(count - 2) * spread_s)
    offset_s = around_s + found[0] - found[1] * middles_s.mean()
    return ClockOffset(float(offset_s), float(found[1]), half_s, by, count, ratio)


def _correlations(ours: Array, other: Array, edges: NDArray[np.int64], near: int, most: int) -> Array:
    """(windows, 2 most + 1): the other's windows against ours, at lags of `near` ± `most`."""
    from scipy.signal import correlate

    made = []
    for start, stop in pairwise(edges):
        low, high = start + near - most, stop + near + most
        part = np.zeros(high - low)
        inside = slice(max(0, low), max(0, min(len(ours), high)))
        part[inside.start - low : inside.stop - low] = ours[inside]
        window = np.zeros(stop - start)
        window[: max(0, len(other) - start)] = other[start:stop]
        made.append(correlate(part, window, "valid", "fft"))
    return np.array(made)


def _along(lagged: Array, shifts: NDArray[np.int64], extra: int) -> Array:
    """The sum of windows (w, lags + 2 extra), each shifted by so much."""
    total = np.zeros(lagged.shape[1] - 2 * extra)
    for row, shift in zip(lagged, shifts, strict=True):
        total += row[extra + shift : extra + shift + len(total)]
    return total


def _drawn(joint: Array, x_s: Array, lag: int) -> tuple[Array, Array]:
    """Offset from `lag` in the middle and drift, (2,), and their covariance (2, 2), by windows that are drawn anew.

    Args:
        joint: (w, lags) correlation of each window.
        x_s: (w,) time of each window, from their middle.
        lag: the one near which the answer is.
    """
    from scipy.interpolate import make_interp_spline

    fine_s, drifts = np.arange(-REFINED_S, REFINED_S, GRID_S), np.linspace(-DRIFT_MAX, DRIFT_MAX, 61)
    lags = lag + FEATURE_HZ * (fine_s + drifts[:, None] * x_s[:, None, None])
    near = np.arange(max(0, int(lags.min()) - 4), min(joint.shape[1], int(lags.max()) + 6))
    at = lags.clip(near[0], near[-1])
    table = np.stack([make_interp_spline(near, row[near], 3)(part) for row, part in zip(joint, at, strict=True)])
    counts = np.random.default_rng(0).multinomial(len(x_s), np.full(len(x_s), 1.0 / len(x_s)), DRAW_COUNT)
    sums = np.vstack([np.ones(len(x_s)), counts]) @ table.reshape(len(x_s), -1)
    drift_at, offset_at = np.unravel_index(sums.argmax(axis=1), lags.shape[1:])
    found, *drawn = np.stack([fine_s[offset_at], drifts[drift_at]], axis=1)
    grid = np.array([GRID_S, drifts[1] - drifts[0]])
    known = np.linalg.inv(np.cov(np.transpose(drawn)) + np.diag(grid**2 / 12.0))
    covariance = np.linalg.inv(known + np.diag([0.0, DRIFT_SD**-2]))
    return np.asarray(covariance @ known @ found), np.asarray(covariance)


REFINED_S: Final = 0.03
"""How far from the highest sum the answer may be in windows that are drawn anew [s]."""

GRID_S: Final = 0.5e-3
"""Grid on which it is looked for there [s]."""
