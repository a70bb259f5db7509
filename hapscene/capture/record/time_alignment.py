"""Time alignment: recordings of one event, made by different devices, joined on one clock.

The clocks differ by an offset and a linear drift. Both are found by cross-correlation of the channel that two
recordings have in common, by name; where there is none, of all their streams: a force and an acceleration rise and fall
together when the tool taps or strokes. Compared are not the streams but how fast their level changes, in windows. The
correlations of the windows are summed along every line of offset and drift; the highest sum is the answer. Its ratio to
the highest sum elsewhere is the confidence: below `RATIO_MIN`, nothing is joined.

On simulated strokes, a common acceleration is aligned to about 1 ms, a force with an acceleration to 2 to 8 ms.

A joined file is read by `load_recording` as any other: streams keep their names, numbers and units.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from hapscene.capture.io.formats import AXES, RecordingSource, check_range, read_recording_source
from hapscene.capture.io.hsrec import Record, save_npz
from hapscene.capture.io.recording import rate_of
from hapscene.capture.io.streams import Array, fill_missing
from hapscene.errors import CaptureError
from hapscene.io.files import check_memory, refusing
from hapscene.io.number_files import TOO_MUCH
from hapscene.io.wire.unit import UNITS

__all__ = ["RATIO_MIN", "ClockOffset", "Clocked", "Joined", "clock_offset", "join", "level_changes", "resampled"]

OFFSET_MAX_S: Final = 10.0
"""Largest difference between the starts of two recordings [s]: two programs started by one person."""

DRIFT_MAX: Final = 300e-6
"""Largest drift [1]: two ordinary crystals, each off by 100 ppm, and warm."""

RATIO_MIN: Final = 2.5
"""Least ratio of the highest correlation to the next one elsewhere [1]. Unrelated recordings reach 1.5, noise of 1.5 s
2.3; strokes 3.5 to 16."""

RATE_MIN_HZ: Final = 100.0
"""Slowest streams that are aligned [Hz]: half of a sample is what an answer may be off."""

SHARED_MIN_S: Final = 1.0
"""Shortest recordings that are aligned, and shortest time that they must share [s]."""

FEATURE_HZ: Final = 500.0
"""Rate at which changes of level are compared [Hz]."""

SMOOTH_S: Final = 0.01
"""Time over which a level is smoothed, standard deviation [s]."""

FLOOR: Final = 0.1
"""Level that counts as silence, relative to the root mean square [1]."""

VIBRATION_HZ: Final = 20.0
"""High-pass of the streams that oscillate about 0 [Hz]."""

WINDOW_S: Final = 2.0
WINDOW_COUNT: Final = (10, 64)
"""Target length of the correlation windows [s], and fewest and most of them."""

BESIDE_S: Final = 0.15
"""Distance from the highest correlation at which another one is elsewhere [s]."""

_FINE: Final = 32  # features beside the highest sum in which it is refined


@dataclass(frozen=True)
class Clocked:
    """The streams (n,) of a recording, evenly spaced by its own clock, which reads 0 at the first sample."""

    rate_Hz: float
    streams: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        return len(next(iter(self.streams.values()))) / self.rate_Hz


@dataclass(frozen=True)
class ClockOffset:
    """Where the second clock reads t, the first reads `offset_s` + (1 + `drift`) t."""

    offset_s: float
    drift: float
    ratio: float
    """confidence: highest correlation over the next one elsewhere"""
    common: bool
    """whether a common channel was compared"""

    def __str__(self) -> str:
        channel = "a common channel" if self.common else "unlike channels"
        clock = f"offset {1e3 * self.offset_s:+.2f} ms, drift {1e6 * self.drift:+.0f} ppm"
        return f"{clock}, by {channel}, peak ratio {self.ratio:.1f}"


def clock_offset(first: Clocked, second: Clocked) -> ClockOffset:
    """Offset and drift of the second recording's clock against the first one's.

    Raises:
        CaptureError: too short, too slow, or the correlation has no clear peak.
    """
    for name, found, least in (
        ("a sample rate", min(first.rate_Hz, second.rate_Hz), RATE_MIN_HZ),
        ("a duration in seconds", min(first.duration_s, second.duration_s), SHARED_MIN_S),
    ):
        if found < least:
            raise CaptureError(f"time alignment needs {name} of at least {least:g}, found {found:.3g}")
    common = [name for name in first.streams if name in second.streams]
    ours, theirs = (_summed(each, common or list(each.streams)) for each in (first, second))
    count = int(np.clip(len(theirs) / FEATURE_HZ / WINDOW_S, *WINDOW_COUNT))
    edges = np.linspace(0, len(theirs), count + 1).astype(int)
    middles = 0.5 * (edges[1:] + edges[:-1])
    away = middles - middles.mean()
    half = int(np.ceil(DRIFT_MAX * away[-1])) + 1
    drifts = DRIFT_MAX * np.arange(-half, half + 1) / half
    most, extra = round(OFFSET_MAX_S * FEATURE_HZ), half + _FINE
    windows = _correlations(ours, theirs, edges, most + extra)
    sums = np.array([_summed_along(windows, np.rint(drift * away).astype(int), extra) for drift in drifts])
    best, lag = np.unravel_index(int(sums.argmax()), sums.shape)
    beside = np.abs(np.arange(sums.shape[1]) - lag) > BESIDE_S * FEATURE_HZ
    ratio = float(sums[best, lag] / (sums[:, beside].max() + 1e-300))
    if not sums[best, lag] > 0.0 or ratio < RATIO_MIN:
        raise CaptureError(
            f"the recordings cannot be aligned: their correlation has no clear peak within {OFFSET_MAX_S:g} s (peak "
            f"ratio {max(ratio, 0.0):.2g}, expected {RATIO_MIN:g}): tap three times at the beginning and at the end"
        )
    shift, drift = _refined(windows[:, lag : lag + 2 * extra + 1], away, drifts[best])
    offset_s = (lag - most + shift - drift * middles.mean()) / FEATURE_HZ
    return ClockOffset(float(offset_s), drift, ratio, bool(common))


def _summed(recording: Clocked, names: Sequence[str]) -> Array:
    """The level changes of some streams, summed."""
    changes = []
    for name in names:
        stream = recording.streams[name].copy()
        fill_missing(stream)
        changes.append(level_changes(stream, recording.rate_Hz, _oscillates(name)))
    return np.asarray(np.sum(changes, axis=0))


def _oscillates(name: str) -> bool:
    """Whether a stream of this name oscillates about 0: an acceleration, a channel of sound."""
    return name.lower().startswith("acc") or name.isdigit()


def level_changes(x: Array, rate_Hz: float, oscillates: bool) -> Array:
    """How fast the logarithm of a stream's level changes, at `FEATURE_HZ`, of variance 1 and bounded."""
    if oscillates:
        cutoff_Hz = min(VIBRATION_HZ, 0.2 * rate_Hz)
        x = scipy.signal.sosfiltfilt(scipy.signal.butter(2, cutoff_Hz, "highpass", fs=rate_Hz, output="sos"), x) ** 2
    total = np.concatenate([[0.0], np.cumsum(x)])
    times = np.arange(int(len(x) / rate_Hz * FEATURE_HZ) + 1) / FEATURE_HZ
    means = np.diff(np.interp(times * rate_Hz, np.arange(len(total)), total)) * FEATURE_HZ / rate_Hz
    level = scipy.ndimage.gaussian_filter1d(means, SMOOTH_S * FEATURE_HZ)
    level = np.sqrt(np.maximum(level, 0.0)) if oscillates else np.abs(level)
    level = np.log(level + FLOOR * np.sqrt((level**2).mean()) + 1e-300)
    slope = scipy.ndimage.gaussian_filter1d(level, SMOOTH_S * FEATURE_HZ, order=1)
    spread = slope.std()
    return np.asarray(np.clip(slope / spread if spread > 0.0 else slope, -4.0, 4.0))


