"""Recordings of a tool on a surface: from a file's columns to streams in SI units.

Whatever a file does not state, its rate and its units, you give: the error names the argument and the option.
"""

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.capture.io.datasets import read_dataset
from hapscene.capture.io.formats import AXES, VALUE_MAX, RecordingSource, check_range, read_recording_source
from hapscene.capture.io.streams import ACCELERATION_MAX_M_S2, Array, direction_of, fill_missing, filtered, speed_of
from hapscene.errors import CaptureError, warn
from hapscene.io.files import check_memory, refusing
from hapscene.io.number_files import TOO_MUCH
from hapscene.io.wire.unit import UNITS

__all__ = ["WORDS", "BridgedWarning", "SurfaceRecording", "dft321", "load_recording", "one_axis", "rate_of"]

# DFT321: three axes of acceleration made one.
#
# A person feels the strength and the spectrum of a vibration, hardly its direction. DFT321 makes one signal whose
# spectrum has the summed power of the axes at each frequency (Landin, Romano, McMahan & Kuchenbecker 2010,
# "Dimensional Reduction of High-Frequency Accelerations for Haptic Rendering", EuroHaptics):
#
#     |A(f)|² = Σ_i |A_i(f)|²,   ∠A(f) = ∠ Σ_i A_i(f)

WINDOW_S: Final = 0.1
"""Window of `one_axis` [s]. Over a whole recording the method keeps the spectrum, but not the time of an event: each
frequency is scaled by a factor that jumps about, which spreads a tap over the recording. A window bounds that."""

CUTOFF_HZ: Final = 10.0
"""Lower frequencies are removed first [Hz]: gravity turns with the hand, and the sign of the sum flips with it. This
costs 0.03 dB at 20 Hz, where the band begins."""


def dft321(axes: Array) -> Array:
    """One signal (n,) of the axes (k, n), taken as a whole: of their summed power at each frequency, exactly."""
    spectra = np.fft.rfft(axes, axis=1)
    together = spectra.sum(axis=0)
    # where the axes cancel, the phase is undefined: use that of the strongest axis
    strongest = np.take_along_axis(spectra, np.abs(spectra).argmax(axis=0)[None], axis=0)[0]
    together = np.where(np.abs(together) <= 1e-9 * np.abs(strongest), strongest, together)
    size = np.abs(together)
    magnitude = np.sqrt((np.abs(spectra) ** 2).sum(axis=0))
    return np.asarray(np.fft.irfft(magnitude * together / np.where(size > 0.0, size, 1.0), axes.shape[1]))


