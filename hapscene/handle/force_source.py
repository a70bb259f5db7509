"""Where force goes and acceleration comes from: a simulated handle here, a real one in `port`."""

from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hapscene.compiled.native import native
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.errors import HandleError
from hapscene.handle.handle_dynamics import delay, set_late
from hapscene.handle.handle_record import LATE
from hapscene.handle.plant import Array, Plant
from hapscene.handle.sensor import ACCELEROMETER_HZ, ACCELEROMETER_NOISE_M_S2_RTHZ
from hapscene.records import records

__all__ = ["FIRM", "LIGHT", "SCATTER", "ForceSource", "SimulatedSource", "grip_names", "simulated_grips"]

LIGHT: Final = (150.0, 3.0)
"""Stiffness [N/m] and damping [N·s/m] of the lightest simulated grip. Assumed: the reference's hand is 500 and 5."""

FIRM: Final = (2000.0, 10.0)
"""The same of the firmest: four times the reference's stiffness, twice its damping."""

SCATTER: Final = 0.1
"""How far a simulated grip is off what was meant, as a standard deviation of each logarithm [1]: no hand repeats."""

UNREST_N: Final = 0.02
"""Force of the hand's own unrest, root mean square [N]. Assumed: on the reference's handle it makes about 0.1 m/s², as
physiological tremor does. More of it costs certainty below 30 Hz, where little force can be played."""

UNREST_HZ: Final = 10.0
"""Bandwidth of that unrest, one pole [Hz]: tremor of a hand lies at 8 to 12 Hz."""

_TRAVEL: Final = 2
_READING: Final = 5


class ForceSource(Protocol):
    """Something that plays force through a handle and measures its acceleration.

    Each force is held until the next; sample n of the acceleration is taken as force n begins.
    """

    @property
    def rate_Hz(self) -> float:
        """Samples a second."""

    def play(self, force_N: Array) -> tuple[Array, Array]:
        """Play force (n,) [N]; gives the force that was really put out and the acceleration [m/s²], (m,) each.

        Raises:
            HandleError: the handle is gone, or cannot play that.
        """


@dataclass
class SimulatedSource:
    """A handle in a hand, exact for a force that is held: amplifier, plant, a hand that is not still, accelerometer.

    Attributes:
        plant: the handle, and the hand that holds it now; set another to change the grip.
        rate_Hz: of force and acceleration.
        noise_m_s2_rtHz: density of the accelerometer's noise [m/s²/√Hz], before its pole.
        accelerometer_Hz: its pole.
        unrest_N: force of the hand's own unrest, root mean square.
        seed: of noise and unrest.
        delay_s: how much later than the accelerometer's pole says a reading comes.
    """

    plant: Plant
    rate_Hz: float = ACCELERATION_RATE_HZ
    noise_m_s2_rtHz: float = ACCELEROMETER_NOISE_M_S2_RTHZ
    accelerometer_Hz: float = ACCELEROMETER_HZ
    unrest_N: float = UNREST_N
    seed: int = 0
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._state = np.zeros((2, 7))
        self._late = records(1, LATE)
        set_late(self._late[0], self.delay_s * self.rate_Hz)
        self._step = np.zeros((7, 10))
        self._stepped: Plant | None = None

    def play(self, force_N: ArrayLike) -> tuple[Array, Array]:
        """Play force (n,) [N], from rest.

        Raises:
            HandleError: the force, or the travel of the coil, would exceed the plant's limit.
        """
        force = np.asarray(force_N, dtype=np.float64)
        peak_N, limit_m = np.abs(force).max(initial=0.0), self.plant.travel_limit_m
        if peak_N > self.plant.force_limit_N:
            raise HandleError(f"{peak_N:.3g} N were asked for; the actuator can do {self.plant.force_limit_N:g} N")
        self._state[:] = 0.0
        acceleration, travel_m = self.advance(force)
        most_m = np.abs(travel_m).max(initial=0.0)
        if most_m > limit_m:
            stop = f"meet a stop at {1e3 * limit_m:.2g} mm: play less force"
            raise HandleError(f"the coil would travel {1e3 * most_m:.2g} mm and {stop}")
        return force, acceleration

    def advance(self, force_N: ArrayLike) -> tuple[Array, Array]:
        """Acceleration (n,) [m/s²] and travel (n,) [m] for more force (n,) [N]; keeps no limits."""
        force = np.asarray(force_N, dtype=np.float64)
        # both noises are white up to half the rate, and held like the force
        noise = self._rng.standard_normal((len(force), 2))
        noise[:, 0] *= self.noise_m_s2_rtHz * np.sqrt(0.5 * self.rate_Hz)
        noise[:, 1] *= self.unrest_N * np.sqrt(self.rate_Hz / (np.pi * UNREST_HZ))
        if self._stepped is not self.plant:
            a, b, *_ = scipy.signal.cont2discrete(self._system(), 1.0 / self.rate_Hz, method="zoh")
            self._step, self._stepped = np.hstack([a, b]), self.plant
        out = np.zeros((len(force), 2))
        _advance(self._step, np.column_stack([force, noise]), self._state, self._late[0], out)
        return out[:, 0].copy(), out[:, 1].copy()

    def _system(self) -> tuple[Array, Array, Array, Array]:
        """A (7, 7), B (7, 3), C (2, 7), D (2, 3): inputs force command, noise, unrest; outputs reading and travel.

        States are the plant's four, the amplifier's force, the reading, the force of unrest.
        """
        plant_a, plant_b, plant_c, plant_d = self.plant.state_space()
        amplifier, reading, unrest = 2.0 * np.pi * np.array([self.plant.amplifier_Hz, self.accelerometer_Hz, UNREST_HZ])
        mass = self.plant.m_h_kg
        a, b = np.zeros((7, 7)), np.zeros((7, 3))
        a[:4, :4], a[:4, 4] = plant_a, plant_b[:, 0]
        a[:4, 6] = 0.0, 1.0 / mass, 0.0, -1.0 / mass  # on the handle alone: r̈ has −ẍ_h in it
        a[4, 4], a[5, 5], a[6, 6] = -amplifier, -reading, -unrest
        a[5, :4], a[5, 4], a[5, 6] = reading * plant_c[0], reading * plant_d[0, 0], reading / mass
        b[4, 0], b[5, 1], b[6, 2] = amplifier, reading, unrest
        c = np.zeros((2, 7))
        c[0, _READING] = c[1, _TRAVEL] = 1.0
        return a, b, c, np.zeros((2, 3))


@native
def _advance(step: Array, inputs: Array, x: Array, late: Any, out: Array) -> None:
    """Fill out (n, 2) with reading and travel as each of the inputs (n, 3) begins; the state is the first row of x."""
    for k in range(len(inputs)):
        out[k, 0], out[k, 1] = delay(late, x[0, _READING]), x[0, _TRAVEL]
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
    """Name, stiffness [N/m] and damping [N·s/m] of grips from `LIGHT` to `FIRM`, each off by `SCATTER`."""
    rng = np.random.default_rng([seed, 1])
    pairs = np.geomspace(LIGHT, FIRM, count) if count > 1 else np.sqrt([np.multiply(LIGHT, FIRM)])
    pairs *= np.exp(SCATTER * rng.standard_normal((count, 2)))
    return [(name, float(k), float(b)) for name, (k, b) in zip(grip_names(count), pairs, strict=True)]


def grip_names(count: int) -> list[str]:
    """What to call grips from light to firm."""
    names = {1: ["normal"], 2: ["light", "firm"], 3: ["light", "normal", "firm"]}
    return names.get(count, [f"{i + 1} of {count}, light to firm" for i in range(count)])
