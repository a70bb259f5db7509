"""The recording of a run, one row per tick, and its file formats touch.npz and touch.csv."""

import math
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import FormatError
from hapscene.io.files import check_memory, refusing, whole_file
from hapscene.io.number_files import Npz, open_npz
from hapscene.records import Records

__all__ = ["Recording", "RecordingError", "load_touch", "save_touch"]

FORMAT_VERSION: Final = 2
"""Version of the npz layout; later versions are rejected. Version 1 lacks `began`, which is recomputed, and
`f_body_W_N`."""

BYTES_MAX: Final = 4 << 30
"""Most bytes that a recording may hold uncompressed [B]: three hours at the usual rates. Larger files are rejected
before they are read."""


class RecordingError(FormatError):
    """A recording is missing, damaged, of a later version, or its arrays do not match."""


# Arrays with one row per tick: type and shape of a row (None: the acceleration block, of any length).
_COLUMNS: Final[dict[str, tuple[str, tuple[int, ...] | None]]] = {
    "t_s": ("f8", ()),
    "p_WT_m": ("f8", (3,)),
    "p_WP_m": ("f8", (3,)),
    "nhat_W": ("f8", (3,)),
    "depth_m": ("f8", ()),
    "touching": ("?", ()),
    "body": ("i4", ()),
    "face": ("i4", ()),
    "swatch": ("i4", ()),
    "f_W_N": ("f8", (3,)),
    "flags": ("u4", ()),
    "tick_ns": ("i8", ()),
    "contact_ns": ("i8", ()),
    "slip_m_s": ("f8", ()),
    "normal_force_N": ("f8", ()),
    "began": ("?", ()),
    "f_body_W_N": ("f8", (3,)),
    "R_WT": ("f8", (3, 3)),
    "a_m_s2": ("f8", None),
}
_MEASURED: Final = "R_WT"  # absent without a device that measures it
_SINCE_2: Final = ("began", "f_body_W_N")
_NAMES: Final = ("body_names", "swatch_names", "effects")
_CSV_ROWS: Final = 10_000  # rows converted at once
_NAME_B: Final = 100  # memory of a name in addition to its characters


