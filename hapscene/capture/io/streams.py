"""The streams of a recording, checked and filtered: acceleration, normal force, speed, and what else was measured."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Final, Literal, TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import CaptureError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = [
    "BLOCK",
    "DURATION_MIN_S",
    "HAND_CUTOFF_HZ",
    "Array",
    "Streams",
    "blocks",
    "clean",
    "direction_of",
    "fill_missing",
    "filtered",
    "high_pass_gain",
    "kept_share",
    "part_of",
    "speed_of",
]

Array = NDArray[np.float64]
_Recording = TypeVar("_Recording", bound="DataclassInstance")

HAND_CUTOFF_HZ: Final = 100.0
"""Cut-off of the low-pass on force and speed [Hz]: hand motion lies below it, the response of the surface above."""

DURATION_MIN_S: Final = 0.5
"""Shortest recording that a model is fitted to [s]: two halves of three windows each."""

BLOCK: Final = 1 << 16
"""Samples of a long signal that are filtered at once [count]."""

ASSUMED_FORCE_N: Final = 1.0
"""Normal force that is assumed where none was recorded [N]: that of a pen that writes."""

ASSUMED_SPEED_M_S: Final = 0.1
"""Slip speed that is assumed where none was recorded [m/s]: that of a slow stroke over a plate."""

ACCELERATION_MAX_M_S2: Final = 1e6
"""Largest plausible acceleration of a tool [m/s²]: shock sensors end at a tenth of it."""


@dataclass(frozen=True)
class Streams:
    """A cleaned recording: n samples of each stream at one rate."""

    rate_Hz: float
    acceleration_m_s2: Array
    force_N: Array
    speed_m_s: Array
    tangential_force_N: Array | None
    depth_m: Array | None = None
    assumed: tuple[str, ...] = ()
    """names of the streams that were not recorded but assumed"""
    speed_rest_m_s: float = 0.0
    """speed reading at rest: the noise of a speed that is a magnitude has a mean above 0"""
    torque_Nm: Array | None = None
    grip_force_N: Array | None = None
    contact_angle_rad: Array | None = None
    """between the tool's axis and the surface's normal, 0 upright"""


def clean(
    acceleration_m_s2: ArrayLike,
    rate_Hz: float,
    force_N: ArrayLike | None = None,
    speed_m_s: ArrayLike | None = None,
    tangential_force_N: ArrayLike | None = None,
    depth_m: ArrayLike | None = None,
    *,
    torque_Nm: ArrayLike | None = None,
    grip_force_N: ArrayLike | None = None,
    contact_angle_rad: ArrayLike | None = None,
) -> Streams:
    """Acceleration high-passed at 20 Hz, the other streams low-passed at 100 Hz, all without delay.

    Force and speed may be one number for the whole recording, or None: then `ASSUMED_FORCE_N`, `ASSUMED_SPEED_M_S`.
    Depth grows into the surface; it is negative above it. The sign of the contact angle is ignored.

    Raises:
        CaptureError: too short, too slow, silent, not finite, not real numbers, beyond `ACCELERATION_MAX_M_S2`, or
            streams of different length.
    """
    _check_rate(rate_Hz)
    high = _cleaned_acceleration(acceleration_m_s2, rate_Hz)
    count = len(high)
    force = _stream("force_N", ASSUMED_FORCE_N if force_N is None else force_N, count)
    speed = _stream("speed_m_s", ASSUMED_SPEED_M_S if speed_m_s is None else speed_m_s, count)
    others = {"tangential_force_N": tangential_force_N, "depth_m": depth_m, "torque_Nm": torque_Nm}
    others |= {"grip_force_N": grip_force_N, "contact_angle_rad": contact_angle_rad}
    low = {n: None if s is None else _low_passed(_stream(n, s, count), rate_Hz) for n, s in others.items()}
    if (tilt := low["contact_angle_rad"]) is not None:
        low["contact_angle_rad"] = tilt = np.abs(tilt)
        if (most := float(tilt.max())) > np.pi:
            raise CaptureError(f"the contact angle reaches {most:.4g} rad, more than half a turn: check its unit")
    assumed = tuple(name for name, s in {"force_N": force_N, "speed_m_s": speed_m_s}.items() if s is None)
    slow = np.abs(_low_passed(speed, rate_Hz))
    rest_m_s = _rest_level(speed, slow, rate_Hz)
    return Streams(
        float(rate_Hz), high, _low_passed(force, rate_Hz), slow, assumed=assumed, speed_rest_m_s=rest_m_s, **low
    )


def _check_rate(rate_Hz: float) -> None:
    if np.ndim(rate_Hz) != 0 or np.asarray(rate_Hz).dtype.kind not in "iuf":
        raise CaptureError(f"rate_Hz must be a number, is {rate_Hz!r}")
    if not (np.isfinite(rate_Hz) and rate_Hz > 4.0 * HAND_CUTOFF_HZ):
        raise CaptureError(f"rate_Hz must be above {4.0 * HAND_CUTOFF_HZ:g}, is {rate_Hz}")


def _cleaned_acceleration(values: ArrayLike, rate_Hz: float) -> Array:
    """The acceleration, checked and high-passed at 20 Hz."""
    acceleration = _stream("acceleration_m_s2", values, None)
    beyond = np.flatnonzero((acceleration > ACCELERATION_MAX_M_S2) | (acceleration < -ACCELERATION_MAX_M_S2))
    if len(beyond):
        raise CaptureError(
            f"acceleration_m_s2: sample {beyond[0]} is {acceleration[beyond[0]]:.3g} m/s², expected at most "
            f"{ACCELERATION_MAX_M_S2:g}: check its unit"
        )
    count = len(acceleration)
    if count < DURATION_MIN_S * rate_Hz:
        least = f"at least {DURATION_MIN_S:g} s are needed"
        raise CaptureError(f"{count} samples at {rate_Hz:g} Hz are {count / rate_Hz:.3g} s: {least}")
    high = filtered(acceleration - acceleration.mean(), rate_Hz, ACCELERATION_BAND_HZ[0], "highpass")
    if not high.std() > 1e-9 * max(1.0, acceleration.max(), -acceleration.min()):
        raise CaptureError(f"the acceleration is silent above {ACCELERATION_BAND_HZ[0]:g} Hz: nothing can be fitted")
    return high


def _rest_level(raw: Array, low: Array, rate_Hz: float) -> float:
    """What a speed reads at rest: the lower quartile of the means of the 50 ms windows in which it looks like noise.

    Noise varies as much as its mean, also above the low-pass (half a normal distribution by 0.76 of its mean, the
    magnitude of three axes by 0.42), which hand motion does not; and it is never long near zero, as stick–slip is.
    """
    length = max(1, round(0.05 * rate_Hz))
    raw, low = (stream[: len(stream) // length * length].reshape(-1, length) for stream in (raw, low))
    found = []
    for part in blocks(len(raw), max(1, BLOCK // length)):
        own, slow = raw[part], low[part]
        mean, fast = slow.mean(axis=1), (np.abs(own) - slow).std(axis=1)
        noise = (own.std(axis=1) > 0.3 * mean) & (mean < 4.5 * fast) & (np.quantile(slow, 0.1, axis=1) > 0.3 * mean)
        found.append(mean[noise])
    means = np.concatenate(found)
    return float(np.quantile(means, 0.25)) if len(means) > 1 else 0.0


def blocks(count: int, size: int) -> Iterator[slice]:
    """Slices of `size` samples, the last one shorter."""
    return (slice(start, start + size) for start in range(0, count, size))


def kept_share(frequency_Hz: ArrayLike) -> Array:
    """Share (n,) of a recording's power that the high-pass of `clean` keeps at frequencies (n,) [1]."""
    ratio = ACCELERATION_BAND_HZ[0] / np.maximum(np.asarray(frequency_Hz, dtype=np.float64), 1e-3)
    return np.asarray((1.0 + ratio**8) ** -2.0)


