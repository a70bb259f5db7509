"""Recordings of a tool on a surface: from a file's columns to streams in SI units.

What a file does not say is asked for: the message names the argument, and the option of the command line.
"""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.capture.published_layouts import read_layout, recognised
from hapscene.capture.recording_source import AXES, RecordingSource, read_recording_source
from hapscene.capture.streams import Array, direction_of, filtered, speed_of
from hapscene.errors import CaptureError, warn
from hapscene.files import check_memory, refusing
from hapscene.number_files import TOO_MUCH
from hapscene.wire.unit import UNITS

# Three axes of acceleration made one: DFT321.
#
# A person feels the strength and the spectrum of a vibration, hardly its direction. DFT321 makes one signal whose
# spectrum has the summed power of the axes at each frequency (Landin, Romano, McMahan & Kuchenbecker 2010,
# "Dimensional Reduction of High-Frequency Accelerations for Haptic Rendering", EuroHaptics):
#
#     |A(f)|² = Σ_i |A_i(f)|²,   ∠A(f) = ∠ Σ_i A_i(f)


WINDOW_S: Final = 0.1
"""Window of `one_axis` [s]. Over a whole recording the method keeps the spectrum, but not when what happened: each
frequency is scaled by a factor that jumps about, which spreads a tap over the recording. A window bounds that."""

CUTOFF_HZ: Final = 10.0
"""What is below is taken out first [Hz]: gravity turns with the hand, and the sign of the sum flips with it. It takes
0.03 dB at 20 Hz, where the band begins."""


def dft321(axes: Array) -> Array:
    """One signal (n,) of the axes (k, n), taken as a whole: of their summed power at each frequency, exactly."""
    spectra = np.fft.rfft(axes, axis=1)
    together = spectra.sum(axis=0)
    # where the axes cancel the phase is open: that of the strongest axis is as good as any
    strongest = np.take_along_axis(spectra, np.abs(spectra).argmax(axis=0)[None], axis=0)[0]
    together = np.where(np.abs(together) <= 1e-9 * np.abs(strongest), strongest, together)
    size = np.abs(together)
    magnitude = np.sqrt((np.abs(spectra) ** 2).sum(axis=0))
    return np.asarray(np.fft.irfft(magnitude * together / np.where(size > 0.0, size, 1.0), axes.shape[1]))


