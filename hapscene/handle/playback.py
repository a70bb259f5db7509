"""Play an acceleration through a handle."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.dsp.spectrogram import row_of
from hapscene.dsp.spectrogram import spectrogram_error as spectrogram_error  # part of this room's face
from hapscene.handle.handle_loop import new_handle, vibrate
from hapscene.handle.plant import Array, Plant
from hapscene.handle.sensor import Sensor

__all__ = ["Played", "play", "run"]


@dataclass(frozen=True, eq=False)
class Played:
    """What a handle did, sample by sample, in step with what was asked for.

    Attributes:
        acceleration_m_s2: (n,) of the handle.
        force_N: (n,) of the actuator: +F on the handle, −F on the coil, held over each sample.
        travel_m: (n,) of the coil in the handle, at the end of each sample.
        displacement_m: (n,) of the handle, at the end of each sample.
        latency_s: how much later than asked for all of it was; it is shifted back by that here.
        hits: how often the coil met a stop [count].
        clips: how often the command was cut at the force limit [count].
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
            f"<Played: {len(self.acceleration_m_s2):,} samples, {1e3 * self.latency_s:.3g} ms late; "
            f"{self.hits} hits of a stop, {self.clips} clips>"
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
    believed: Sensor | None = None,
) -> Played:
    """Play a desired acceleration (n,) [m/s²] through the handle `plant`, at rest before it.

    `nominal` is the handle that the compensator believes in; both are `Plant()` unless given. The compensators are
    those of `COMPENSATORS`; with "none" no force acts, and everything stays at 0. Whatever is asked for, force and
    travel stay inside the plant's limits: what would need more is faded beforehand, see `governor`. Samples that are
    not finite count as 0. `sensor` is what is heard of the handle, and `believed` what the compensator takes it for:
    `Sensor()`, and the same. `seed` is that of the accelerometer's noise.

    Raises:
        HandleError: no such compensator, a rate out of range, a sensor too late for it, or an acceleration that is not
            one row of numbers.
    """
    desired = row_of(acceleration_m_s2, "acceleration_m_s2")
    plant = Plant() if plant is None else plant
    handle = new_handle(plant, Plant() if nominal is None else nominal, compensator, rate_Hz, seed, sensor, believed)
    delay = int(handle[0].delay)
    out = np.zeros((4, len(desired) + delay))
    run(handle[0], np.concatenate([desired, np.zeros(delay)]), out)
    acceleration, displacement, force, travel = (row[delay:].copy() for row in out)
    h = handle[0]
    return Played(acceleration, force, travel, displacement, delay / rate_Hz, int(h.hits), int(h.clips))


@native
def run(handle: Any, desired_m_s2: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Acceleration, displacement, force and travel (4, n) of a handle, one `HANDLE`, asked for that (n,)."""
    for k in range(len(desired_m_s2)):
        out[0, k], out[1, k], out[2, k] = vibrate(handle, desired_m_s2[k])
        out[3, k] = handle.x[2]
