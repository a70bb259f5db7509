"""Several files of one event made one: their clocks compared, the slower streams resampled to the fastest clock.

A file that it writes is read by `load_recording` as any other: streams keep their names, numbers and units.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from hapscene.capture.clock_offset import DRIFT_MAX, WITHIN_S, ClockedStreams, ClockOffset, clock_offset
from hapscene.capture.record_file import SUFFIX, Record, load_record, save_npz
from hapscene.capture.recording_file import VECTORS, rate_of
from hapscene.capture.recording_source import AXES, RecordingSource, read_recording_source
from hapscene.capture.streams import BLOCK, Array, blocks
from hapscene.errors import CaptureError
from hapscene.files import check_memory, refusing
from hapscene.number_files import TOO_MUCH
from hapscene.wire.unit import UNITS

COMPUTER_S: Final = 20e-3
"""How well a computer's clock knows when a sample was taken [s]: serial bridges hold bytes back for up to 16 ms."""

AGREE_S: Final = 50e-3
"""How far what the streams say may be off what the computer's clock says before it is not believed [s]."""

JOINED_MIN_S: Final = 1.0
"""Shortest time that joined files must share [s]."""

_MARGIN: Final = 32
"""How many samples beside a block its spline takes in, beyond which none is felt [count]."""


@dataclass(frozen=True)
class Joined:
    """What a joining made."""

    path: Path
    leader: Path
    """the file whose clock the others were brought to, the fastest"""
    rate_Hz: float
    start_s: float
    """where the joined recording begins, by that clock"""
    duration_s: float
    offsets: Mapping[Path, ClockOffset]
    """of the other files; `offset_s` is when the file's first sample was taken, by that clock"""
    names: tuple[str, ...]


@dataclass(frozen=True)
class _Part:
    """A file: its streams under the names that they are to have, by its own clock."""

    path: Path
    clocked: ClockedStreams
    units: Mapping[str, str]


def join(
    paths: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    rates_Hz: Sequence[float] = (),
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    within_s: float = WITHIN_S,
) -> Joined:
    """Joins recordings of one event whose clocks have nothing to do with each other into one file.

    Args:
        paths: two files or more, as `load_recording` reads them; none needs to hold an acceleration.
        out: the .npz file to write.
        rates_Hz: sample rates of the files that do not say theirs: one for all of them, or one each in their order.
        columns: which column holds which quantity, as there; where several files have it, as "FILE:column".
        units: the unit of each quantity, as there; they are kept, not applied.
        within_s: how well the clocks must be known: the 95 % interval to either side [s].

    Raises:
        CaptureError: clocks that cannot be told for sure; files that share no time; what `load_recording` raises.
    """
    target, given = Path(out), [Path(path) for path in paths]
    if target.suffix != ".npz":
        raise CaptureError(f"{target}: joined recordings are written as .npz")
    if len({path.absolute() for path in given}) < max(2, len(given)):
        raise CaptureError("to join takes two files or more, each named once")
    parts = _read(given, rates_Hz, columns or {}, units or {})
    leader = max(parts, key=lambda part: part.clocked.rate_Hz)
    offsets = {part.path: _compared(leader, part, within_s) for part in parts if part is not leader}
    start_s, stop_s = 0.0, leader.clocked.duration_s
    for part in parts:
        if part is not leader:
            known = offsets[part.path]
            start_s = max(start_s, known.offset_s)
            stop_s = min(stop_s, known.offset_s + (1.0 + known.drift) * part.clocked.duration_s)
    if stop_s - start_s < JOINED_MIN_S:
        raise CaptureError(
            f"the files share {max(0.0, stop_s - start_s):.2g} s, at least {JOINED_MIN_S:g} s are needed"
        )
    rate_Hz = leader.clocked.rate_Hz
    samples = np.arange(int(np.ceil(start_s * rate_Hz)), int(np.floor(stop_s * rate_Hz)))
    needed_B = 16 * len(samples) * sum(len(part.clocked.streams) for part in parts)
    check_memory(needed_B, 0, f"{len(samples):,} joined samples", TOO_MUCH)
    streams: dict[str, Array] = {}
    named: dict[str, str] = {}
    for number, part in enumerate([leader, *(part for part in parts if part is not leader)], 1):
        for name, stream in part.clocked.streams.items():
            free = name if name not in streams else f"{name}_{number}"
            if number == 1:
                streams[free] = stream[samples]
            else:
                known = offsets[part.path]
                at = (samples / rate_Hz - known.offset_s) / (1.0 + known.drift) * part.clocked.rate_Hz
                streams[free] = resampled(stream, at)
            if name in part.units:
                named[free] = part.units[name]
    told = [f"{path.name}: {known}" for path, known in offsets.items()]
    provenance = f"joined to the clock of {leader.path.name} from {start_s:.6f} s on; {'; '.join(told)}"
    save_npz(Record(rate_Hz, streams, named, "", None), target, provenance)
    return Joined(target, leader.path, rate_Hz, start_s, len(samples) / rate_Hz, offsets, tuple(streams))


