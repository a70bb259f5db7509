"""Sources of identification data: the interface, and a simulated handle. The real one is in `board`."""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hapscene.compiled.native import native
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.errors import HandleError
from hapscene.handle.handle_dynamics import delay, set_delay
from hapscene.handle.handle_record import DELAY_LINE
from hapscene.handle.plant import ACCELEROMETER_HZ, ACCELEROMETER_NOISE_M_S2_RTHZ, Array, Plant
from hapscene.records import records

__all__ = ["FIRM", "LIGHT", "SCATTER", "ForceSource", "SimulatedSource", "grip_names", "simulated_grips"]

LIGHT: Final = (150.0, 3.0)
"""Stiffness [N/m] and damping [N·s/m] of the lightest simulated grip. Assumed; `Plant()` has 500 and 5."""

FIRM: Final = (2000.0, 10.0)
"""Those of the firmest grip: four times the stiffness of `Plant()`, twice its damping."""

SCATTER: Final = 0.1
"""Random deviation of a simulated grip from its target: standard deviation of each logarithm [1]."""

TREMOR_N: Final = 0.02
"""Force of the hand's tremor, root mean square [N]. Assumed: it causes about 0.1 m/s² on the default handle, as
physiological tremor does. More tremor widens the intervals below 30 Hz, where little force can be played."""

TREMOR_HZ: Final = 10.0
"""Bandwidth of the tremor, one pole [Hz]: physiological tremor is at 8 to 12 Hz."""

_TRAVEL: Final = 2
_READING: Final = 5


class ForceSource(Protocol):
    """A handle that plays a force and measures its acceleration.

    Each force is held until the next one. Sample n of the acceleration is taken at the start of force n.
    """

    @property
    def rate_Hz(self) -> float:
        """Sample rate [Hz]."""

    def play(self, force_N: Array) -> tuple[Array, Array]:
        """Play a force (n,) [N]. Returns the force that was put out and the acceleration [m/s²], (m,) each.

        Raises:
            HandleError: the handle is disconnected, or cannot play this force.
        """