def _correlations(ours: Array, theirs: Array, edges: Array, most: int) -> Array:
    """(windows, 2 most + 1): each window of the second recording against the first, at lags of −`most` to `most`."""
    padded = np.pad(ours, (most, max(0, len(theirs) - len(ours)) + most))
    return np.array(
        [
            scipy.signal.correlate(padded[start : stop + 2 * most], theirs[start:stop], "valid", "fft")
            for start, stop in pairwise(edges)
        ]
    )


def _summed_along(windows: Array, shifts: Array, extra: int) -> Array:
    """The sum of windows (w, lags + 2 extra), each shifted by so many lags."""
    count = windows.shape[1] - 2 * extra
    rows = zip(windows, shifts.tolist(), strict=True)
    return np.asarray(sum(row[extra + shift : extra + shift + count] for row, shift in rows))


def _refined(windows: Array, away: Array, drift: float) -> tuple[float, float]:
    """Shift and drift of the highest sum of windows (w, lags), by splines between the lags."""
    half = windows.shape[1] // 2
    splines = [scipy.interpolate.make_interp_spline(np.arange(-half, half + 1.0), row, 3) for row in windows]

    def negative_sum(p: Array) -> float:
        at = np.clip(p[0] + p[1] * DRIFT_MAX * away, -half, half)
        return -sum(float(spline(lag)) for spline, lag in zip(splines, at, strict=True))

    shift, share = scipy.optimize.fmin(negative_sum, [0.0, drift / DRIFT_MAX], xtol=1e-3, ftol=1e-6, disp=False)
    return float(shift), float(share * DRIFT_MAX)


# Joining files.


@dataclass(frozen=True)
class Joined:
    """Result of joining files."""

    path: Path
    leader: Path
    """the file whose clock the others were aligned to: the one with the highest sample rate"""
    rate_Hz: float
    start_s: float
    """where the joined recording begins, by that clock"""
    duration_s: float
    offsets: Mapping[Path, ClockOffset]
    """of the other files"""
    names: tuple[str, ...]