def resampled(stream: Array, at: Array) -> Array:
    """A stream (n,) at places between its samples (k,), in ascending order; NaN beside samples that are missing.

    By splines of the fifth degree: at a tenth of the rate they are off by 6e-6, at a fifth by 6e-4.
    """
    missing = np.isnan(stream)
    if missing.any():
        known = np.flatnonzero(~missing)
        stream = np.interp(np.arange(len(stream)), known, stream[known])
    made = np.empty(len(at))
    for part in blocks(len(at), BLOCK):
        low, high = max(0, int(at[part][0]) - _MARGIN), min(len(stream), int(at[part][-1]) + _MARGIN)
        spline = scipy.interpolate.make_interp_spline(np.arange(low, high), stream[low:high], 5)
        made[part] = spline(at[part])
    beside = np.floor(at).astype(np.int64).clip(0, len(stream) - 2)
    made[missing[beside] | missing[beside + 1]] = np.nan
    return made


# Reading.


def _read(
    paths: Sequence[Path], rates_Hz: Sequence[float], columns: Mapping[str, str], units: Mapping[str, str]
) -> list[_Part]:
    """The files' streams, named as they are to be."""
    for quantity in (*columns, *units):
        if quantity not in UNITS and quantity.rpartition("_")[0] not in VECTORS:
            raise CaptureError(f"no quantity {quantity!r} in columns or units; there are: {', '.join(UNITS)}")
    sources = [read_recording_source(path) for path in paths]
    chosen = [_numbered(path, source) for path, source in zip(paths, sources, strict=True)]
    for quantity, wanted in columns.items():
        _choose(quantity, wanted, paths, chosen)
    silent = [i for i, source in enumerate(sources) if source.rate_Hz is None and "time" not in chosen[i].values()]
    if rates_Hz and len(rates_Hz) not in (1, len(silent)):
        raise CaptureError(
            f"{len(rates_Hz)} rates for {len(silent)} files that do not say theirs: give one, or one each"
        )
    own = dict(zip(silent, list(rates_Hz) * len(silent) if len(rates_Hz) == 1 else rates_Hz, strict=False))
    return [
        _part(path, source, chosen[i], own.get(i), units)
        for i, (path, source) in enumerate(zip(paths, sources, strict=True))
    ]


def _numbered(path: Path, source: RecordingSource) -> dict[str, str]:
    """What each column is called: as in the file; the acceleration where `load_recording` takes it for that."""
    names = list(source.columns)
    if names == ["1"]:
        return {"1": "acceleration"}
    if names == ["1", "2", "3"] and path.suffix.lower() == ".wav":
        return {name: f"acceleration_{axis}" for name, axis in zip(names, AXES, strict=True)}
    return {name: name for name in names}


def _choose(quantity: str, wanted: str, paths: Sequence[Path], chosen: Sequence[dict[str, str]]) -> None:
    """Calls a column, or the columns of several axes, as the quantity that they hold."""
    file, colon, column = wanted.rpartition(":")
    names = [column if colon else wanted]
    if not any(names[0] in each for each in chosen):
        names = [name.strip() for name in names[0].split("+")]
    having = [
        i
        for i, path in enumerate(paths)
        if all(name in chosen[i] for name in names) and (not colon or file in (path.name, str(path)))
    ]
    if not having:
        there = "; ".join(f"{path.name}: {', '.join(each)}" for path, each in zip(paths, chosen, strict=True))
        raise CaptureError(f"no file has {wanted!r}; there are: {there}")
    if len(having) > 1:
        said = f"{paths[having[0]].name}:{wanted}"
        raise CaptureError(f"{wanted!r} is in {len(having)} files: say which one, as in {quantity}={said}")
    ends = [""] if len(names) == 1 else [f"_{axis}" for axis in AXES]
    for name, end in zip(names, ends, strict=False):
        chosen[having[0]][name] = f"{quantity}{end}"