@dataclass(frozen=True, eq=False)
class Recording:
    """Recording of a run: n ticks in SI units, vectors in the world frame W.

    Raises:
        RecordingError: an array has a wrong shape, or an index exceeds its list of names.
    """

    t_s: NDArray[np.float64]
    """(n,) time since the start [s]."""
    p_WT_m: NDArray[np.float64]
    """(n, 3) device position."""
    p_WP_m: NDArray[np.float64]
    """(n, 3) proxy: on the surface in contact, at the device position without contact."""
    nhat_W: NDArray[np.float64]
    """(n, 3) unit normal out of the surface; in the air, the normal of the last contact."""
    depth_m: NDArray[np.float64]
    """(n,) penetration depth, the distance from the device to the proxy, ≥ 0."""
    touching: NDArray[np.bool_]
    """(n,) whether the device is inside a surface."""
    body: NDArray[np.int32]
    """(n,) touched body, an index into `body_names`; −1 without contact."""
    face: NDArray[np.int32]
    """(n,) touched face of the mesh of that body; −1 without contact."""
    swatch: NDArray[np.int32]
    """(n,) touched swatch, an index into `swatch_names`; −1 without contact."""
    f_W_N: NDArray[np.float64]
    """(n, 3) force on the hand."""
    flags: NDArray[np.uint32]
    """(n,) bits of `hapscene.Flag`."""
    tick_ns: NDArray[np.int64]
    """(n,) computation time of the tick [ns]."""
    contact_ns: NDArray[np.int64]
    """(n,) computation time of the contact [ns]."""
    a_m_s2: NDArray[np.float64]
    """(n, block) acceleration along the handle; sample k of tick i is at `t_s[i] + k / a_rate_Hz`."""
    a_rate_Hz: float
    """Rate of the acceleration samples."""
    body_names: tuple[str, ...]
    swatch_names: tuple[str, ...]
    seed: int
    """Seed of the random numbers of effects."""
    effects: tuple[str, ...]
    """Names of the effects in the order in which they were summed."""
    slip_m_s: NDArray[np.float64]
    """(n,) slip speed, low-passed; selects the texture model."""
    normal_force_N: NDArray[np.float64]
    """(n,) stiffness times depth."""
    began: NDArray[np.bool_] = None  # type: ignore[assignment]  # absent in files of version 1
    """(n,) whether a contact begins in the tick."""
    f_body_W_N: NDArray[np.float64] = None  # type: ignore[assignment]
    """(n, 3) force of the tool on the touched body at the proxy: contact only, not limited to the device.
    NaN if unknown."""
    R_WT: NDArray[np.float64] | None = None
    """(n, 3, 3) orientation of the tool, z along the handle towards the hand; None if it was not measured."""

    def __post_init__(self) -> None:
        count = len(self.t_s)
        if self.began is None:
            before = np.concatenate(([False], self.touching[:-1]))
            object.__setattr__(self, "began", self.touching & ~before)
        if self.f_body_W_N is None:
            object.__setattr__(self, "f_body_W_N", np.full((count, 3), np.nan))
        for name, row in self._columns.items():
            shape = getattr(self, name).shape
            if shape[:1] != (count,) or (len(shape) != 2 if row is None else shape[1:] != row):
                wanted = f"({count}, block)" if row is None else str((count, *row))
                raise RecordingError(f"recording: {name} has shape {shape}, expected {wanted}")
        for name, names in (("body", self.body_names), ("swatch", self.swatch_names)):
            index = getattr(self, name)
            if count and not -1 <= index.min() <= index.max() < len(names):
                raise RecordingError(f"recording: {name} holds an index outside −1 … {len(names) - 1}")

    def __repr__(self) -> str:
        touching = int(np.count_nonzero(self.touching))
        effects = ", ".join(self.effects) or "no effects"
        return f"<Recording: {len(self):,} ticks, {touching:,} in contact; {effects}; a_rate_Hz={self.a_rate_Hz:g}>"

    def __len__(self) -> int:
        """Count of ticks."""
        return len(self.t_s)

    @property
    def _columns(self) -> dict[str, tuple[int, ...] | None]:
        """Names of the arrays that the recording has, and the shape of a row."""
        return {name: row for name, (_, row) in _COLUMNS.items() if name != _MEASURED or self.R_WT is not None}

    @property
    def a_t_s(self) -> NDArray[np.float64]:
        """(n · block,) time of each acceleration sample, row by row [s]."""
        offset_s = np.arange(self.a_m_s2.shape[1]) / self.a_rate_Hz
        return (self.t_s[:, None] + offset_s).ravel()

    def save(self, path: str | Path) -> None:
        """Write the recording as npz, atomically and without pickled objects.

        Raises:
            OSError: the folder is missing or cannot be written.
        """
        arrays = {name: getattr(self, name) for name in self._columns}
        arrays |= {name: np.array(getattr(self, name), dtype="U") for name in _NAMES}
        with whole_file(path) as part, part.open("wb") as file:
            # uncompressed: ten seconds are 3 MB, and compressing them takes longer than rendering
            np.savez(file, format_version=FORMAT_VERSION, a_rate_Hz=self.a_rate_Hz, seed=self.seed, **arrays)

    @classmethod
    def of_rows(cls, rows: Records, a_m_s2: NDArray[np.float64], t_s: NDArray[np.float64], **more: Any) -> "Recording":
        """Make a recording of rows (n,) ROW, samples (n, block) and times (n,); `more` are the other fields."""
        found = {name: rows[name] for name in _COLUMNS if name in (rows.dtype.names or ())}
        columns: dict[str, Any] = {
            name: np.ascontiguousarray(values, _COLUMNS[name][0]) for name, values in found.items()
        }
        return cls(t_s=t_s, a_m_s2=a_m_s2, **columns, **more)

    @classmethod
    def load(cls, path: str | Path) -> "Recording":
        """Read a recording that `save` wrote. Safe for files from untrusted sources: no code in them is run.

        Raises:
            RecordingError: the file is missing, damaged, of a later version, or its arrays do not match.
        """
        path = Path(path)
        if not path.exists():
            raise RecordingError(f"{path}: no such file; expected a recording such as touch.npz")
        with refusing(RecordingError, path):
            try:
                if not path.is_file():
                    raise FormatError("is not a regular file")
                with open_npz(path, BYTES_MAX, "expected a shorter recording") as archive:
                    values = _read(archive)
            except RecordingError:
                raise
            except FormatError as error:
                raise RecordingError(f"cannot be read as a recording ({error}); expected touch.npz") from None
            return cls(**values)

    def save_csv(self, path: str | Path) -> None:
        """Write one row per tick as CSV, atomically. Columns are named after the arrays: p_WT_x_m, p_WT_y_m, …

        Bodies and swatches are written by name, empty without contact. a0_m_s2, a1_m_s2, … are the acceleration samples
        of the tick at a_rate_Hz. Numbers have nine digits.

        Raises:
            OSError: the folder is missing or cannot be written.
        """
        with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
            # in blocks: a number in a list takes five times the memory
            for start in range(0, max(len(self), 1), _CSV_ROWS):
                header, line, columns = self._csv(slice(start, start + _CSV_ROWS))
                if start == 0:
                    file.write(header)
                rows = zip(*columns, repeat(self.a_rate_Hz), strict=False)
                file.writelines(line % row for row in rows)

    def _csv(self, part: slice) -> tuple[str, str, list[list[object]]]:
        """Return the header line of the CSV, the format of the other lines, and the columns of a part of the ticks."""
        header: list[str] = []
        columns: list[list[object]] = []
        form: list[str] = []
        for name in self._columns:
            values = getattr(self, name)[part]
            if name in {"body", "swatch"}:
                # index −1 selects the last: empty
                names = [_quoted(text) for text in getattr(self, f"{name}_names")] + [""]
                parts, pattern = {name: [names[i] for i in values.tolist()]}, "%s"
            else:
                parts, pattern = _split(name, values), "%.9g" if values.dtype.kind == "f" else "%d"
            header += parts
            columns += parts.values()
            form += [pattern] * len(parts)
        return ",".join([*header, "a_rate_Hz"]) + "\n", ",".join([*form, "%.9g"]) + "\n", columns


