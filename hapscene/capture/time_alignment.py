"""Time alignment: merges recordings of one event by different devices onto a common clock.

The clocks differ by an offset and a linear drift. Both are estimated by cross-correlation of the channels with equal
names in two recordings, or else of all their streams: for example, force and acceleration both change at a tap. The
correlated signals are the rates of change of the levels. The correlations of short windows are summed along each line
of offset and drift, and the largest sum determines both. The ratio of the largest sum to the largest one elsewhere is
the confidence; below `RATIO_MIN` the recordings are not merged.

On simulated strokes, a common acceleration is aligned to about 1 ms, a force with an acceleration to 2 to 8 ms.

`load_recording` reads the merged file. Streams keep their names, values and units; if several files have a stream of
the same name, the number of the file is appended: "_2", "_3", …."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from hapscene.io.probe_protocol import UNITS

__all__ = ["join"]

OFFSET_MAX_S: Final = 10.0
"""Largest offset between the starts of two recordings [s], for two programs started by one person."""

DRIFT_MAX: Final = 300e-6
"""Largest drift [1]: two ordinary crystals with errors of 100 ppm each, plus temperature."""

RATIO_MIN: Final = 2.5
"""Smallest ratio of the correlation peak to the second-largest peak [1]. Unrelated recordings have up to 1.5,
noise of 1.5 s up to 2.3, strokes 3.5 to 16."""

RATE_MIN_HZ: Final = 100.0
"""Lowest sample rate that can be aligned [Hz]; the error may be half a sample."""

SHARED_MIN_S: Final = 1.0
"""Shortest recordings, and shortest overlap, that can be aligned [s]."""

FEATURE_HZ: Final = 500.0
"""Sample rate of the correlated signals [Hz]."""

SMOOTH_S: Final = 0.01
"""Standard deviation of the smoothing of a level [s]."""

FLOOR: Final = 0.1
"""Lower limit of a level, relative to its root mean square [1]."""

VIBRATION_HZ: Final = 20.0
"""Cut-off of the high-pass on oscillating streams [Hz]."""

WINDOW_S: Final = 2.0
WINDOW_COUNT: Final = (10, 64)
"""Target length of the correlation windows [s], and limits of their number."""

BESIDE_S: Final = 0.15
"""Smallest distance from the largest correlation at which another one counts as elsewhere [s]."""

_FINE: Final = 32  # samples about the largest sum in which it is refined


@dataclass(frozen=True)
class ClockOffset:
    """Relation of two clocks: when the second reads t, the first reads `offset_s` + (1 + `drift`) t."""

    offset_s: float
    drift: float
    ratio: float
    """confidence: ratio of the largest correlation to the largest one elsewhere"""
    common: bool
    """whether channels of equal names were compared"""

    def __str__(self) -> str:
        channel = "a common channel" if self.common else "different channels"
        clock = f"offset {1e3 * self.offset_s:+.2f} ms, drift {1e6 * self.drift:+.0f} ppm"
        return f"{clock}, from {channel}, peak ratio {self.ratio:.1f}"


def clock_offset(first: Record, second: Record) -> ClockOffset:
    """Estimates offset and drift of the clock of the second recording against that of the first.

    Raises:
        CaptureError: a recording is too short, its sample rate too low, or the correlation has no clear peak.
    """
    for name, found, least in (
        ("a sample rate", min(first.rate_Hz, second.rate_Hz), RATE_MIN_HZ),
        ("a duration in seconds", min(first.duration_s, second.duration_s), SHARED_MIN_S),
    ):
        if found < least:
            raise CaptureError(f"time alignment needs {name} of at least {least:g}; found {found:.3g}")
    common = [name for name in first.streams if name in second.streams]
    ours, theirs = (_summed(each, common or list(each.streams)) for each in (first, second))
    count = int(np.clip(len(theirs) / FEATURE_HZ / WINDOW_S, *WINDOW_COUNT))
    edges = np.linspace(0, len(theirs), count + 1).astype(int)
    middles = 0.5 * (edges[1:] + edges[:-1])
    centred = middles - middles.mean()
    half = int(np.ceil(DRIFT_MAX * centred[-1])) + 1
    drifts = DRIFT_MAX * np.arange(-half, half + 1) / half
    most, extra = round(OFFSET_MAX_S * FEATURE_HZ), half + _FINE
    windows = _correlations(ours, theirs, edges, most + extra)
    sums = np.array([_summed_along(windows, np.rint(drift * centred).astype(int), extra) for drift in drifts])
    best, lag = np.unravel_index(int(sums.argmax()), sums.shape)
    elsewhere = np.abs(np.arange(sums.shape[1]) - lag) > BESIDE_S * FEATURE_HZ
    ratio = float(sums[best, lag] / (sums[:, elsewhere].max() + 1e-300))
    if not sums[best, lag] > 0.0 or ratio < RATIO_MIN:
        raise CaptureError(
            f"the recordings cannot be aligned: their correlation has no clear peak within {OFFSET_MAX_S:g} s (peak "
            f"ratio {max(ratio, 0.0):.2g}, expected {RATIO_MIN:g}): record three taps at the start and at the end"
        )
    shift, drift = _refined(windows[:, lag : lag + 2 * extra + 1], centred, drifts[best])
    offset_s = (lag - most + shift - drift * middles.mean()) / FEATURE_HZ
    return ClockOffset(float(offset_s), drift, ratio, bool(common))


def _summed(recording: Record, names: Sequence[str]) -> Array:
    """Sum of the level changes of some streams."""
    changes = []
    for name in names:
        stream = recording.streams[name].copy()
        fill_missing(stream)
        changes.append(level_changes(stream, recording.rate_Hz, _oscillates(name)))
    return np.asarray(np.sum(changes, axis=0))


def _oscillates(name: str) -> bool:
    """Whether a stream oscillates about 0, judged by its name: an acceleration or an audio channel."""
    return name.lower().startswith("acc") or name.isdigit()


def level_changes(x: Array, rate_Hz: float, oscillates: bool) -> Array:
    """Rate of change of the logarithm of the level of a stream at `FEATURE_HZ`, with variance 1 and limited."""
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
    """Correlations (windows, 2 most + 1) of windows of the second recording with the first, for lags up to ±`most`."""
    padded = np.pad(ours, (most, max(0, len(theirs) - len(ours)) + most))
    return np.array(
        [
            scipy.signal.correlate(padded[start : stop + 2 * most], theirs[start:stop], "valid", "fft")
            for start, stop in pairwise(edges)
        ]
    )


def _summed_along(windows: Array, shifts: Array, extra: int) -> Array:
    """Sum of windows (w, lags + 2 extra), each shifted by a number of lags."""
    count = windows.shape[1] - 2 * extra
    rows = zip(windows, shifts.tolist(), strict=True)
    return np.asarray(sum(row[extra + shift : extra + shift + count] for row, shift in rows))


def _refined(windows: Array, centred: Array, drift: float) -> tuple[float, float]:
    """Refines shift and drift of the largest sum of windows (w, lags) by spline interpolation."""
    half = windows.shape[1] // 2
    splines = [scipy.interpolate.make_interp_spline(np.arange(-half, half + 1.0), row, 3) for row in windows]

    def negative_sum(p: Array) -> float:
        at = np.clip(p[0] + p[1] * DRIFT_MAX * centred, -half, half)
        return -sum(float(spline(lag)) for spline, lag in zip(splines, at, strict=True))

    shift, share = scipy.optimize.fmin(negative_sum, [0.0, drift / DRIFT_MAX], xtol=1e-3, ftol=1e-6, disp=False)
    return float(shift), float(share * DRIFT_MAX)


# Merging files.


@dataclass(frozen=True)
class JoinResult:
    """Result of merging files."""

    path: Path
    leader: Path
    """the file whose clock is used: the one with the highest sample rate"""
    rate_Hz: float
    duration_s: float
    offsets: Mapping[Path, ClockOffset]
    """relation of the clocks of the other files"""
    names: tuple[str, ...]


def join(
    paths: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], *, rate_Hz: float | None = None
) -> JoinResult:
    """Merges recordings of one event by devices with different clocks into one file.

    Args:
        paths: two or more recordings in the formats of `load_recording`; an acceleration is not required.
        out: .npz file to write.
        rate_Hz: sample rate of the files that do not state theirs.

    Raises:
        CaptureError: the recordings cannot be read or aligned, or do not overlap.
    """
    target, given = Path(out), [Path(path) for path in paths]
    if target.suffix != ".npz":
        raise CaptureError(f"{target}: invalid suffix; merged recordings are written as .npz")
    if len({path.absolute() for path in given}) < max(2, len(given)):
        raise CaptureError("expected two or more different files")
    recordings = {}
    for path in given:
        source = read_recording_source(path)
        stated = source.rate_Hz is not None or "time" in source.columns
        with refusing(CaptureError, path):
            recordings[path] = _sampled(source, None if stated else rate_Hz, path.suffix.lower() == ".wav")
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
        raise CaptureError(
            f"the files overlap by {max(0.0, stop_s - start_s):.2g} s; expected at least {SHARED_MIN_S:g} s"
        )
    samples = np.arange(int(np.ceil(start_s * first.rate_Hz)), int(np.floor(stop_s * first.rate_Hz)))
    stream_count = sum(len(each.streams) for each in (first, *recordings.values()))
    check_memory(16 * len(samples) * stream_count, 0, f"merging {len(samples):,} samples", TOO_MUCH)
    streams, units = {name: stream[samples] for name, stream in first.streams.items()}, dict(first.units)
    for number, (path, second) in enumerate(recordings.items(), 2):
        known = offsets[path]
        at = (samples / first.rate_Hz - known.offset_s) / (1.0 + known.drift) * second.rate_Hz
        for name, stream in second.streams.items():
            free, suffix = name, number
            while free in streams or (free != name and free in second.streams):
                free, suffix = f"{name}_{suffix}", suffix + 1
            streams[free] = resampled(stream, at)
            if name in second.units:
                units[free] = second.units[name]
    notes = "; ".join(f"{path.name}: {known}" for path, known in offsets.items())
    provenance = f"merged on the clock of {leader.name} from {start_s:.6f} s on; {notes}"
    save_npz(Record(first.rate_Hz, streams, units), target, provenance)
    return JoinResult(target, leader, first.rate_Hz, len(samples) / first.rate_Hz, offsets, tuple(streams))


def resampled(stream: Array, at: Array) -> Array:
    """Interpolates a stream (n,) at fractional sample indices (k,); NaN next to missing samples.

    Splines of degree 5 have a relative error of 6e-6 at a tenth of the sample rate and 6e-4 at a fifth.
    """
    missing, filled = np.isnan(stream), stream.copy()
    fill_missing(filled)
    made = scipy.ndimage.map_coordinates(filled, [at], order=5, mode="nearest")
    beside = np.floor(at).astype(np.int64).clip(0, len(stream) - 2)
    made[missing[beside] | missing[beside + 1]] = np.nan
    return np.asarray(made)


def _sampled(source: RecordingSource, rate_Hz: float | None, wave: bool) -> Record:
    check_memory(16 * sum(len(column) for column in source.columns.values()), source.own_B, "the recording", TOO_MUCH)
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
            raise CaptureError(f"column {name!r}: expected at least two numbers")
    if not streams:
        raise CaptureError("the file contains no column except times")
    return Record(own_Hz, streams, {names[name]: unit for name, unit in source.units.items()})