def join(
    paths: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], *, rates_Hz: Sequence[float] = ()
) -> Joined:
    """Joins recordings of one event, each with its own clock, into one file.

    Args:
        paths: two files or more, as `load_recording` reads them; none needs to hold an acceleration.
        out: the .npz file to write.
        rates_Hz: sample rates of the files that do not state theirs: one for all of them, or one each in their order.

    Raises:
        CaptureError: recordings that cannot be aligned or share no time; what `load_recording` raises.
    """
    target, given = Path(out), [Path(path) for path in paths]
    if target.suffix != ".npz":
        raise CaptureError(f"{target}: joined recordings are written as .npz")
    if len({path.absolute() for path in given}) < max(2, len(given)):
        raise CaptureError("join needs two files or more, each named once")
    recordings = _read(given, rates_Hz)
    leader = max(given, key=lambda path: recordings[path].rate_Hz)
    first = recordings.pop(leader)
    offsets = {}
    for path, second in recordings.items():
        with refusing(CaptureError, f"{leader.name} and {path.name}"):
            offsets[path] = clock_offset(first, second)
    starts_s = [known.offset_s for known in offsets.values()]
    stops_s = [known.offset_s + (1.0 + known.drift) * recordings[path].duration_s for path, known in offsets.items()]
    start_s, stop_s = max(0.0, *starts_s), min(first.duration_s, *stops_s)
    if stop_s - start_s < SHARED_MIN_S:
        raise CaptureError(f"the files share {max(0.0, stop_s - start_s):.2g} s, {SHARED_MIN_S:g} s or more are needed")
    samples = np.arange(int(np.ceil(start_s * first.rate_Hz)), int(np.floor(stop_s * first.rate_Hz)))
    stream_count = sum(len(each.streams) for each in (first, *recordings.values()))
    check_memory(16 * len(samples) * stream_count, 0, f"{len(samples):,} joined samples", TOO_MUCH)
    streams, units = {name: stream[samples] for name, stream in first.streams.items()}, dict(first.units)
    for number, (path, second) in enumerate(recordings.items(), 2):
        known = offsets[path]
        at = (samples / first.rate_Hz - known.offset_s) / (1.0 + known.drift) * second.rate_Hz
        for name, stream in second.streams.items():
            free = name if name not in streams else f"{name}_{number}"
            streams[free] = resampled(stream, at)
            if name in second.units:
                units[free] = second.units[name]
    notes = "; ".join(f"{path.name}: {known}" for path, known in offsets.items())
    provenance = f"joined to the clock of {leader.name} from {start_s:.6f} s on; {notes}"
    save_npz(Record(first.rate_Hz, streams, units), target, provenance)
    return Joined(target, leader, first.rate_Hz, start_s, len(samples) / first.rate_Hz, offsets, tuple(streams))


def resampled(stream: Array, at: Array) -> Array:
    """A stream (n,) at places between its samples (k,); NaN beside samples that are missing.

    By splines of the fifth degree: at a tenth of the rate they are off by 6e-6, at a fifth by 6e-4.
    """
    missing, filled = np.isnan(stream), stream.copy()
    fill_missing(filled)
    made = scipy.ndimage.map_coordinates(filled, [at], order=5, mode="nearest")
    beside = np.floor(at).astype(np.int64).clip(0, len(stream) - 2)
    made[missing[beside] | missing[beside + 1]] = np.nan
    return np.asarray(made)


def _read(paths: Sequence[Path], rates_Hz: Sequence[float]) -> dict[Path, Clocked]:
    """The files' streams by their names, with their rates."""
    sources = {path: read_recording_source(path) for path in paths}
    silent = [path for path, each in sources.items() if each.rate_Hz is None and "time" not in each.columns]
    if rates_Hz and len(rates_Hz) not in (1, len(silent)):
        raise CaptureError(f"{len(rates_Hz)} rates for {len(silent)} files that state none: give one, or one each")
    rates = dict(zip(silent, list(rates_Hz) * len(silent), strict=False))
    made = {}
    for path, source in sources.items():
        with refusing(CaptureError, path):
            made[path] = _clocked(source, rates.get(path), path.suffix.lower() == ".wav")
    return made


def _clocked(source: RecordingSource, rate_Hz: float | None, wave: bool) -> Clocked:
    check_memory(16 * sum(len(column) for column in source.columns.values()), source.own_B, "its streams", TOO_MUCH)
    names = {name: name for name in source.columns}
    if list(names) == ["1"]:
        names = {"1": "acceleration"}
    elif list(names) == ["1", "2", "3"] and wave:
        names = {name: f"acceleration_{axis}" for name, axis in zip(names, AXES, strict=True)}
    streams = {names[name]: source.scale * np.array(column, np.float64) for name, column in source.columns.items()}
    time_s = streams.pop("time", None)
    if time_s is not None:
        time_s = time_s * UNITS["time"].get(source.units.get("time", "s"), 1.0)
    own_Hz = rate_of(rate_Hz, source, time_s)
    for name, stream in streams.items():
        check_range(name, stream)
        if not np.isfinite(stream).sum() > 1:
            raise CaptureError(f"{name}: at least two numbers expected")
    if not streams:
        raise CaptureError("holds nothing but times")
    return Clocked(own_Hz, streams, {names[name]: unit for name, unit in source.units.items()})