def one_axis(axes: Array | list[Array], rate_Hz: float) -> Array:
    """One signal (n,) of one to three axes (k, n): DFT321 in windows, of each axis above `CUTOFF_HZ`.

    Windows of `WINDOW_S` overlap by half, weighted by the root of a Hann window before and after. Where the phases of
    two windows differ, the overlap loses power: each window's span is scaled so that the power over time stays that of
    the axes. One axis is returned as it is.

    Raises:
        CaptureError: no or more than three axes, or too short to be filtered.
    """
    if not 1 <= len(axes) <= 3 or axes[0].ndim != 1:
        raise CaptureError(f"acceleration must have one to three axes, its shape is {np.shape(axes)}")
    count = len(axes[0])
    if len(axes) == 1:
        return np.asarray(axes[0])
    if not (count >= WINDOW_S * rate_Hz and rate_Hz >= 4.0 * CUTOFF_HZ):
        raise CaptureError(f"three axes of {count} samples at {rate_Hz:g} Hz: at least {WINDOW_S:g} s are needed")
    hop = max(1, round(0.5 * WINDOW_S * rate_Hz))
    window_count = -(-count // hop) + 1
    padded = np.zeros((len(axes), (window_count + 1) * hop))
    for row, axis in zip(padded, axes, strict=True):
        row[hop : hop + count] = filtered(axis, rate_Hz, CUTOFF_HZ, "highpass")
    weight = np.sin(np.pi * (np.arange(2 * hop) + 0.5) / (2 * hop))  # the root of a Hann window
    made, hann = np.zeros(padded.shape[1]), weight**2
    windows = [slice(start, start + 2 * hop) for start in range(0, window_count * hop, hop)]
    for part in windows:
        made[part] += weight * dft321(weight * padded[:, part])
    gain = np.zeros(padded.shape[1])
    for part in windows:
        power = float((hann * made[part] ** 2).sum())
        gain[part] += hann * np.sqrt(float((hann * padded[:, part] ** 2).sum()) / power if power > 0.0 else 0.0)
    made *= gain
    return made[hop : hop + count]


QUATERNION: Final = "orientation"
"""The quantity of four columns, joined by "+" or named with _w, _x, _y, _z."""

VECTORS: Final = ("acceleration", "position", "tangential_force", "torque", QUATERNION)
"""Quantities that may have up to three columns, joined by "+" or named with _x, _y, _z; and `QUATERNION`."""

UNEVEN_MAX: Final = 0.1
"""Largest deviation of a time step from the mean one, in steps [1], at which a time column gives the rate."""

MISSING_MAX: Final = 0.01
"""Largest share of samples that may be missing [1]; they are interpolated linearly."""

_MORE_ROWS: Final = 2
"""Streams that are held at once beside those of a recording and the axes that are combined [count]."""


class BridgedWarning(UserWarning):
    """Samples were missing in a recording, and were interpolated linearly between their neighbours."""


WORDS: Final = {
    "force_N": "normal force",
    "speed_m_s": "speed",
    "tangential_force_N": "tangential force",
    "depth_m": "depth",
    "torque_Nm": "torque",
    "grip_force_N": "grip force",
    "contact_angle_rad": "contact angle",
    "direction_rad": "direction",
}
"""Names of the streams beside the acceleration, for messages."""


@dataclass(frozen=True)
class SurfaceRecording:
    """The streams of a file in SI units, (n,) each; None for those that it does not have.

    Three axes of acceleration are combined by DFT321. Positions give speed and direction, friction a tangential force,
    an orientation the contact angle; of a vector of tangential force or torque its magnitude is kept.
    """

    rate_Hz: float
    acceleration_m_s2: Array
    force_N: Array | None = None
    speed_m_s: Array | None = None
    tangential_force_N: Array | None = None
    depth_m: Array | None = None
    bridged: Mapping[str, int] = field(default_factory=dict)
    """number of missing samples of each column that were interpolated"""
    torque_Nm: Array | None = field(default=None, kw_only=True)
    grip_force_N: Array | None = field(default=None, kw_only=True)
    contact_angle_rad: Array | None = field(default=None, kw_only=True)
    """between the tool's axis and the surface's normal, 0 upright"""
    direction_rad: Array | None = field(default=None, kw_only=True)
    """of sliding over the surface"""

    def __repr__(self) -> str:
        held = ", ".join(name for name in WORDS if getattr(self, name) is not None) or "nothing"
        count, rate_Hz = len(self.acceleration_m_s2), self.rate_Hz
        return f"<SurfaceRecording: {count:,} samples, {count / rate_Hz:.3g} s at {rate_Hz:g} Hz, with {held}>"


def load_recording(
    path: str | os.PathLike[str],
    rate_Hz: float | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> SurfaceRecording:
    """Reads CSV, text, WAV, NPZ, MAT (to version 7), Parquet, or a probe's record (`hapscene.capture.io.formats`).

    A file that is named as in a published data set (`hapscene.capture.io.datasets`) is read with the other files of the
    same recording, unless `columns` are given.

    Args:
        path: the file. In text of one column, and in a WAV file of one or three channels, that is the acceleration.
        rate_Hz: sample rate, where the file does not state it.
        columns: which column holds which quantity of `UNITS`, as {"acceleration": "accel"}; by default the column of
            that name. Axes are joined by "+", as {"acceleration": "ax+ay+az"}.
        units: the unit of each quantity that is read, as {"acceleration": "g", "speed": "mm/s"}. A number before it
            scales: "98 m/s2" for a WAV file whose full scale is 98 m/s².

    Raises:
        CaptureError: no rate or unit given; a file that is missing, too large or not of numbers; an unknown column.

    Warns:
        BridgedWarning: some samples are missing, at most 1 % of a column; they are interpolated.
        CutWarning: a probe's record has no end chunk: it may have been longer.
    """
    path = Path(path)
    source = (None if columns else read_dataset(path)) or read_recording_source(path)
    with refusing(CaptureError, path):
        chosen = _choose(list(source.columns), columns or {}, wave=path.suffix.lower() == ".wav")
        reader = _Reader(source, chosen, units or {})
        axes = max(len(names) for names in chosen.values())
        count, own_B = len(next(iter(source.columns.values()))), source.own_B
        needed_B = sum(column.nbytes for column in source.columns.values())
        needed_B += 8 * count * (len(chosen) + axes + _MORE_ROWS + ("position" in chosen))
        check_memory(needed_B, own_B, f"its {count:,} samples", TOO_MUCH)
        rate = rate_of(rate_Hz, source, reader.rows("time")[0] if "time" in chosen else None)
        recording = _assembled(rate, chosen, reader)
    if reader.bridged:
        listed = ", ".join(f"{missing} of {name}" for name, missing in reader.bridged.items())
        warn(f"{path}: missing samples interpolated: {listed}", BridgedWarning)
    return recording


class _Reader:
    """Gives the columns of a quantity in SI units.

    Attributes:
        bridged: number of missing samples of each column that were interpolated.
    """

    def __init__(self, source: RecordingSource, chosen: Mapping[str, list[str]], units: Mapping[str, str]) -> None:
        self._source, self._chosen = source, chosen
        self._scales = {quantity: _scale(quantity, names, units, source.units) for quantity, names in chosen.items()}
        self.bridged: dict[str, int] = {}

    def rows(self, quantity: str) -> list[Array]:
        """The columns of a quantity (k, n).

        Raises:
            CaptureError: a value is infinite or too large, or more than `MISSING_MAX` of the samples are missing.
        """
        made = []
        scale = self._source.scale * self._scales[quantity]
        most = ACCELERATION_MAX_M_S2 if quantity == "acceleration" else VALUE_MAX
        for name in self._chosen[quantity]:
            with np.errstate(invalid="ignore"):  # a signalling NaN is a missing sample too
                made.append(np.array(self._source.columns[name], np.float64))
            check_range(name, made[-1], scale, most)
            share = np.count_nonzero(np.isnan(made[-1])) / len(made[-1])
            if share > MISSING_MAX:
                allowed = f"at most {100 * MISSING_MAX:g} % may be"
                raise CaptureError(f"{name}: {100 * share:.1f} % of the samples are missing, {allowed}")
            if missing := fill_missing(made[-1]):
                self.bridged[name] = missing
            made[-1] *= scale
        return made


def _assembled(rate_Hz: float, chosen: Iterable[str], reader: _Reader) -> SurfaceRecording:
    """The recording, one quantity after the other."""
    single = {name: reader.rows(name)[0] for name in _SINGLE if name in chosen}
    force, speed, angle = (single.get(name) for name in ("force", "speed", "contact_angle"))
    direction, tangential, torque = single.get("direction"), None, None
    if "position" in chosen and (speed is None or direction is None):
        place = reader.rows("position")
        speed = speed_of(place, rate_Hz) if speed is None else speed
        if direction is None and len(place) > 1:
            direction = direction_of(place[0], place[1], rate_Hz)
    if angle is None and QUATERNION in chosen:
        angle = tilt(reader.rows(QUATERNION))
    if "torque" in chosen:
        torque = _magnitude(reader.rows("torque"))
    if "tangential_force" in chosen:
        tangential = _magnitude(reader.rows("tangential_force"))
    elif "friction" in single and force is not None:
        tangential = single["friction"] * force
    return SurfaceRecording(
        rate_Hz,
        one_axis(reader.rows("acceleration"), rate_Hz),
        force,
        speed,
        tangential,
        single.get("depth"),
        bridged=reader.bridged,
        torque_Nm=torque,
        grip_force_N=single.get("grip_force"),
        contact_angle_rad=angle,
        direction_rad=direction,
    )


_SINGLE: Final = ("force", "speed", "friction", "depth", "grip_force", "contact_angle", "direction")


def _magnitude(axes: list[Array]) -> Array:
    """Magnitude (n,) of a vector's axes; one axis as it is."""
    return axes[0] if len(axes) == 1 else np.asarray(np.sqrt(sum(axis**2 for axis in axes)))


def tilt(quaternion: list[Array]) -> Array:
    """Angle (n,) [rad] between the z-axes before and after a turn by w, x, y, z (n,) each, from 0 to π/2.

    Raises:
        CaptureError: a quaternion of length 0.
    """
    square = sum(part**2 for part in quaternion)
    if not np.all(np.asarray(square) > 0.0):
        raise CaptureError("orientation: a quaternion of four zeros is invalid")
    _, x, y, _ = quaternion
    return np.asarray(np.arccos(np.minimum(np.abs(1.0 - 2.0 * (x**2 + y**2) / square), 1.0)))


def rate_of(given_Hz: float | None, source: RecordingSource, time_s: Array | None) -> float:
    """The given rate, else the file's own, else that of its column of times."""
    if given_Hz is not None:
        return float(given_Hz)
    if source.rate_Hz is not None:
        return source.rate_Hz
    if time_s is not None:
        step_s = np.diff(time_s)
        mean_s = float(step_s.mean()) if len(step_s) else 0.0
        if not (mean_s > 0.0 and np.all(np.abs(step_s - mean_s) <= UNEVEN_MAX * mean_s)):
            raise CaptureError("its times are not evenly spaced: resample it, or give rate_Hz=… (--rate HZ)")
        return 1.0 / mean_s
    raise CaptureError("the file does not state its sample rate: give rate_Hz=… (--rate HZ)")


def _choose(names: list[str], columns: Mapping[str, str], wave: bool) -> dict[str, list[str]]:
    """Quantity to columns, for the quantities that the file has."""
    chosen: dict[str, list[str]] = {}
    for quantity, column in columns.items():
        if quantity not in UNITS:
            raise CaptureError(f"no quantity {quantity!r} in columns; there are: {', '.join(UNITS)}")
        parts = [column] if column in names else [part.strip() for part in column.split("+")]
        for part in parts:
            if part not in names:
                raise CaptureError(f"no column {part!r}; there are: {', '.join(names)}")
        chosen[quantity] = parts
    for quantity in UNITS.keys() - chosen.keys():
        axes = [f"{quantity}_{axis}" for axis in _axes(quantity) if f"{quantity}_{axis}" in names]
        if quantity in names or axes:
            chosen[quantity] = [quantity] if quantity in names else axes
    for quantity, parts in chosen.items():
        if len(parts) > max(1, len(_axes(quantity))) or (quantity == QUATERNION and len(parts) < 4):
            most = "at most three columns" if quantity in VECTORS else "one column"
            most = "four columns: w, x, y, z" if quantity == QUATERNION else most
            raise CaptureError(f"{quantity} has {most}, {'+'.join(parts)!r} names {len(parts)}")
    numbered = names in (["1"], ["1", "2", "3"] if wave else [])
    if "acceleration" not in chosen and numbered:
        chosen["acceleration"] = names
    if "acceleration" not in chosen:
        example = _likely(names, chosen)
        raise CaptureError(
            f'no column "acceleration"; there are: {", ".join(names)}: '
            f'give columns={{"acceleration": "{example}"}} (--columns acceleration={example})'
        )
    return {quantity: chosen[quantity] for quantity in UNITS if quantity in chosen}


def _axes(quantity: str) -> tuple[str, ...]:
    """Suffixes of the columns of a vector quantity; empty for a scalar."""
    return ("w", *AXES) if quantity == QUATERNION else AXES if quantity in VECTORS else ()


def _likely(names: list[str], chosen: Mapping[str, list[str]]) -> str:
    """The column that most likely is the acceleration: an unused one that begins with "acc" or "a"."""
    taken = {name for parts in chosen.values() for name in parts}
    free = [name for name in names if name not in taken] or ["COLUMN"]
    return next(name for start in ("acc", "a", "") for name in free if name.casefold().startswith(start))


def _scale(quantity: str, names: list[str], given: Mapping[str, str], own: Mapping[str, str]) -> float:
    """Factor from the file's numbers to SI, by the given unit, else by the file's own for the column."""
    known = ", ".join(UNITS[quantity])
    unknown = [name for name in given if name not in UNITS]
    if unknown:
        raise CaptureError(f"no quantity {unknown[0]!r} in units; there are: {', '.join(UNITS)}")
    unit = given.get(quantity) or own.get(names[0]) or {"friction": "1", "time": "s", QUATERNION: "1"}.get(quantity)
    if unit is None:
        example = next(iter(UNITS[quantity]))
        raise CaptureError(
            f"the unit of {quantity} (column {'+'.join(names)!r}) is not known: give "
            f'units={{"{quantity}": "{example}"}} (--units {quantity}={example}); known are {known}'
        )
    if unit in UNITS[quantity]:
        return UNITS[quantity][unit]
    match = re.fullmatch(r"([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*\*?\s*(\S+)", unit)
    if match is None or match[2] not in UNITS[quantity] or not 0.0 < float(match[1]) < float("inf"):
        raise CaptureError(f"no unit {unit!r} of {quantity}; there are: {known}")
    return float(match[1]) * UNITS[quantity][match[2]]
