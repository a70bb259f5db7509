"""Column maps of published data sets, whose recordings are recognised by their file names.

The maps follow the descriptions of the data sets. If a description states no unit, the caller must give it (`units`).

- LMT108 and the older LMT Haptic Texture Database: one axis per file. Strese, Schuwerk, Iepure & Steinbach 2017,
  "Multimodal Feature-Based Surface Material Classification", IEEE Trans. Haptics.
- Cluster Haptic Texture Dataset: acceleration, force and position in three folders, each with time stamps. Eguchi et
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
"""Longest gap between two samples that is interpolated [samples]; samples in longer gaps are missing."""


@dataclass(frozen=True)
class Dataset:
    """File names and columns of a data set.

    Attributes:
        path: pattern of the full path of a recording's main file.
        columns: for each quantity, the path of its file (a template for the groups of `path`) and its column there.
        rate_Hz: sample rate; tables with time stamps are resampled to it.
        units: units that the description of the data set states, by quantity.
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
    """Reads a recording of a published data set from all its files; None if the name belongs to no data set.

    Raises:
        CaptureError: a file does not match the description of its data set.
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
            raise CaptureError(f"its columns have different lengths ({listed})")
    return RecordingSource(columns, dataset.rate_Hz, dataset.units, own_B=own_B)


def _column(table: RecordingSource, name: str) -> Column:
    if name not in table.columns:
        raise CaptureError(f"no column {name!r}; found: {', '.join(table.columns)}")
    check_range(name, table.columns[name])
    if not np.isfinite(table.columns[name]).all():
        raise CaptureError(f"column {name!r} contains values that are not finite")
    return table.columns[name]


def _times_s(table: RecordingSource) -> Array:
    """Time stamps of a table [s], from the column `time` [s] of CSV or `time_ns` [ns] of Parquet."""
    name, scale = ("time_ns", 1e-9) if "time_ns" in table.columns else ("time", 1.0)
    t_s = scale * np.asarray(_column(table, name), np.float64)
    if not (len(t_s) > 1 and np.all(np.diff(t_s) > 0.0)):
        raise CaptureError("the time stamps do not increase")
    return t_s


def _resampled(
    columns: Mapping[str, Column], times_s: Mapping[str, Array], rate_Hz: float, own_B: int
) -> Mapping[str, Array]:
    """Resamples columns to common, evenly spaced times; NaN in gaps of the acceleration."""
    start_s, end_s = max(t_s[0] for t_s in times_s.values()), min(t_s[-1] for t_s in times_s.values())
    if not end_s > start_s:
        raise CaptureError("the time stamps of its columns do not overlap")
    count = int((end_s - start_s) * rate_Hz) + 1
    check_memory(16 * 8 * count, own_B, f"resampling to {count:,} samples from {start_s:g} to {end_s:g} s", TOO_MUCH)
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
