"""Recordings in the layouts in which data sets of the field are published: which files belong to one surface, and
what is in them.

Read is what a data set's own description says, and nothing is guessed: where it says no unit, `units` must. No file of
these sets was at hand; the tests read files made to the descriptions.

- `lmt`: LMT108, and the LMT Haptic Texture Database before it. Strese, Schuwerk, Iepure & Steinbach 2017, "Multimodal
  Feature-Based Surface Material Classification", IEEE Trans. Haptics; Strese et al. 2014, "A Haptic Texture Database
  for Tool-Mediated Texture Recognition and Classification", HAVE.
- `cluster`: Cluster Haptic Texture Dataset, as CSV of its authors or mirrored as Parquet. Eguchi et al., arXiv
  2407.16206v4; cluster-lab/Cluster-Haptic-Texture-Dataset, documents/dataset_details.md.
- `hatt`: recordings of the Penn Haptic Texture Toolkit. Culbertson, López Delgado & Kuchenbecker 2014, "The Penn Haptic
  Texture Toolkit for Modeling, Rendering, and Evaluating Haptic Virtual Textures".
- `proton`: an episode of the Proton Pack. Burka et al. 2017, "Proton 2: Increasing the Sensitivity and Portability of a
  Visuo-haptic Surface Interaction Recorder", ICRA; haptics-nri/mfi16-figures, load_stick.m and process_mini40.m.

A recording is named by one of its files. A surface, all of whose recordings are joined, is named by the folder that
has it alone, or as FOLDER/NAME where a folder has several: `Training/G1EpoxyRasterPlate`, `accel/17`.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy

from hapscene.capture.recording_source import (
    AXES,
    BYTES_MAX,
    Column,
    RecordingSource,
    read_recording_source,
    read_tables,
)
from hapscene.capture.streams import Array
from hapscene.errors import CaptureError, no_such
from hapscene.files import check_memory, refusing
from hapscene.number_files import TOO_MUCH

FILE_MAX: Final = 10_000
"""Most files of a surface that are joined [count]; those of the Cluster data set have 480 each."""


@dataclass(frozen=True)
class Layout:
    """How a data set is laid out.

    Attributes:
        file: of which names its main files are; its groups `surface`, `take`, `repeat` and `query` say whose.
        read: the recordings of the main files that are given, each a list: of one recording, with all its axes.
        folder: in a folder of which name they are, or "" for any.
    """

    file: re.Pattern[str]
    read: Callable[[Sequence[Sequence[Path]]], list[RecordingSource]]
    folder: str = ""

    def has(self, file: Path) -> bool:
        """Whether a file is one of its main files, by its name."""
        there = not self.folder or self.folder in file.parts
        return there and self.file.fullmatch(file.name) is not None and file.is_file()

    def surface(self, file: Path) -> str:
        """Whose recording a file is."""
        found = self.file.fullmatch(file.name)
        return found["surface"] if found and "surface" in self.file.groupindex else file.parent.name

    def take(self, file: Path) -> str:
        """Which of a surface's recordings a file belongs to."""
        found = self.file.fullmatch(file.name)
        parts = found.groupdict() if found else {}
        return " ".join(parts[key] or "" for key in ("take", "repeat", "query") if key in parts) or file.name


def recognised(path: Path) -> str | None:
    """The layout that a file or a folder is in for certain, by its name."""
    for name, layout in LAYOUTS.items():
        names = [path] if not path.is_dir() else [path / "teensy.ft.csv"] if name == "proton" else []
        if any(map(layout.has, names)):
            return name
    return None


def read_layout(path: Path, name: str) -> RecordingSource:
    """What a published recording, or all of those of a surface, hold: columns by our names, units where they are said.

    Args:
        path: one of the recording's files; or the surface, as the module says.
        name: one of `LAYOUTS`.

    Raises:
        CaptureError: no such layout, no such recording, or a file that is not as its data set is described.
    """
    return _joined(_named(name).read(_takes(path, name)))


def surfaces(folder: Path, name: str) -> list[Path]:
    """The surfaces below a folder, sorted, as `read_layout` takes them: for a swatch of each.

    Raises:
        CaptureError: no such layout, or nothing of it there.
    """
    layout = _named(name)
    files = filter(layout.has, folder.rglob("*"))
    found = {file.parent if name == "proton" else file if name == "hatt" else file.parent / layout.surface(file)
             for file in files}  # fmt: skip
    if not found:
        raise CaptureError(f"{folder}: no recordings in the layout {name!r}")
    return sorted(found)


def files_of(path: Path, name: str) -> list[Path]:
    """The main files of a recording or a surface.

    Raises:
        CaptureError: as `read_layout`.
    """
    return [file for take in _takes(path, name) for file in take]