def _part(
    path: Path, source: RecordingSource, chosen: Mapping[str, str], rate_Hz: float | None, units: Mapping[str, str]
) -> _Part:
    """A file's streams as they are to be called, each as eight bytes a number; and its rate."""
    check_memory(16 * sum(len(column) for column in source.columns.values()), source.own_B, path.name, TOO_MUCH)
    streams = {chosen[name]: source.scale * np.array(column, np.float64) for name, column in source.columns.items()}
    own = {chosen[name]: unit for name, unit in source.units.items() if name in chosen}
    for name in streams:
        for quantity in (name, name.rpartition("_")[0]):
            if quantity in units:
                own[name] = units[quantity]
    with refusing(CaptureError, path):
        time_s = streams.pop("time", None)
        if time_s is not None:
            time_s = time_s * UNITS["time"].get(own.pop("time", "s"), 1.0)
        own_Hz = rate_of(rate_Hz, source, time_s)
        for name, stream in streams.items():
            if not np.isfinite(stream).sum() > 1 or np.isinf(stream).any():
                raise CaptureError(f"{name}: numbers expected, and at least two of them")
        if not streams:
            raise CaptureError("holds nothing but times")
    return _Part(path, ClockedStreams(own_Hz, streams), own)


# Comparing.


def _compared(leader: _Part, part: _Part, within_s: float) -> ClockOffset:
    """How the clock of a file stands against the leader's: by what both felt, else by the computer's."""
    guess = _by_computer(leader.path, part.path)
    near_s = 0.0 if guess is None else guess.offset_s
    try:
        known = clock_offset(_bridged(leader.clocked), _bridged(part.clocked), near_s=near_s, within_s=within_s)
    except CaptureError as error:
        if guess is None:
            raise CaptureError(f"{leader.path.name} and {part.path.name}: {error}") from None
        return guess
    middle_s = 0.5 * part.clocked.duration_s
    if guess is not None and abs(known.offset_s - guess.offset_s + (known.drift - guess.drift) * middle_s) > AGREE_S:
        return guess
    return known


def _bridged(clocked: ClockedStreams) -> ClockedStreams:
    """Streams whose missing samples lie on straight lines."""
    made = {}
    for name, stream in clocked.streams.items():
        known = np.flatnonzero(~np.isnan(stream))
        made[name] = stream if len(known) == len(stream) else np.interp(np.arange(len(stream)), known, stream[known])
    return replace(clocked, streams=made)


def _by_computer(first: Path, second: Path) -> ClockOffset | None:
    """What the computer's clock says of two records that were made beside each other; None of others."""
    if first.suffix != SUFFIX or second.suffix != SUFFIX:
        return None
    one, two = load_record(first), load_record(second)
    if not one.clock or one.clock != two.clock or not len(one.clock_s) or not len(two.clock_s):
        return None
    (start_one, pace_one), (start_two, pace_two) = _pace(one), _pace(two)
    drift = pace_two / pace_one - 1.0
    if abs(drift) > DRIFT_MAX:
        drift, pace_one = 0.0, 1.0  # too short a time says nothing of it
    offset_s = (start_two - start_one) / pace_one
    return ClockOffset(offset_s, drift, COMPUTER_S, "clock", min(len(one.clock_s), len(two.clock_s)), 1.0)


def _pace(record: Record) -> tuple[float, float]:
    """When the first sample was taken and how long a second of the probe is, by the computer's clock.

    Samples come late, never early: the line below all of them, as near to them as can be.
    """
    own_s, computer_s = record.clock_s[:, 0] / record.rate_Hz, record.clock_s[:, 1]
    base = float(computer_s[0] - own_s[0])
    below = np.stack([np.ones_like(own_s), own_s], axis=1)
    found = scipy.optimize.linprog(
        -below.sum(axis=0), below, computer_s - own_s - base, bounds=[(None, None), (-2.0 * DRIFT_MAX, 2.0 * DRIFT_MAX)]
    )
    late_s, slow = (0.0, 0.0) if found.x is None else map(float, found.x)
    return base + late_s, 1.0 + slow
