"""Recordings of a tool on a surface: maps the columns of a file to quantities in SI units.

If the file does not state its sample rate or a unit, the caller must give them; the error names the argument and the
command-line option.
"""

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.capture.io.formats import AXES, VALUE_MAX, RecordingSource, check_range, read_recording_source
from hapscene.capture.io.streams import ACCELERATION_MAX_M_S2, Array, direction_of, fill_missing, filtered, speed_of
from hapscene.errors import CaptureError, warn
from hapscene.io.files import check_memory, refusing
from hapscene.io.number_files import TOO_MUCH
from hapscene.io.probe_protocol import UNITS

__all__ = ["WORDS", "InterpolatedWarning", "SurfaceRecording", "load_recording", "rate_of"]

# DFT321 combines three axes of acceleration into one signal.
#
# People perceive the strength and the spectrum of a vibration, but hardly its direction. The power of the combined
# signal at each frequency is the sum of the powers of the axes (Landin, Romano, McMahan & Kuchenbecker 2010,
# "Dimensional Reduction of High-Frequency Accelerations for Haptic Rendering", EuroHaptics):
#
#     |A(f)|² = Σ_i |A_i(f)|²,   ∠A(f) = ∠ Σ_i A_i(f)

WINDOW_S: Final = 0.1
"""Window of `one_axis` [s]. DFT321 changes the phase at each frequency, which spreads an event such as a tap in time. A
short window limits the spread."""

CUTOFF_HZ: Final = 10.0
"""Cut-off of the high-pass on each axis [Hz]. It removes gravity, whose direction changes as the hand turns the sensor.
It attenuates the lower end of the band, 20 Hz, by 0.03 dB."""


def dft321(axes: Array) -> Array:
    """Combines axes (k, n) into one signal (n,) whose power at each frequency is the sum over the axes."""
    spectra = np.fft.rfft(axes, axis=1)
    together = spectra.sum(axis=0)
    # where the axes cancel, the phase of their sum is undefined: use the phase of the strongest axis
    strongest = np.take_along_axis(spectra, np.abs(spectra).argmax(axis=0)[None], axis=0)[0]
    together = np.where(np.abs(together) <= 1e-9 * np.abs(strongest), strongest, together)
    size = np.abs(together)
    magnitude = np.sqrt((np.abs(spectra) ** 2).sum(axis=0))
    return np.asarray(np.fft.irfft(magnitude * together / np.where(size > 0.0, size, 1.0), axes.shape[1]))