def _named(name: str) -> Layout:
    if name not in LAYOUTS:
        raise CaptureError(no_such("layout", name, LAYOUTS))
    return LAYOUTS[name]


def _takes(path: Path, name: str) -> list[list[Path]]:
    """The recordings that a path means, each as its main files, sorted."""
    layout = _named(name)
    home = path if path.is_dir() else path.parent
    beside = [file for file in home.iterdir() if layout.file.fullmatch(file.name)] if home.is_dir() else []
    if path.is_dir():
        found = beside
        if len(whose := sorted({layout.surface(file) for file in found})) > 1:
            raise CaptureError(f"{path}: has {len(whose)} surfaces; name one, as {path / whose[0]}")
    elif path in beside:
        key = layout.surface(path), layout.take(path)
        found = [file for file in beside if (layout.surface(file), layout.take(file)) == key]
    else:
        found = [file for file in beside if layout.surface(file) == path.name]
    if not found:
        raise CaptureError(f"{path}: no recording in the layout {name!r}")
    if len(found) > FILE_MAX or sum(file.stat().st_size for file in found) > BYTES_MAX:
        raise CaptureError(f"{path}: {len(found)} files, too many or too large to be joined: name one of them")
    takes: dict[str, list[Path]] = {}
    for file in sorted(found):
        takes.setdefault(layout.take(file), []).append(file)
    return list(takes.values())


def _joined(sources: list[RecordingSource]) -> RecordingSource:
    """Recordings one after the other. No stream jumps at a seam that is not a speed's or a force's: each acceleration
    is without its mean, which is gravity, and each place goes on from where the last one ended."""
    first = sources[0]
    if len(sources) == 1:
        return first
    if any(source.columns.keys() != first.columns.keys() for source in sources):
        raise CaptureError("its recordings do not hold the same streams: name one of them")
    rate_Hz = float(np.mean([source.rate_Hz or math.nan for source in sources]))
    columns: dict[str, Column] = {}
    for name in first.columns:
        parts = [np.asarray(source.columns[name], np.float64) for source in sources]
        if name.startswith("acceleration"):
            parts = [p - np.nanmean(p) for p in parts]
        if name.startswith("position"):
            ends = np.cumsum([0.0, *(p[-1] - p[0] for p in parts[:-1])])
            parts = [p - p[0] + end for p, end in zip(parts, ends, strict=True)]
        columns[name] = np.concatenate(parts)
    return RecordingSource(columns, rate_Hz, first.units, own_B=sum(source.own_B for source in sources))


# LMT: a file an axis, a number a line, 10 kHz; by hand, so neither force nor speed. Its unit is not stated.


LMT_HZ: Final = 10_000.0

_LMT_AXIS: Final = re.compile(r".*_([XYZ])_[a-z]+\d+\.txt")


def _lmt(takes: Sequence[Sequence[Path]]) -> list[RecordingSource]:
    return [_lmt_take(files) for files in takes]


def _lmt_take(files: Sequence[Path]) -> RecordingSource:
    columns: dict[str, Column] = {}
    for file in files:
        axis = _LMT_AXIS.fullmatch(file.name)
        source = read_recording_source(file)
        if list(source.columns) != ["1"]:
            raise CaptureError(f"{file}: expected a number a line, found {len(source.columns)} columns")
        columns[f"acceleration_{axis[1].lower()}" if axis else "acceleration"] = source.columns["1"]
    counts = {name: len(column) for name, column in columns.items()}
    if len(set(counts.values())) > 1:
        said = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise CaptureError(f"{files[0]}: its axes have different lengths ({said})")
    return RecordingSource(columns, LMT_HZ, own_B=sum(file.stat().st_size for file in files))


# Cluster: acceleration [g], normal force [N] and place [mm] in three folders, each with times of its own; direction,
# speed and force of the machine in the name.


CLUSTER_HZ: Final = 6_000.0
"""Rate of acceleration and force, as described [Hz]; the times in the files are uneven, and are made even by curves."""

ACCELERATION: Final = "accel"

GAP_S: Final = 5.0 / CLUSTER_HZ
"""Longest time without a sample over which a curve is drawn [s]: beyond, samples were lost and count as missing."""


def _cluster(takes: Sequence[Sequence[Path]]) -> list[RecordingSource]:
    main = [take[0] for take in takes]
    for file in main:
        if ACCELERATION not in file.parts:
            raise CaptureError(f"{file}: name the recording by its file in the folder {ACCELERATION}")
    places = {kind: [_beside(file, kind) for file in main] for kind in ("force", "position")}
    there = [*main, *(file for files in places.values() for file in files if file.is_file())]
    tables = dict(zip(there, read_tables(there), strict=True))
    return [
        _cluster_take(file, tables[file], tables.get(places["force"][i]), tables.get(places["position"][i]))
        for i, file in enumerate(main)
    ]


