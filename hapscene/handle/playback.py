"""Play an acceleration through a simulated handle."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.dsp.spectrogram import row_of
from hapscene.dsp.spectrogram import (
    spectrogram_error as spectrogram_error,
)  # public as hapscene.handle.spectrogram_error
from hapscene.handle.handle_loop import vibrate
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Array, Plant, Sensor
from hapscene.io.files import whole_file
from hapscene.records import Record

__all__ = ["PlaybackResult", "play", "run", "write_wave"]


@dataclass(frozen=True, eq=False)
class PlaybackResult:
    """Motion and force of a handle, sample by sample, aligned with the desired acceleration.

    Attributes:
        acceleration_m_s2: (n,) acceleration of the handle.
        force_N: (n,) force of the actuator, +F on the handle and −F on the coil, constant over each sample.
        travel_m: (n,) travel of the coil in the handle, at the end of each sample.
        displacement_m: (n,) displacement of the handle, at the end of each sample.
        latency_s: delay of the handle behind the desired acceleration. The arrays are shifted back by it.
        hits: impacts of the coil on a stop [count].
        clips: commands that were cut at the force limit [count].
    """

    acceleration_m_s2: Array
    force_N: Array
    travel_m: Array
    displacement_m: Array
    latency_s: float
    hits: int
    clips: int

    def __repr__(self) -> str:
        return (
            f"<PlaybackResult: {len(self.acceleration_m_s2):,} samples, latency {1e3 * self.latency_s:.3g} ms; "
            f"{self.hits} impacts on a stop, {self.clips} clipped commands>"
        )


def play(
    acceleration_m_s2: ArrayLike,
    rate_Hz: float,
    plant: Plant | None = None,
    *,
    compensator: str = "adaptive",
    nominal: Plant | None = None,
    seed: int = 0,
    sensor: Sensor | None = None,
    nominal_sensor: Sensor | None = None,
) -> PlaybackResult:
    """Play a desired acceleration through a simulated handle that starts at rest.

    Force and travel stay within the limits of the plant: the governor reduces the gain before a limit is reached
    (`hapscene.handle.governor`).

    Args:
        acceleration_m_s2: (n,) desired acceleration [m/s²]. Samples that are not finite count as 0.
        rate_Hz: sample rate [Hz].
        plant: the handle that is simulated; `Plant()` by default.
        compensator: a name of `COMPENSATORS`. With "none" no force acts, and the handle stays at rest.
        nominal: the handle that the compensator assumes; `Plant()` by default.
        seed: seed of the accelerometer noise.
        sensor: the accelerometer that is simulated; `Sensor()` by default.
        nominal_sensor: the accelerometer that the compensator assumes; `sensor` by default.

    Raises:
        HandleError: unknown compensator, rate out of range, sensor delay too long for the rate, or an acceleration that
            is not a one-dimensional array of numbers.
    """
    desired = row_of(acceleration_m_s2, "acceleration_m_s2")
    plant = Plant() if plant is None else plant
    nominal = Plant() if nominal is None else nominal
    handle = new_handle(plant, nominal, compensator, rate_Hz, seed, sensor, nominal_sensor)
    delay = int(handle[0].delay)
    out = np.zeros((4, len(desired) + delay))
    run(handle[0], np.concatenate([desired, np.zeros(delay)]), out)
    acceleration, displacement, force, travel = (row[delay:].copy() for row in out)
    h = handle[0]
    return PlaybackResult(acceleration, force, travel, displacement, delay / rate_Hz, int(h.hits), int(h.clips))


@native
def run(handle: Record, desired_m_s2: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill `out` (4, n) with acceleration, displacement, force and travel of one `HANDLE` for a desired
    acceleration."""
    for k in range(len(desired_m_s2)):
        out[0, k], out[1, k], out[2, k] = vibrate(handle, desired_m_s2[k])
        out[3, k] = handle.x[2]


def write_wave(acceleration_m_s2: Array, rate_Hz: float, path: Path) -> float:
    """Write an acceleration as WAV, mono, 16 bit. Returns the acceleration of full scale [m/s²], 0 for silence.

    Raises:
        OSError: the folder does not exist or is not writable.
    """
    full_m_s2 = float(np.abs(acceleration_m_s2).max(initial=0.0)) / 10 ** (-1.0 / 20)  # −1 dB: no clipping
    wave = acceleration_m_s2 / (full_m_s2 or 1.0)
    with whole_file(path) as part:
        scipy.io.wavfile.write(part, round(rate_Hz), np.rint(wave * 32767).astype(np.int16))
    return full_m_s2