def load_touch(path: str | Path) -> Recording:
    """Read a recording from a file that `save_touch` or `hapscene touch` wrote; see `Recording.load`."""
    return Recording.load(path)


def save_touch(recording: Recording, path: str | Path) -> None:
    """Write a recording as touch.npz; see `Recording.save`."""
    recording.save(path)


def _split(name: str, values: NDArray[np.generic]) -> dict[str, list[object]]:
    """Return the columns of one array by name: `p_WT_m` (n, 3) gives p_WT_x_m, p_WT_y_m, p_WT_z_m."""
    if values.ndim == 1:
        return {name: values.tolist()}
    if name == _MEASURED:
        return {f"{name}_{i}{j}": values[:, a, b].tolist() for a, i in enumerate("xyz") for b, j in enumerate("xyz")}
    if name == "a_m_s2":
        return {f"a{k}_m_s2": values[:, k].tolist() for k in range(values.shape[1])}
    stem, unit = (name, "") if name == "nhat_W" else name.rsplit("_", 1)
    return {"_".join(filter(None, (stem, axis, unit))): values[:, k].tolist() for k, axis in enumerate("xyz")}


def _quoted(text: str) -> str:
    """Return `text` as a CSV cell."""
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\r\n') else text


def _read(archive: Npz) -> dict[str, Any]:
    """Return the fields of a `Recording`; checks the header of every array before any data is read."""
    version = int(_array(archive, "format_version", "iu", 0))
    if version > FORMAT_VERSION:
        raise RecordingError(
            f"has format version {version}; this hapscene reads versions up to {FORMAT_VERSION}: update hapscene"
        )
    held = [name for name in _COLUMNS if version > 1 or name not in _SINCE_2]
    if _MEASURED not in archive.names:
        held.remove(_MEASURED)
    headers = {name: archive.header(name) for name in (*held, *_NAMES)}
    counts = {name: math.prod(shape) for name, (shape, _) in headers.items()}
    own_B = sum(counts[name] * dtype.itemsize for name, (_, dtype) in headers.items())
    needed_B = sum(counts[name] * np.dtype(kind).itemsize for name, (kind, _) in _COLUMNS.items() if name in held)
    needed_B += sum(counts[name] * (headers[name][1].itemsize + _NAME_B) for name in _NAMES)
    check_memory(own_B + needed_B, own_B, "its arrays", "expected a shorter recording")
    values: dict[str, Any] = {name: tuple(_array(archive, name, "U", 1).tolist()) for name in _NAMES}
    values |= {"a_rate_Hz": float(_array(archive, "a_rate_Hz", "f", 0)), "seed": int(_array(archive, "seed", "iu", 0))}
    for name in held:
        kind, row = _COLUMNS[name]
        dtype = np.dtype(kind)
        dimension_count = 2 if row is None else 1 + len(row)
        values[name] = _array(archive, name, dtype.kind, dimension_count).astype(dtype, copy=False)
    return values


def _array(archive: Npz, name: str, kinds: str, dimension_count: int) -> NDArray[np.generic]:
    """Return one array of the archive after a check of its type and dimensions."""
    shape, dtype = archive.header(name)
    if dtype.kind not in kinds or len(shape) != dimension_count:
        raise RecordingError(f"array {name} is {dtype} {shape}; expected kind {kinds}, {dimension_count} dimensions")
    return archive.read(name)