def _beside(file: Path, kind: str) -> Path:
    """The file of the same recording in another folder of sensor_data."""
    parts = list(file.parts)
    place = len(parts) - 1 - parts[::-1].index(ACCELERATION)
    return Path(*parts[:place], kind, *parts[place + 1 :])


def _cluster_take(
    file: Path, accel: RecordingSource, force: RecordingSource | None, position: RecordingSource | None
) -> RecordingSource:
    named = LAYOUTS["cluster"].file.fullmatch(file.name)
    assert named is not None
    with refusing(CaptureError, file):
        streams = [(_times_s(source), source) for source in (accel, force, position) if source is not None]
        start_s, end_s = max(t[0] for t, _ in streams), min(t[-1] for t, _ in streams)
        if not end_s - start_s > 0.0:
            raise CaptureError("its streams have no time in common")
        own_B = sum(source.own_B for _, source in streams)
        count = math.floor((end_s - start_s) * CLUSTER_HZ) + 1
        check_memory(16 * 8 * count, own_B, f"{count:,} samples from {start_s:g} to {end_s:g} s", TOO_MUCH)
        t_s = start_s + np.arange(count) / CLUSTER_HZ
        own_s = streams[0][0]
        lost = np.diff(own_s)[np.clip(np.searchsorted(own_s, t_s, "right") - 1, 0, len(own_s) - 2)] > GAP_S
        columns: dict[str, Column] = {}
        for axis in AXES:
            curve: Array = scipy.interpolate.CubicSpline(own_s, _finite(accel, axis.upper()))(t_s)
            columns[f"acceleration_{axis}"] = np.where(lost, np.nan, curve)
        if force is None:
            columns["force"] = np.full(len(t_s), 1e-3 * float(named["force"]))
        else:
            columns["force"] = np.interp(t_s, _times_s(force), _finite(force, "force"))
        units = {"acceleration_x": "g", "force": "N", "speed": "mm/s", "direction": "deg", "position_x": "mm"}
        if position is None:
            columns["speed"] = np.full(len(t_s), float(named["speed"]))
        else:
            for axis in AXES[:2]:
                columns[f"position_{axis}"] = np.interp(t_s, _times_s(position), _finite(position, axis.upper()))
        columns["direction"] = np.full(len(t_s), -float(named["direction"]))  # clockwise in the name
        return RecordingSource(columns, CLUSTER_HZ, units, own_B=own_B)


def _times_s(source: RecordingSource) -> Array:
    """A table's times [s]: `time` in CSV [s], `time_ns` in Parquet [ns]; they grow."""
    t_s = 1e-9 * _finite(source, "time_ns") if "time_ns" in source.columns else _finite(source, "time")
    if not (len(t_s) > 1 and np.all(np.diff(t_s) > 0.0)):
        raise CaptureError("its times do not grow")
    return t_s


def _column(source: RecordingSource, name: str) -> Array:
    if name not in source.columns:
        raise CaptureError(f"no column {name!r}; there are: {', '.join(source.columns)}")
    return np.asarray(source.columns[name], np.float64)


def _finite(source: RecordingSource, name: str) -> Array:
    """A column of a table that leaves out what it lacks, rather than saying so."""
    column = _column(source, name)
    if not np.isfinite(column).all():
        raise CaptureError(f"column {name!r}: finite numbers expected")
    return column


# HaTT's recordings: XML that says its rate and its units.


HATT_BYTES_MAX: Final = 32 << 20
"""Largest recording that is read [bytes]: ten seconds of twelve streams at 10 kHz, each number in an element."""

_HATT: Final = (
    ("acceleration", "accel", "accelunits"),
    ("position", "position", "positionunits"),
    ("force", "forcenormal", "forceunits"),
    ("tangential_force", "forcetangential", "forceunits"),
    ("speed", "speed", "speedunits"),
)
"""Quantity, the element of its numbers and that of its unit. Of the force, what the file itself calls normal and
tangential: which axis of the sensor is the normal one is not said."""


def _hatt(takes: Sequence[Sequence[Path]]) -> list[RecordingSource]:
    return [_hatt_file(take[0]) for take in takes]