def part_of(recording: _Recording, part: slice | NDArray[np.bool_]) -> _Recording:
    """Some samples of all streams of a recording, cleaned or not."""
    streams = ((field.name, getattr(recording, field.name)) for field in fields(recording))
    return replace(recording, **{name: stream[part] for name, stream in streams if isinstance(stream, np.ndarray)})


def fill_missing(stream: Array) -> int:
    """Interpolate samples that are NaN linearly between their neighbours, in place; returns their number."""
    missing = np.isnan(stream)
    gaps = np.flatnonzero(missing)
    if len(gaps):
        beside = np.zeros_like(missing)
        beside[:-1] |= missing[1:]
        beside[1:] |= missing[:-1]
        known = np.flatnonzero(beside & ~missing)
        stream[gaps] = np.interp(gaps, known, stream[known])
    return len(gaps)


def _can_filter(position_m: Array, rate_Hz: float) -> bool:
    """Whether positions (n,) are long and fast enough to be low-passed."""
    return rate_Hz > 4.0 * HAND_CUTOFF_HZ and len(position_m) >= 0.1 * rate_Hz


def speed_of(position_m: Array | Sequence[Array], rate_Hz: float) -> Array:
    """Speed (n,) [m/s] of positions (k, n) along k axes: low-passed at 100 Hz, then central differences.

    Both are without delay. Of a motion at frequency f the differences keep sin(x)/x with x = 2πf/rate, at 20 Hz and
    1 kHz all but 0.3 %.

    Raises:
        CaptureError: too slow or too short to be low-passed.
    """
    if not _can_filter(position_m[0], rate_Hz):
        raise CaptureError(
            f"{len(position_m[0])} positions at {rate_Hz:g} Hz give no speed: 0.1 s or more at above "
            f"{4.0 * HAND_CUTOFF_HZ:g} Hz are needed"
        )
    square = np.zeros(len(position_m[0]))
    for axis in position_m:
        square += np.gradient(_low_passed(axis, rate_Hz), 1.0 / rate_Hz) ** 2
    return np.asarray(np.sqrt(square, out=square))


