"""Column maps of published data sets: recordings that are recognised by their file name.

The maps follow the data sets' own descriptions; where a description states no unit, you give it (`units`).

- LMT108, and the LMT Haptic Texture Database before it: one axis a file. Strese, Schuwerk, Iepure & Steinbach 2017,
  "Multimodal Feature-Based Surface Material Classification", IEEE Trans. Haptics.
- Cluster Haptic Texture Dataset: acceleration, force and position in three folders, each with its own times. Eguchi et
  al., arXiv 2407.16206v4; cluster-lab/Cluster-Haptic-Texture-Dataset, documents/dataset_details.md.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from hapscene.capture.io.formats import Column, RecordingSource, check_range, read_recording_source
from hapscene.capture.io.streams import Array
from hapscene.errors import CaptureError
from hapscene.io.files import check_memory, refusing
from hapscene.io.number_files import TOO_MUCH

__all__ = ["DATASETS", "GAP_SAMPLES", "Dataset", "read_dataset"]

GAP_SAMPLES: Final = 5.0
"""Longest gap between two samples that is interpolated [samples]; samples in a longer one count as missing."""


@dataclass(frozen=True)
class Dataset:
    """Where the streams of one recording are.

    Attributes:
        path: pattern of the full path of a recording's main file.
        columns: by name of the stream, the path of its file (a template for the groups of `path`) and its column there.
        rate_Hz: sample rate; tables with times are resampled to it.
        units: by name of the stream, where the data set's description states them.
    """

    path: re.Pattern[str]
    columns: Mapping[str, tuple[str, str]]
    rate_Hz: float
    units: Mapping[str, str] = field(default_factory=dict)


DATASETS: Final = (
    Dataset(
        re.compile(r"(.*/G\d\w*?_(?:Movement|Tapping)_)[XYZ](_(?:train|test)\d+\.txt)"),
        {f"acceleration_{axis.lower()}": (rf"\1{axis}\2", "1") for axis in "XYZ"},
        rate_Hz=10_000.0,
    ),
    Dataset(re.compile(r"(.*/G\d\w*?_query\d+\.txt)"), {"acceleration": (r"\1", "1")}, rate_Hz=10_000.0),
    Dataset(
        re.compile(r"(.*/)accel/((?:[^/]+/)*\d+_\d+_\d+_\d+_\d+\.(?:csv|parquet))"),
        {f"acceleration_{axis.lower()}": (r"\1accel/\2", axis) for axis in "XYZ"}
        | {"force": (r"\1force/\2", "force")}
        | {f"position_{axis.lower()}": (r"\1position/\2", axis) for axis in "XY"},
        rate_Hz=6000.0,
        units={"acceleration_x": "g", "force": "N", "position_x": "mm"},
    ),
)


def read_dataset(path: Path) -> RecordingSource | None:
    """The streams of a published recording, those of its other files included; None if the name is of no data set.

    Raises:
        CaptureError: a file that is not as its data set is described.
    """
    for dataset in DATASETS:
        if match := dataset.path.fullmatch(path.absolute().as_posix()):
            return _read(path, match, dataset)
    return None


def _read(path: Path, match: re.Match[str], dataset: Dataset) -> RecordingSource:
    tables: dict[str, RecordingSource] = {}
    columns: dict[str, Column] = {}
    times_s: dict[str, Array] = {}
    for name, (template, column) in dataset.columns.items():
        file = match.expand(template)
        if file not in tables:
            if not Path(file).is_file():
                continue
            tables[file] = read_recording_source(Path(file))
        with refusing(CaptureError, file):
            columns[name] = _column(tables[file], column)
            if "time" in tables[file].columns or "time_ns" in tables[file].columns:
                times_s[name] = _times_s(tables[file])
    own_B = sum(table.own_B for table in tables.values())
    with refusing(CaptureError, path):
        if times_s:
            columns = dict(_resampled(columns, times_s, dataset.rate_Hz, own_B))
        counts = {name: len(column) for name, column in columns.items()}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise CaptureError(f"its streams have different lengths ({listed})")
    return RecordingSource(columns, dataset.rate_Hz, dataset.units, own_B=own_B)


def _column(table: RecordingSource, name: str) -> Column:
    if name not in table.columns:
        raise CaptureError(f"no column {name!r}; there are: {', '.join(table.columns)}")
    check_range(name, table.columns[name])
    if not np.isfinite(table.columns[name]).all():
        raise CaptureError(f"column {name!r}: finite numbers expected")
    return table.columns[name]


def _times_s(table: RecordingSource) -> Array:
    """A table's times [s]: `time` in CSV [s], `time_ns` in Parquet [ns]."""
    name, scale = ("time_ns", 1e-9) if "time_ns" in table.columns else ("time", 1.0)
    t_s = scale * np.asarray(_column(table, name), np.float64)
    if not (len(t_s) > 1 and np.all(np.diff(t_s) > 0.0)):
        raise CaptureError("its times do not increase")
    return t_s


def _resampled(
    columns: Mapping[str, Column], times_s: Mapping[str, Array], rate_Hz: float, own_B: int
) -> Mapping[str, Array]:
    """Streams on one evenly spaced time; NaN in the gaps of an acceleration."""
    start_s, end_s = max(t_s[0] for t_s in times_s.values()), min(t_s[-1] for t_s in times_s.values())
    if not end_s > start_s:
        raise CaptureError("its streams have no time in common")
    count = int((end_s - start_s) * rate_Hz) + 1
    check_memory(16 * 8 * count, own_B, f"{count:,} samples from {start_s:g} to {end_s:g} s", TOO_MUCH)
    t_s = start_s + np.arange(count) / rate_Hz
    made: dict[str, Array] = {}
    for name, column in columns.items():
        own_s, values = times_s[name], np.asarray(column, np.float64)
        if name.startswith("acceleration"):
            gap_s = np.diff(own_s)[np.clip(np.searchsorted(own_s, t_s, "right") - 1, 0, len(own_s) - 2)]
            curve = scipy.interpolate.CubicSpline(own_s, values)(t_s)
            made[name] = np.where(gap_s * rate_Hz > GAP_SAMPLES, np.nan, curve)
        else:
            made[name] = np.interp(t_s, own_s, values)
    return made