def one_axis(axes: Array | list[Array], rate_Hz: float) -> Array:
    """One signal (n,) of one to three axes (k, n): DFT321 in windows, of what each axis has above `CUTOFF_HZ`.

    Windows of `WINDOW_S`, half overlapped, weighted by the root of a Hann window before and after. What overlaps adds
    up short of its power where the phases of two windows differ: each window's span gets that back, so that the power
    over time stays that of the axes. One axis is passed through as it is. A list is emptied meanwhile.

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
    axes = axes if isinstance(axes, list) else list(axes)
    for row in padded:
        row[hop : hop + count] = filtered(axes.pop(0), rate_Hz, CUTOFF_HZ, "highpass")
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
"""Largest share of samples that a probe may have dropped [1]: what lies between is bridged by straight lines."""

_MORE_ROWS: Final = 2
"""How many streams are held at once beside those of a recording and the axes that are being made one [count]."""


class BridgedWarning(UserWarning):
    """Samples were missing in a recording, and were put on straight lines between their neighbours."""


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
"""What the streams beside the acceleration are called."""


@dataclass(frozen=True)
class SurfaceRecording:
    """The streams of a file in SI units, (n,) each; None for those that it does not have.

    Three axes of acceleration are made one by DFT321, positions a speed and a direction; tangential forces and friction
    are a force, torques their size, an orientation a contact angle.
    """

    rate_Hz: float
    acceleration_m_s2: Array
    force_N: Array | None = None
    speed_m_s: Array | None = None
    tangential_force_N: Array | None = None
    depth_m: Array | None = None
    bridged: Mapping[str, int] = field(default_factory=dict)
    """how many missing samples of a column were put on straight lines"""
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
    layout: str | None = None,
) -> SurfaceRecording:
    """Reads CSV, plain text, WAV, NPZ, MAT (to version 7), or a probe's record (`hapscene.capture.recording_source`).

    Args:
        path: the file. In text of one column, and in a WAV file of one or three channels, that is the acceleration.
        rate_Hz: sample rate, where the file does not say it.
        columns: which column holds which quantity of `UNITS`, as {"acceleration": "accel"}; by default the column of
            that name. Axes are joined by "+", as {"acceleration": "ax+ay+az"}, or named one by one, as
            {"acceleration_x": "ax", "acceleration_y": "ay", "acceleration_z": "az"}.
        units: the unit of each quantity that is read, as {"acceleration": "g", "speed": "mm/s"}. A number before it
            scales: "98 m/s2" for a WAV file whose full scale is 98 m/s².
        layout: that of a published data set (`hapscene.capture.published_layouts`), of which `path` is a file or a
            surface; by default as the file is called, where no other file is called so, and `columns` are not given.

    Raises:
        CaptureError: no rate or unit given; a file that is missing, too large or not of numbers; an unknown column.

    Warns:
        BridgedWarning: some samples are missing, at most 1 % of a column; they are put on straight lines.
        CutWarning: a record of a probe ends without the word of its end: it may have been longer.
    """
    recording = read_surface_recording(path, rate_Hz, columns, units, layout)
    if recording.bridged:
        warn(f"{path}: {bridged_note(recording)}", BridgedWarning)
    return recording


def bridged_note(recording: SurfaceRecording) -> str:
    """How many samples of which columns were missing, in words; empty where none was."""
    said = ", ".join(f"{count} of {name}" for name, count in recording.bridged.items())
    return f"missing samples bridged by straight lines: {said}" if said else ""


def read_surface_recording(
    path: str | os.PathLike[str],
    rate_Hz: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    layout: str | None = None,
) -> SurfaceRecording:
    """As `load_recording`, without its warning: `bridged` of the recording says the same.

    Raises:
        CaptureError: as there.
    """
    if layout is None and not columns:
        layout = recognised(Path(path))
    source = read_recording_source(Path(path)) if layout is None else read_layout(Path(path), layout)
    with refusing(CaptureError, path):
        chosen = _choose(list(source.columns), columns or {}, wave=Path(path).suffix.lower() == ".wav")
        scales = {quantity: _scale(quantity, names, units or {}, source.units) for quantity, names in chosen.items()}
        bridged: dict[str, int] = {}
        held = {name: source.columns[name] for names in chosen.values() for name in names}
        count, own_B = len(next(iter(held.values()))), source.own_B
        source = replace(source, columns={})  # each is let go once it is used
        uses = Counter(name for names in chosen.values() for name in names)

        def rows(quantity: str) -> list[Array]:
            """The columns of a quantity (k, n) in SI units."""
            made = []
            for name in chosen[quantity]:
                uses[name] -= 1
                with np.errstate(invalid="ignore"):  # a NaN that signals is one
                    made.append(np.array(held[name] if uses[name] else held.pop(name), np.float64))
                if missing := bridge(made[-1], name):
                    bridged[name] = missing
                made[-1] *= source.scale * scales[quantity]
            return made

        axes = max(len(names) for names in chosen.values())
        kept_B = sum(column.nbytes for column in held.values() if column.base is not None)
        needed_B = kept_B + 8 * count * (len(chosen) + axes + _MORE_ROWS + ("position" in chosen))
        check_memory(needed_B, own_B, f"its {count:,} samples", TOO_MUCH)
        rate = rate_of(rate_Hz, source, rows("time")[0] if "time" in chosen else None)
        recording = _assembled(rate, chosen, rows)
    return replace(recording, bridged=bridged)


def bridge(stream: Array, name: str) -> int:
    """Put samples that are NaN, dropped by the probe, on straight lines between their neighbours; how many there were.

    Raises:
        CaptureError: more than `MISSING_MAX` of them.
    """
    missing = np.isnan(stream)
    count = int(np.count_nonzero(missing))
    if count > MISSING_MAX * len(stream):
        most = f"at most {100 * MISSING_MAX:g} % may be"
        raise CaptureError(f"{name}: {100 * count / len(stream):.1f} % of the samples are missing, {most}")
    if count:
        beside = np.zeros_like(missing)
        beside[:-1] |= missing[1:]
        beside[1:] |= missing[:-1]
        known = np.flatnonzero(beside & ~missing)
        gaps = np.flatnonzero(missing)
        stream[gaps] = np.interp(gaps, known, stream[known])
    return count


def _assembled(rate_Hz: float, chosen: Iterable[str], rows: Callable[[str], list[Array]]) -> SurfaceRecording:
    """The recording, each quantity made one stream before the next is taken up."""
    single = {name: rows(name)[0] for name in _SINGLE if name in chosen}
    force, speed, tangential, torque = single.get("force"), single.get("speed"), None, None
    direction, angle = single.get("direction"), single.get("contact_angle")
    if "position" in chosen and (speed is None or direction is None):
        place = rows("position")
        speed = speed_of(place, rate_Hz) if speed is None else speed
        if direction is None and len(place) > 1:
            direction = direction_of(place[0], place[1], rate_Hz)
        del place
    if angle is None and QUATERNION in chosen:
        angle = tilt(rows(QUATERNION))
    if "torque" in chosen:
        torque = _size(rows("torque"))
    if "tangential_force" in chosen:
        tangential = _size(rows("tangential_force"))
    elif "friction" in single and force is not None:
        tangential = single["friction"] * force
    acceleration = one_axis(rows("acceleration"), rate_Hz)
    return SurfaceRecording(
        rate_Hz, acceleration, force, speed, tangential, single.get("depth"), torque_Nm=torque,
        grip_force_N=single.get("grip_force"), contact_angle_rad=angle, direction_rad=direction,
    )  # fmt: skip


_SINGLE: Final = ("force", "speed", "friction", "depth", "grip_force", "contact_angle", "direction")


def _size(axes: list[Array]) -> Array:
    """Size (n,) of a vector's axes; one axis as it is."""
    return axes[0] if len(axes) == 1 else np.asarray(np.sqrt(sum(axis**2 for axis in axes)))