def one_axis(axes: Array | list[Array], rate_Hz: float) -> Array:
    """Combines one to three axes (k, n) into one signal (n,) by DFT321 in overlapping windows.

    The axes are high-pass filtered at `CUTOFF_HZ`. The windows, `WINDOW_S` long, overlap by half and are weighted with
    the square root of a Hann window before and after the transform. Overlapping windows with different phases lose
    power, so a slowly varying gain restores the power over time. A single axis is returned unchanged.

    Raises:
        CaptureError: there are no or more than three axes, or they are too short to be filtered.
    """
    if not 1 <= len(axes) <= 3 or axes[0].ndim != 1:
        raise CaptureError(f"invalid shape {np.shape(axes)} of the acceleration; expected one to three axes")
    count = len(axes[0])
    if len(axes) == 1:
        return np.asarray(axes[0])
    if not (count >= WINDOW_S * rate_Hz and rate_Hz >= 4.0 * CUTOFF_HZ):
        raise CaptureError(
            f"{count} samples at {rate_Hz:g} Hz are too few to combine three axes; expected at least {WINDOW_S:g} s"
        )
    hop = round(0.5 * WINDOW_S * rate_Hz)
    window_count = -(-count // hop) + 1
    padded = np.zeros((len(axes), (window_count + 1) * hop))
    for row, axis in zip(padded, axes, strict=True):
        row[hop : hop + count] = filtered(axis, rate_Hz, CUTOFF_HZ, "highpass")
    weight = np.sin(np.pi * (np.arange(2 * hop) + 0.5) / (2 * hop))  # square root of a Hann window
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


VECTORS: Final = ("acceleration", "position", "tangential_force", "torque")
"""Quantities with up to three columns, joined by "+" or with the suffixes _x, _y, _z."""

UNEVEN_MAX: Final = 0.1
"""Largest relative deviation of a time step from the mean step for times to count as evenly spaced [1]."""

MISSING_MAX: Final = 0.01
"""Largest fraction of samples that may be missing [1]; missing samples are interpolated linearly."""

_EXTRA_STREAMS: Final = 2
"""Temporary streams that are in memory in addition to the recording and the axes that are combined."""


class InterpolatedWarning(UserWarning):
    """Samples were missing in a recording and were interpolated linearly."""


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
"""Names of the streams other than the acceleration, for messages."""


@dataclass(frozen=True)
class SurfaceRecording:
    """A recording of a tool on a surface: streams in SI units, (n,) each; None for streams that were not recorded.

    `load_recording` combines three axes of acceleration by DFT321, and computes speed and direction from positions and
    the tangential force from a friction ratio. Tangential force and torque are magnitudes.
    """

    rate_Hz: float
    acceleration_m_s2: Array
    force_N: Array | None = None
    speed_m_s: Array | None = None
    tangential_force_N: Array | None = None
    depth_m: Array | None = None
    torque_Nm: Array | None = field(default=None, kw_only=True)
    grip_force_N: Array | None = field(default=None, kw_only=True)
    contact_angle_rad: Array | None = field(default=None, kw_only=True)
    """angle between the axis of the tool and the surface normal; 0 if the tool is upright"""
    direction_rad: Array | None = field(default=None, kw_only=True)
    """direction of sliding"""


def load_recording(
    path: str | os.PathLike[str],
    rate_Hz: float | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> SurfaceRecording:
    """Reads a recording from a CSV, text, WAV, NPZ, MAT (up to version 7) or .hsrec file.

    Args:
        path: the file. A text file with one column and a WAV file with one or three channels hold the acceleration.
        rate_Hz: sample rate, if the file does not state it.
        columns: column of each quantity, for example {"acceleration": "accel"}; by default the column with the name of
            the quantity. Axes are joined by "+": {"acceleration": "ax+ay+az"}.
        units: unit of each quantity, for example {"acceleration": "g", "speed": "mm/s"}. A number before the unit
            scales: "98 m/s2" for a WAV file whose full scale is 98 m/s².

    Raises:
        CaptureError: the sample rate or a unit is unknown; the file is missing, too large or contains no numbers; a
            column does not exist.

    Warns:
        InterpolatedWarning: some samples are missing, at most 1 % of a column; they are interpolated.
        TruncatedWarning: the record of a probe has no end chunk and may be truncated.
    """
    path = Path(path)
    source = read_recording_source(path)
    with refusing(CaptureError, path):
        chosen = _choose(list(source.columns), columns or {}, wave=path.suffix.lower() == ".wav")
        reader = _Reader(source, chosen, units or {})
        axes = max(len(names) for names in chosen.values())
        count, own_B = len(next(iter(source.columns.values()))), source.own_B
        needed_B = sum(column.nbytes for column in source.columns.values())
        needed_B += 8 * count * (len(chosen) + axes + _EXTRA_STREAMS + ("position" in chosen))
        check_memory(needed_B, own_B, f"a recording of {count:,} samples", TOO_MUCH)
        rate = rate_of(rate_Hz, source, reader.rows("time")[0] if "time" in chosen else None)
        recording = _assembled(rate, chosen, reader)
    if reader.bridged:
        listed = ", ".join(f"{missing} of {name}" for name, missing in reader.bridged.items())
        warn(f"{path}: missing samples interpolated: {listed}", InterpolatedWarning)
    return recording


class _Reader:
    """Reads the columns of a quantity in SI units.

    Attributes:
        bridged: number of interpolated samples in each column that had missing samples.
    """

    def __init__(self, source: RecordingSource, chosen: Mapping[str, list[str]], units: Mapping[str, str]) -> None:
        self._source, self._chosen = source, chosen
        self._scales = {quantity: _scale(quantity, names, units, source.units) for quantity, names in chosen.items()}
        self.bridged: dict[str, int] = {}

    def rows(self, quantity: str) -> list[Array]:
        """Columns (k, n) of a quantity.

        Raises:
            CaptureError: a value is infinite or too large, or more than `MISSING_MAX` of the samples are missing.
        """
        made = []
        scale = self._source.scale * self._scales[quantity]
        most = ACCELERATION_MAX_M_S2 if quantity == "acceleration" else VALUE_MAX
        for name in self._chosen[quantity]:
            with np.errstate(invalid="ignore"):  # a signalling NaN also marks a missing sample
                made.append(np.array(self._source.columns[name], np.float64))
            check_range(name, made[-1], scale, most)
            share = np.count_nonzero(np.isnan(made[-1])) / len(made[-1])
            if share > MISSING_MAX:
                allowed = f"at most {100 * MISSING_MAX:g} % can be interpolated"
                raise CaptureError(f"column {name!r}: {100 * share:.1f} % of the samples are missing; {allowed}")
            if missing := fill_missing(made[-1]):
                self.bridged[name] = missing
            made[-1] *= scale
        return made


def _assembled(rate_Hz: float, chosen: Iterable[str], reader: _Reader) -> SurfaceRecording:
    """Computes the streams of the recording from the chosen quantities."""
    single = {name: reader.rows(name)[0] for name in _SINGLE if name in chosen}
    force, speed, direction = (single.get(name) for name in ("force", "speed", "direction"))
    tangential = torque = None
    if "position" in chosen and (speed is None or direction is None):
        place = reader.rows("position")
        speed = speed_of(place, rate_Hz) if speed is None else speed
        if direction is None and len(place) > 1:
            direction = direction_of(place[0], place[1], rate_Hz)
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
        torque_Nm=torque,
        grip_force_N=single.get("grip_force"),
        contact_angle_rad=single.get("contact_angle"),
        direction_rad=direction,
    )


_SINGLE: Final = ("force", "speed", "friction", "depth", "grip_force", "contact_angle", "direction")


def _magnitude(axes: list[Array]) -> Array:
    """Magnitude (n,) of the axes of a vector; a single axis is returned unchanged."""
    return axes[0] if len(axes) == 1 else np.asarray(np.sqrt(sum(axis**2 for axis in axes)))


def rate_of(given_Hz: float | None, source: RecordingSource, time_s: Array | None) -> float:
    """Return the given sample rate; by default the rate in the file, or the rate of its time column."""
    if given_Hz is not None:
        return float(given_Hz)
    if source.rate_Hz is not None:
        return source.rate_Hz
    if time_s is not None:
        step_s = np.diff(time_s)
        mean_s = float(step_s.mean()) if len(step_s) else 0.0
        if not (mean_s > 0.0 and np.all(np.abs(step_s - mean_s) <= UNEVEN_MAX * mean_s)):
            raise CaptureError(
                "column 'time' is not evenly spaced: resample the recording, or give rate_Hz=… (--rate HZ)"
            )
        return 1.0 / mean_s
    raise CaptureError("the sample rate is unknown: give rate_Hz=… (--rate HZ)")


def _choose(names: list[str], columns: Mapping[str, str], wave: bool) -> dict[str, list[str]]:
    """Names of the columns of each quantity in the file."""
    chosen: dict[str, list[str]] = {}
    for quantity, column in columns.items():
        if quantity not in UNITS:
            raise CaptureError(f"unknown quantity {quantity!r} in columns; expected one of: {', '.join(UNITS)}")
        parts = [column] if column in names else [part.strip() for part in column.split("+")]
        for part in parts:
            if part not in names:
                raise CaptureError(f"no column {part!r}; the file has: {', '.join(names)}")
        chosen[quantity] = parts
    for quantity in UNITS.keys() - chosen.keys():
        axes = [f"{quantity}_{axis}" for axis in AXES if quantity in VECTORS and f"{quantity}_{axis}" in names]
        if quantity in names or axes:
            chosen[quantity] = [quantity] if quantity in names else axes
    for quantity, parts in chosen.items():
        if len(parts) > (3 if quantity in VECTORS else 1):
            expected = "at most three columns" if quantity in VECTORS else "one column"
            raise CaptureError(f"{quantity}: {'+'.join(parts)!r} names {len(parts)} columns; expected {expected}")
    numbered = names in (["1"], ["1", "2", "3"] if wave else [])
    if "acceleration" not in chosen and numbered:
        chosen["acceleration"] = names
    if "acceleration" not in chosen:
        raise CaptureError(
            f'no column "acceleration"; the file has: {", ".join(names)}: '
            'give columns={"acceleration": "COLUMN"} (--columns acceleration=COLUMN)'
        )
    return {quantity: chosen[quantity] for quantity in UNITS if quantity in chosen}


def _scale(quantity: str, names: list[str], given: Mapping[str, str], own: Mapping[str, str]) -> float:
    """Factor that converts a quantity to SI, from the given unit or else from the unit that the file states."""
    known = ", ".join(UNITS[quantity])
    unknown = [name for name in given if name not in UNITS]
    if unknown:
        raise CaptureError(f"unknown quantity {unknown[0]!r} in units; expected one of: {', '.join(UNITS)}")
    unit = given.get(quantity) or own.get(names[0]) or {"friction": "1", "time": "s"}.get(quantity)
    if unit is None:
        example = next(iter(UNITS[quantity]))
        raise CaptureError(
            f"the unit of {quantity} (column {'+'.join(names)!r}) is unknown: give "
            f'units={{"{quantity}": "{example}"}} (--units {quantity}={example}); known units: {known}'
        )
    if unit in UNITS[quantity]:
        return UNITS[quantity][unit]
    match = re.fullmatch(r"([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*\*?\s*(\S+)", unit)
    if match is None or match[2] not in UNITS[quantity] or not 0.0 < float(match[1]) < float("inf"):
        raise CaptureError(f"unknown unit {unit!r} of {quantity}; known units: {known}")
    return float(match[1]) * UNITS[quantity][match[2]]