def direction_of(x_m: Array, y_m: Array, rate_Hz: float) -> Array | None:
    """Direction (n,) [rad] in which positions (n,) move, from x towards y; None where they have no speed."""
    if not _can_filter(x_m, rate_Hz):
        return None
    slope = [np.gradient(_low_passed(axis, rate_Hz)) for axis in (y_m, x_m)]
    return np.asarray(np.arctan2(*slope))


def high_pass_gain(size: int, rate_Hz: float) -> Array:
    """Gain (size//2+1,) of the high-pass that `clean` puts on the acceleration, at the lines of an FFT of `size`."""
    sections = scipy.signal.butter(4, ACCELERATION_BAND_HZ[0], "highpass", fs=rate_Hz, output="sos")
    _, response = scipy.signal.sosfreqz(sections, 2.0 * np.pi * np.arange(size // 2 + 1) / size)
    return np.asarray(np.abs(response) ** 2)  # forward and backward


def _stream(name: str, values: ArrayLike, count: int | None) -> Array:
    """One stream as (n,) float64; a single number is spread over the recording."""
    try:
        given = np.asarray(values)
    except (TypeError, ValueError):
        raise CaptureError(f"{name} must be a list of numbers") from None
    if given.dtype.kind not in "iuf":  # a cast to float64 would drop the imaginary part, and accept text
        raise CaptureError(f"{name} must be a list of real numbers, is of {given.dtype}")
    array = given.astype(np.float64, copy=False)
    if array.ndim == 0 and count is not None:
        array = np.broadcast_to(float(array), count)
    if array.ndim != 1:
        raise CaptureError(f"{name} must have one axis, its shape is {array.shape}")
    if count is not None and len(array) != count:
        raise CaptureError(f"{name} has {len(array)} samples, acceleration_m_s2 has {count}")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise CaptureError(f"{name}: sample {bad[0]} is not finite")
    return array


def _low_passed(signal: Array, rate_Hz: float) -> Array:
    """Low-passed at 100 Hz; a constant stays exactly that number, and takes the memory of one."""
    if np.ptp(signal) == 0.0:
        return np.broadcast_to(signal[0], signal.shape)
    return filtered(signal, rate_Hz, HAND_CUTOFF_HZ, "lowpass")


def filtered(
    signal: Array, rate_Hz: float, cutoff_Hz: float, kind: Literal["lowpass", "highpass"], order: int = 4
) -> Array:
    """Signals (..., n) through Butterworth's filter of even order, forward and backward: without delay.

    As `scipy.signal.sosfiltfilt`, to the bit; long signals block by block, because that takes five times their memory.
    """
    sections = scipy.signal.butter(order, cutoff_Hz, kind, fs=rate_Hz, output="sos")
    if signal.ndim > 1 or signal.shape[-1] <= BLOCK:
        return np.asarray(scipy.signal.sosfiltfilt(sections, signal))
    edge = 3 * (2 * len(sections) + 1)
    padded = np.concatenate(
        (2.0 * signal[0] - signal[edge:0:-1], signal, 2.0 * signal[-1] - signal[-2 : -(edge + 2) : -1])
    )
    for way in (padded, padded[::-1]):
        state = scipy.signal.sosfilt_zi(sections) * way[0]
        for part in blocks(len(way), BLOCK):
            way[part], state = scipy.signal.sosfilt(sections, way[part], zi=state)
    return padded[edge:-edge]