@dataclass
class SimulatedSource:
    """A simulated handle in a hand: amplifier, plant, tremor of the hand, accelerometer. Exact for a held force.

    Attributes:
        plant: the handle and the hand; assign another to change the grip.
        rate_Hz: sample rate of force and acceleration.
        noise_m_s2_rtHz: noise density of the accelerometer, before its pole [m/s²/√Hz].
        accelerometer_Hz: pole of the accelerometer.
        tremor_N: force of the tremor, root mean square.
        seed: seed of noise and tremor.
        delay_s: delay of a reading in addition to that of the pole.
    """

    plant: Plant
    rate_Hz: float = ACCELERATION_RATE_HZ
    noise_m_s2_rtHz: float = ACCELEROMETER_NOISE_M_S2_RTHZ
    accelerometer_Hz: float = ACCELEROMETER_HZ
    tremor_N: float = TREMOR_N
    seed: int = 0
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._state = np.zeros((2, 7))
        self._delay = records(1, DELAY_LINE)
        set_delay(self._delay[0], self.delay_s * self.rate_Hz)
        self._step = np.zeros((7, 10))
        self._stepped: Plant | None = None

    def play(self, force_N: ArrayLike) -> tuple[Array, Array]:
        """Play a force (n,) [N], starting at rest.

        Raises:
            HandleError: the force or the travel of the coil exceeds its limit.
        """
        force = np.asarray(force_N, dtype=np.float64)
        peak_N, limit_m = np.abs(force).max(initial=0.0), self.plant.travel_limit_m
        if peak_N > self.plant.force_limit_N:
            raise HandleError(
                f"force {peak_N:.3g} N exceeds the actuator's limit of {self.plant.force_limit_N:g} N: lower --force"
            )
        self._state[:] = 0.0
        acceleration, travel_m = self.advance(force)
        most_m = np.abs(travel_m).max(initial=0.0)
        if most_m > limit_m:
            raise HandleError(
                f"travel {1e3 * most_m:.2g} mm of the coil exceeds its limit of {1e3 * limit_m:.2g} mm: lower --force"
            )
        return force, acceleration

    def advance(self, force_N: ArrayLike) -> tuple[Array, Array]:
        """Acceleration (n,) [m/s²] and travel (n,) [m] for further force (n,) [N], without limits."""
        force = np.asarray(force_N, dtype=np.float64)
        # both noises are white up to half the sample rate, and held like the force
        noise = self._rng.standard_normal((len(force), 2))
        noise[:, 0] *= self.noise_m_s2_rtHz * np.sqrt(0.5 * self.rate_Hz)
        noise[:, 1] *= self.tremor_N * np.sqrt(self.rate_Hz / (np.pi * TREMOR_HZ))
        if self._stepped is not self.plant:
            a, b, *_ = scipy.signal.cont2discrete(self._system(), 1.0 / self.rate_Hz, method="zoh")
            self._step, self._stepped = np.hstack([a, b]), self.plant
        out = np.zeros((len(force), 2))
        _advance(self._step, np.column_stack([force, noise]), self._state, self._delay[0], out)
        return out[:, 0].copy(), out[:, 1].copy()

    def _system(self) -> tuple[Array, Array, Array, Array]:
        """State space A (7, 7), B (7, 3), C (2, 7), D (2, 3).

        Inputs: force command, noise, tremor. Outputs: reading and travel. States: those of the plant, force of the
        amplifier, reading, force of the tremor.
        """
        plant_a, plant_b, plant_c, plant_d = self.plant.state_space()
        amplifier, reading, tremor = 2.0 * np.pi * np.array([self.plant.amplifier_Hz, self.accelerometer_Hz, TREMOR_HZ])
        mass = self.plant.m_h_kg
        a, b = np.zeros((7, 7)), np.zeros((7, 3))
        a[:4, :4], a[:4, 4] = plant_a, plant_b[:, 0]
        a[:4, 6] = 0.0, 1.0 / mass, 0.0, -1.0 / mass  # acts on the handle alone, and r̈ contains −ẍ_h
        a[4, 4], a[5, 5], a[6, 6] = -amplifier, -reading, -tremor
        a[5, :4], a[5, 4], a[5, 6] = reading * plant_c[0], reading * plant_d[0, 0], reading / mass
        b[4, 0], b[5, 1], b[6, 2] = amplifier, reading, tremor
        c = np.zeros((2, 7))
        c[0, _READING] = c[1, _TRAVEL] = 1.0
        return a, b, c, np.zeros((2, 3))


@native
def _advance(step: Array, inputs: Array, x: Array, line: np.record, out: Array) -> None:
    """Fill out (n, 2) with reading and travel at the start of each input (n, 3). The state is the first row of x."""
    for k in range(len(inputs)):
        out[k, 0], out[k, 1] = delay(line, x[0, _READING]), x[0, _TRAVEL]
        for i in range(7):
            total = 0.0
            for j in range(7):
                total += step[i, j] * x[0, j]
            for j in range(3):
                total += step[i, 7 + j] * inputs[k, j]
            x[1, i] = total
        for i in range(7):
            x[0, i] = x[1, i]


def simulated_grips(count: int, seed: int = 0) -> list[tuple[str, float, float]]:
    """Name, stiffness [N/m] and damping [N·s/m] of grips from `LIGHT` to `FIRM`, with random deviations."""
    rng = np.random.default_rng([seed, 1])
    pairs = np.geomspace(LIGHT, FIRM, count) if count > 1 else np.sqrt([np.multiply(LIGHT, FIRM)])
    pairs *= np.exp(SCATTER * rng.standard_normal((count, 2)))
    return [(name, float(k), float(b)) for name, (k, b) in zip(grip_names(count), pairs, strict=True)]


def grip_names(count: int) -> list[str]:
    """Names of grips from light to firm."""
    names = {1: ["normal"], 2: ["light", "firm"], 3: ["light", "normal", "firm"]}
    return names.get(count, [f"{i + 1} of {count}, light to firm" for i in range(count)])
