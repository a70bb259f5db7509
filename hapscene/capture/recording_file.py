"""Recordings of a tool on a surface, read from text: CSV with a header, or one value a line."""

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError

Array = NDArray[np.float64]

BYTES_MAX: Final = 1 << 30
"""Largest file that is opened [bytes]: 20 minutes of four columns at 10 kHz."""

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "acceleration": {"m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "g": 9.80665, "mm/s2": 1e-3},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "force": {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3},
    "tangential_force": {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3},
    "friction": {"1": 1.0},
}
"""What one of each unit is in SI, for each quantity that a column may hold. "friction" is tangential over normal."""


@dataclass(frozen=True)
class SurfaceRecording:
    """The streams of a file in SI units, (n,) each; None for those that it does not have."""

    rate_Hz: float
    acceleration_m_s2: Array
    force_N: Array | None
    speed_m_s: Array | None
    tangential_force_N: Array | None


def load_surface_recording(
    path: str | os.PathLike[str],
    rate_Hz: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> SurfaceRecording:
    """Reads a text file of numbers.

    Args:
        path: CSV with a header line; or no header and one value a line: then that is the acceleration.
        rate_Hz: sample rate; such files do not say it.
        columns: which column holds which quantity of `UNITS`, as {"acceleration": "accel"}; by default the column of
            that name.
        units: the unit of each quantity that is read, as {"acceleration": "g", "speed": "mm/s"}.

    Raises:
        CaptureError: no rate or unit given; a file that is missing, too large or not of numbers; an unknown column.
    """
    file = Path(path)
    if rate_Hz is None:
        raise CaptureError(f"{file}: the file does not say its sample rate: give rate_Hz=…")
    table = _read(file)
    chosen = _choose(file, list(table), dict(columns or {}))
    streams = {}
    for quantity, column in chosen.items():
        unit = (units or {}).get(quantity) or ("1" if quantity == "friction" else None)
        if unit is None:
            known = ", ".join(UNITS[quantity])
            example = next(iter(UNITS[quantity]))
            raise CaptureError(
                f"{file}: the unit of {quantity} (column {column!r}) is not known: "
                f'give units={{"{quantity}": "{example}"}}; known are {known}'
            )
        if unit not in UNITS[quantity]:
            raise CaptureError(f"{file}: no unit {unit!r} of {quantity}; there are: {', '.join(UNITS[quantity])}")
        streams[quantity] = UNITS[quantity][unit] * table[column]
    tangential = streams.get("tangential_force")
    if tangential is None and "friction" in streams and "force" in streams:
        tangential = streams["friction"] * streams["force"]
    return SurfaceRecording(
        float(rate_Hz), streams["acceleration"], streams.get("force"), streams.get("speed"), tangential
    )


def _choose(file: Path, names: list[str], columns: dict[str, str]) -> dict[str, str]:
    """Quantity to column, for the quantities that the file has."""
    for quantity, column in columns.items():
        if quantity not in UNITS:
            raise CaptureError(f"{file}: no quantity {quantity!r} in columns; there are: {', '.join(UNITS)}")
        if column not in names:
            raise CaptureError(f"{file}: no column {column!r}; there are: {', '.join(names)}")
    chosen = {quantity: columns.get(quantity, quantity) for quantity in UNITS}
    chosen = {quantity: column for quantity, column in chosen.items() if column in names}
    if "acceleration" not in chosen:
        raise CaptureError(
            f'{file}: no column "acceleration"; there are: {", ".join(names)}: '
            f'give columns={{"acceleration": "{names[0]}"}}'
        )
    return chosen


def _read(file: Path) -> dict[str, Array]:
    """Columns of the file by name; a file without a header has the one column "acceleration"."""
    try:
        if file.stat().st_size > BYTES_MAX:
            raise CaptureError(f"{file}: larger than {BYTES_MAX >> 20} MiB")
        with file.open(encoding="utf-8-sig") as f:
            first = f.readline()
    except OSError as error:
        raise CaptureError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise CaptureError(f"{file}: not a text file") from None
    names = [name.strip().strip('"') for name in first.strip().split(",")]
    header = not _is_number(names[0])
    if not first.strip() or (not header and len(names) > 1):
        raise CaptureError(f"{file}: must begin with a header of column names, or hold one number a line")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "no data", which is told below
            table = np.loadtxt(file, delimiter=",", skiprows=int(header), ndmin=2, encoding="utf-8-sig")
    except (ValueError, UnicodeDecodeError) as error:
        raise CaptureError(f"{file}: not a table of numbers: {error}") from None
    if not header:
        names = ["acceleration"]
    if len(table) == 0 or table.shape[1] != len(names):
        raise CaptureError(f"{file}: {len(names)} columns expected, {table.shape[1] if len(table) else 0} found")
    return dict(zip(names, table.T.copy(), strict=True))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