def _hatt_file(file: Path) -> RecordingSource:
    """One recording. Axes are elements AccelX, AccelY, AccelZ, or x, y, z in Accel; numbers stand apart by spaces,
    commas or semicolons, or in `value` elements."""
    from hapscene.capture.hatt_file import element_name, read_tree

    root = read_tree(file, HATT_BYTES_MAX, CaptureError)
    found: dict[str, Any] = {}
    for element in root.iter():
        name = element_name(element).casefold()
        inside = element.getparent() is not None and name in AXES
        found[(element_name(element.getparent()).casefold() if inside else "") + name] = element
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for quantity, stem, unit in _HATT:
        for axis in ("", *AXES):
            array = _hatt_numbers(file, found.get(stem + axis))
            if array is not None:
                name = f"{quantity}_{axis}" if axis else quantity
                columns[name], units[name] = array, _hatt_text(found.get(unit))
    if not any(name.startswith("acceleration") for name in columns):
        raise CaptureError(f"{file}: no acceleration: <AccelX>, <AccelY>, <AccelZ> or <Accel> expected")
    if len({len(column) for column in columns.values()}) > 1:
        raise CaptureError(f"{file}: its streams have different lengths")
    said = _hatt_text(found.get("samplerate"))
    try:
        rate_Hz = float(said)
    except ValueError:
        raise CaptureError(f"{file}: <SampleRate>: a number of Hz expected, found {said[:40]!r}") from None
    known = {name: unit for name, unit in units.items() if unit}
    return RecordingSource(columns, rate_Hz, known, own_B=file.stat().st_size)


def _hatt_text(element: Any) -> str:
    return "" if element is None else " ".join("".join(element.itertext()).split())


def _hatt_numbers(file: Path, element: Any) -> Array | None:
    """The numbers of an element; None where there is none, or it holds elements of other kinds, or nothing."""
    if element is None or any(child.tag != "value" for child in element):
        return None
    content = " ".join(element.itertext())
    try:
        array = np.array(re.sub("[,;]", " ", content).split(), np.float64)
    except ValueError:
        array = np.array([np.nan])
    if not np.isfinite(array).all():
        raise CaptureError(f"{file}: <{element.tag}>: finite numbers expected")
    return array if array.size else None


# Proton Pack: bytes of an analogue accelerometer. Its force needs the calibration of the device's own sensor, its place
# that of its cameras: neither is in the folder, so neither is read.


_PROTON_ROWS: Final = {"y": 18, "z": 20, "x": 22, "y2": 24}
"""First of two bytes of each axis, the higher one: those of the first accelerometer, and the second's y."""

PROTON_OLD: Final = (("x", "y", "z"), 16.0)
"""Axes and range [g] of the pack's first accelerometers, ADXL326."""

PROTON_NEW: Final = (("x", "y", "y2"), 3.0)
"""And of the later ones, ADXL335: where they are, the old z is tied to ground, and stays below `PROTON_GROUND`."""

PROTON_GROUND: Final = 500.0

PROTON_COUNTS: Final = 4096.0


def _proton(takes: Sequence[Sequence[Path]]) -> list[RecordingSource]:
    return [_proton_file(take[0]) for take in takes]


def _proton_file(file: Path) -> RecordingSource:
    source = read_recording_source(file)
    with refusing(CaptureError, file):
        time_s = _column(source, "Timestamp")
        if not (len(time_s) > 1 and time_s[-1] > time_s[0]):
            raise CaptureError("its times do not grow")
        counts = {axis: 256.0 * _column(source, f"FT{i}") + _column(source, f"FT{i + 1}") for axis, i in
                  _PROTON_ROWS.items()}  # fmt: skip
    axes, range_g = PROTON_NEW if np.median(counts["z"]) < PROTON_GROUND else PROTON_OLD
    columns = {
        f"acceleration_{name}": range_g / PROTON_COUNTS * counts[axis] for name, axis in zip(AXES, axes, strict=True)
    }
    rate_Hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    return RecordingSource(columns, rate_Hz, {"acceleration_x": "g"}, own_B=source.own_B)


LAYOUTS: Final[Mapping[str, Layout]] = {
    "lmt": Layout(
        re.compile(
            r"(?P<surface>G\d\w*?)_"
            r"(?:(?P<take>Movement|Tapping)_[XYZ]_(?P<repeat>(?:train|test)\d+)|(?P<query>query\d+))\.txt"
        ),
        _lmt,
    ),
    "cluster": Layout(
        re.compile(r"(?P<surface>\d+)_(?P<take>(?P<direction>\d+)_(?P<speed>\d+)_(?P<force>\d+)_\d+)\.(?:csv|parquet)"),
        _cluster,
        ACCELERATION,
    ),
    "hatt": Layout(re.compile(r".*\.xml", re.IGNORECASE), _hatt),
    "proton": Layout(re.compile(r"teensy\.ft\.csv"), _proton),
}
"""The layouts that are read."""