def tilt(quaternion: list[Array]) -> Array:
    """Angle (n,) [rad] between the z-axes before and after a turn by w, x, y, z (n,) each, from 0 to π/2.

    Raises:
        CaptureError: a quaternion of no size.
    """
    square = sum(part**2 for part in quaternion)
    if not np.all(np.asarray(square) > 0.0):
        raise CaptureError("orientation: a quaternion of four zeros is none")
    _, x, y, _ = quaternion
    return np.asarray(np.arccos(np.minimum(np.abs(1.0 - 2.0 * (x**2 + y**2) / square), 1.0)))


def rate_of(given_Hz: float | None, source: RecordingSource, time_s: Array | None) -> float:
    """The rate as given, else the file's own, else that of its column of times."""
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
    raise CaptureError("the file does not say its sample rate: give rate_Hz=… (--rate HZ)")


def _choose(names: list[str], columns: Mapping[str, str], wave: bool) -> dict[str, list[str]]:
    """Quantity to columns, for the quantities that the file has."""
    chosen: dict[str, list[str]] = {}
    for quantity, column in _joined(columns).items():
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
    """What the columns of a quantity may end in; of one number none."""
    return ("w", *AXES) if quantity == QUATERNION else AXES if quantity in VECTORS else ()


def _joined(columns: Mapping[str, str]) -> dict[str, str]:
    """Columns as given, those of axes, as acceleration_x, joined by "+" under their quantity."""
    joined: dict[str, str] = {}
    axes: dict[str, dict[str, str]] = {}
    for key, column in columns.items():
        quantity, _, axis = key.rpartition("_")
        if axis in _axes(quantity):
            axes.setdefault(quantity, {})[axis] = column
        else:
            joined[key] = column
    for quantity, parts in axes.items():
        if quantity in joined:
            raise CaptureError(f"columns name both {quantity} and {quantity}_{min(parts)}: give one of them")
        joined[quantity] = "+".join(parts[axis] for axis in _axes(quantity) if axis in parts)
    return joined


def _likely(names: list[str], chosen: Mapping[str, list[str]]) -> str:
    """The column that most likely is the acceleration: of those that are nothing else, one that begins with it."""
    taken = {name for parts in chosen.values() for name in parts}
    free = [name for name in names if name not in taken] or ["COLUMN"]
    return next(name for start in ("acc", "a", "") for name in free if name.casefold().startswith(start))


def _scale(quantity: str, names: list[str], given: Mapping[str, str], own: Mapping[str, str]) -> float:
    """What one of the file's numbers is in SI; the unit is that given, else the file's own for the column."""
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
