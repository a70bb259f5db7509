"""Checks and filters the streams of a recording: acceleration, normal force, speed, and optional streams."""

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
"""Cut-off of the low-pass on force and speed [Hz]. Hand motion lies below it, the response of the surface above."""

DURATION_MIN_S: Final = 0.5
"""Shortest recording that a model is fitted to [s]: two halves of three analysis windows each."""

BLOCK: Final = 1 << 16
"""Number of samples of a long signal that are filtered at once."""

ASSUMED_FORCE_N: Final = 1.0
"""Normal force that is assumed if it was not recorded [N]: that of writing with a pen."""

ASSUMED_SPEED_M_S: Final = 0.1
"""Slip speed that is assumed if it was not recorded [m/s]: that of a slow stroke."""

ACCELERATION_MAX_M_S2: Final = 1e6
"""Largest plausible acceleration of a tool [m/s²]: ten times the range of shock sensors."""


@dataclass(frozen=True)
class Streams:
    """A filtered recording: n samples of each stream at one sample rate."""

    rate_Hz: float
    acceleration_m_s2: Array
    force_N: Array
    speed_m_s: Array
    tangential_force_N: Array | None
    depth_m: Array | None = None
    assumed: tuple[str, ...] = ()
    """names of the streams that were assumed instead of recorded"""
    speed_rest_m_s: float = 0.0
    """measured speed at rest; the noise of a magnitude has a mean above 0"""
    torque_Nm: Array | None = None
    grip_force_N: Array | None = None
    contact_angle_rad: Array | None = None
    """angle between the axis of the tool and the surface normal; 0 if the tool is upright"""


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
    """High-pass filters the acceleration at 20 Hz and low-pass filters the other streams at 100 Hz, without delay.

    Force and speed may be a single number for the whole recording, or None for `ASSUMED_FORCE_N` and
    `ASSUMED_SPEED_M_S`. Depth is positive inside the surface. The sign of the contact angle is ignored.

    Raises:
        CaptureError: a stream is too short, constant, not finite, not real or out of range; the sample rate is too low;
            the streams have different lengths.
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
            raise CaptureError(f"the contact angle reaches {most:.4g} rad; expected at most π: check its unit")
    assumed = tuple(name for name, s in {"force_N": force_N, "speed_m_s": speed_m_s}.items() if s is None)
    slow = np.abs(_low_passed(speed, rate_Hz))
    rest_m_s = _rest_level(speed, slow, rate_Hz)
    return Streams(
        float(rate_Hz), high, _low_passed(force, rate_Hz), slow, assumed=assumed, speed_rest_m_s=rest_m_s, **low
    )


def _check_rate(rate_Hz: float) -> None:
    if np.ndim(rate_Hz) != 0 or np.asarray(rate_Hz).dtype.kind not in "iuf":
        raise CaptureError(f"rate_Hz is {rate_Hz!r}; expected a number")
    if not (np.isfinite(rate_Hz) and rate_Hz > 4.0 * HAND_CUTOFF_HZ):
        raise CaptureError(f"rate_Hz is {rate_Hz}; expected more than {4.0 * HAND_CUTOFF_HZ:g} Hz")


def _cleaned_acceleration(values: ArrayLike, rate_Hz: float) -> Array:
    """Checks the acceleration and high-pass filters it at 20 Hz."""
    acceleration = _stream("acceleration_m_s2", values, None)
    beyond = np.flatnonzero((acceleration > ACCELERATION_MAX_M_S2) | (acceleration < -ACCELERATION_MAX_M_S2))
    if len(beyond):
        raise CaptureError(
            f"acceleration_m_s2: sample {beyond[0]} is {acceleration[beyond[0]]:.3g} m/s², expected at most "
            f"{ACCELERATION_MAX_M_S2:g}: check its unit"
        )
    count = len(acceleration)
    if count < DURATION_MIN_S * rate_Hz:
        length = f"{count} samples at {rate_Hz:g} Hz are {count / rate_Hz:.3g} s"
        raise CaptureError(f"the recording is too short: {length}; expected at least {DURATION_MIN_S:g} s")
    high = filtered(acceleration - acceleration.mean(), rate_Hz, ACCELERATION_BAND_HZ[0], "highpass")
    if not high.std() > 1e-9 * max(1.0, acceleration.max(), -acceleration.min()):
        raise CaptureError(
            f"the acceleration has no vibration above {ACCELERATION_BAND_HZ[0]:g} Hz: check the sensor and the column"
        )
    return high


def _rest_level(raw: Array, low: Array, rate_Hz: float) -> float:
    """Measured speed at rest: the lower quartile of the means of all 50 ms windows that contain only noise.

    The standard deviation of noise is comparable to its mean, also above the cut-off of the low-pass (0.76 of the mean
    for a half-normal distribution, 0.42 for the magnitude of three axes). That of hand motion is much smaller.
    Stick–slip is excluded by its intervals of zero speed.
    """
    length = round(0.05 * rate_Hz)
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
    """Slices of `size` samples; the last one may be shorter."""
    return (slice(start, start + size) for start in range(0, count, size))


def kept_share(frequency_Hz: ArrayLike) -> Array:
    """Power gain (n,) of the high-pass of `clean` at frequencies (n,) [1]."""
    ratio = ACCELERATION_BAND_HZ[0] / np.maximum(np.asarray(frequency_Hz, dtype=np.float64), 1e-3)
    return np.asarray((1.0 + ratio**8) ** -2.0)


def part_of(recording: _Recording, part: slice | NDArray[np.bool_]) -> _Recording:
    """Selects samples of all streams of a recording."""
    streams = ((field.name, getattr(recording, field.name)) for field in fields(recording))
    return replace(recording, **{name: stream[part] for name, stream in streams if isinstance(stream, np.ndarray)})


def fill_missing(stream: Array) -> int:
    """Replaces NaN samples by linear interpolation, in place, and returns their number."""
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
    """Whether positions (n,) have enough samples and a sample rate high enough for the low-pass."""
    return rate_Hz > 4.0 * HAND_CUTOFF_HZ and len(position_m) >= 0.1 * rate_Hz


def speed_of(position_m: Array | Sequence[Array], rate_Hz: float) -> Array:
    """Speed (n,) [m/s] of positions (k, n) along k axes, by a 100 Hz low-pass and central differences.

    Both are without delay. Central differences attenuate motion at frequency f by sin(x)/x with x = 2πf/rate: by 0.3 %
    at 20 Hz and a sample rate of 1 kHz.

    Raises:
        CaptureError: the sample rate is too low or the positions are too few for the low-pass.
    """
    if not _can_filter(position_m[0], rate_Hz):
        raise CaptureError(
            f"{len(position_m[0])} positions at {rate_Hz:g} Hz give no speed; expected at least 0.1 s at more "
            f"than {4.0 * HAND_CUTOFF_HZ:g} Hz"
        )
    square = np.zeros(len(position_m[0]))
    for axis in position_m:
        square += np.gradient(_low_passed(axis, rate_Hz), 1.0 / rate_Hz) ** 2
    return np.asarray(np.sqrt(square, out=square))


def direction_of(x_m: Array, y_m: Array, rate_Hz: float) -> Array | None:
    """Direction (n,) [rad] of motion from x towards y; None if the positions are too few or too slow for a speed."""
    if not _can_filter(x_m, rate_Hz):
        return None
    slope = [np.gradient(_low_passed(axis, rate_Hz)) for axis in (y_m, x_m)]
    return np.asarray(np.arctan2(*slope))


def high_pass_gain(size: int, rate_Hz: float) -> Array:
    """Gain (size//2+1,) of the high-pass of `clean` at the frequencies of an FFT of `size` samples."""
    sections = scipy.signal.butter(4, ACCELERATION_BAND_HZ[0], "highpass", fs=rate_Hz, output="sos")
    _, response = scipy.signal.sosfreqz(sections, 2.0 * np.pi * np.arange(size // 2 + 1) / size)
    return np.asarray(np.abs(response) ** 2)  # squared: the filter runs forward and backward


def _stream(name: str, values: ArrayLike, count: int | None) -> Array:
    """A stream as (n,) float64; a single number is repeated."""
    try:
        given = np.asarray(values)
    except (TypeError, ValueError):
        raise CaptureError(f"{name} is not an array of numbers") from None
    if given.dtype.kind not in "iuf":  # a cast would drop imaginary parts and accept text
        raise CaptureError(f"{name} has type {given.dtype}; expected real numbers")
    array = given.astype(np.float64, copy=False)
    if array.ndim == 0 and count is not None:
        array = np.broadcast_to(float(array), count)
    if array.ndim != 1:
        raise CaptureError(f"{name} has shape {array.shape}; expected one axis")
    if count is not None and len(array) != count:
        raise CaptureError(f"{name} has {len(array)} samples, but acceleration_m_s2 has {count}")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise CaptureError(f"{name}: sample {bad[0]} is not a finite number")
    return array


def _low_passed(signal: Array, rate_Hz: float) -> Array:
    """Low-pass filters at 100 Hz; a constant stream is returned unchanged as a broadcast scalar."""
    if np.ptp(signal) == 0.0:
        return np.broadcast_to(signal[0], signal.shape)
    return filtered(signal, rate_Hz, HAND_CUTOFF_HZ, "lowpass")


def filtered(
    signal: Array, rate_Hz: float, cutoff_Hz: float, kind: Literal["lowpass", "highpass"], order: int = 4
) -> Array:
    """Filters signals (..., n) with a Butterworth filter of even order, forward and backward, without delay.

    The result equals that of `scipy.signal.sosfiltfilt` to the bit. Long signals are filtered in blocks, because SciPy
    needs five times their memory.
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
