"""Model of the haptography handle: a voice coil on a spring in a handle, the handle in a hand.

Two masses on a line: x_h is the displacement of the handle, x_c that of the coil, r = x_c − x_h the travel of the coil.
The actuator acts between the two: force F on the handle, −F on the coil. The hand is a spring and a damper from the
handle to the ground:

    m_c ẍ_c = −F − k_s r − b_s ṙ
    m_h ẍ_h =  F + k_s r + b_s ṙ − k_u x_h − b_u ẋ_h

With Z = b_s s + k_s: (m_c s² + Z) X_c − Z X_h = −F and (m_h s² + Z + b_u s + k_u) X_h − Z X_c = F. Without X_c,

    A_h/F = m_c s⁴ / ((m_c s² + b_s s + k_s)(m_h s² + (b_s + b_u) s + k_s + k_u) − (b_s s + k_s)²),

eq. 8 of the haptography paper (McMahan & Kuchenbecker 2009, "Haptic Display of Realistic Tool Contact via Dynamically
Compensated Control of a Dedicated Actuator", IROS). The momentum, m_c ẍ_c + m_h ẍ_h = −b_u ẋ_h − k_u x_h, gives the
travel: R/F = −((m_c + m_h) s² + b_u s + k_u) / (the same denominator).
"""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import HandleError

__all__ = [
    "ACCELEROMETER_HZ",
    "ACCELEROMETER_NOISE_M_S2_RTHZ",
    "DELAY_MAX_S",
    "NUMBER_MAX",
    "Array",
    "Complex",
    "Plant",
    "Sensor",
]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

NUMBER_MIN: Final = 1e-9
"""Smallest value of a parameter that must not be 0, in any unit. A division by it does not overflow."""

NUMBER_MAX: Final = 1e9
"""Largest value of a parameter, in any unit. It exceeds that of any handle, and products do not overflow."""


@dataclass(frozen=True)
class Plant:
    """A handle in a hand. The defaults are assumed, since the values of the published handle are not available.

    Attributes:
        m_c_kg: mass of the coil, which moves in the handle.
        k_s_N_m: stiffness of the spring that centres the coil.
        b_s_Ns_m: damping between coil and handle.
        m_h_kg: mass of the handle, including the part of the hand that moves with it.
        k_u_N_m: stiffness of the hand, ≥ 0.
        b_u_Ns_m: damping of the hand, ≥ 0.
        force_limit_N: peak force of the actuator.
        travel_limit_m: travel of the coil from its rest position to a stop, in both directions. A few millimetres are
            usual for coils of this force.
        amplifier_Hz: bandwidth of the amplifier's current loop, one pole.

    Raises:
        HandleError: a value that is not a number, not finite, or out of range.
    """

    m_c_kg: float = 0.015
    k_s_N_m: float = 250.0
    b_s_Ns_m: float = 0.3
    m_h_kg: float = 0.12
    k_u_N_m: float = 500.0
    b_u_Ns_m: float = 5.0
    force_limit_N: float = 6.6
    travel_limit_m: float = 0.005
    amplifier_Hz: float = 5000.0

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            least = 0.0 if name in ("b_s_Ns_m", "k_u_N_m", "b_u_Ns_m") else NUMBER_MIN
            _check(self, "plant", name, least, NUMBER_MAX)

    def denominator(self) -> Array:
        """Return the coefficients (5,) of the denominator of eq. 8, highest power first. Divided by m_c, they are the
        coefficients of the inverse."""
        coil = (self.m_c_kg, self.b_s_Ns_m, self.k_s_N_m)
        handle = (self.m_h_kg, self.b_s_Ns_m + self.b_u_Ns_m, self.k_s_N_m + self.k_u_N_m)
        between = np.convolve((self.b_s_Ns_m, self.k_s_N_m), (self.b_s_Ns_m, self.k_s_N_m))
        return np.asarray(np.convolve(coil, handle) - np.pad(between, (2, 0)))

    def response(self, frequency_Hz: ArrayLike) -> Complex:
        """Acceleration of the handle over force, A_h/F of eq. 8, at frequencies of any shape [1/kg].

        It approaches 1/m_h at high frequency and m_c s⁴/(k_s k_u) at low frequency.
        """
        s = 2j * np.pi * np.asarray(frequency_Hz, dtype=np.float64)
        return np.asarray(self.m_c_kg * s**4 / np.polyval(self.denominator(), s))

    def travel_response(self, frequency_Hz: ArrayLike) -> Complex:
        """Travel of the coil over force, R/F, at frequencies of any shape [m/N]; −1/k_s for a constant force."""
        s = 2j * np.pi * np.asarray(frequency_Hz, dtype=np.float64)
        force = (self.m_c_kg + self.m_h_kg) * s**2 + self.b_u_Ns_m * s + self.k_u_N_m
        return np.asarray(-force / np.polyval(self.denominator(), s))

    def state_space(self) -> tuple[Array, Array, Array, Array]:
        """State space A (4, 4), B (4, 1), C (3, 4), D (3, 1): ẋ = A x + B F, y = C x + D F.

        The state x is (x_h, ẋ_h, r, ṙ) [m, m/s]; y is the acceleration ẍ_h, the travel r and the displacement x_h.
        """
        hand = np.array([-self.k_u_N_m, -self.b_u_Ns_m, 0.0, 0.0])
        spring = np.array([0.0, 0.0, self.k_s_N_m, self.b_s_Ns_m])
        handle = (hand + spring) / self.m_h_kg
        a = np.array([[0, 1, 0, 0], handle, [0, 0, 0, 1], -spring / self.m_c_kg - handle])
        b = np.array([[0.0], [1.0 / self.m_h_kg], [0.0], [-1.0 / self.m_c_kg - 1.0 / self.m_h_kg]])
        c = np.array([handle, [0, 0, 1, 0], [1, 0, 0, 0]])
        return a, b, c, np.array([[1.0 / self.m_h_kg], [0.0], [0.0]])


# The accelerometer in the handle: delay, bandwidth, noise; and whether the force is measured.

ACCELEROMETER_NOISE_M_S2_RTHZ: Final = 150e-6 * 9.80665
"""Noise density of the accelerometer [m/s²/√Hz]: 150 µg/√Hz, x and y of Analog Devices' ADXL312 (data sheet)."""

ACCELEROMETER_HZ: Final = 1600.0
"""Bandwidth of the accelerometer, one pole [Hz]: from the same data sheet, at the highest output rate."""

DELAY_MAX_S: Final = 0.01
"""Longest supported delay of a sensor [s]: ten times the delay of a bus and a filter."""


@dataclass(frozen=True)
class Sensor:
    """Measurements that a handle provides to its compensator.

    Attributes:
        delay_s: delay of the measured acceleration behind the force, in addition to that of the pole.
        bandwidth_Hz: bandwidth of the accelerometer, one pole.
        noise_m_s2_rtHz: noise density before the pole [m/s²/√Hz].
        force_measured: whether the current of the actuator is measured. Otherwise the force is computed from the
            command.

    Raises:
        HandleError: value out of range, or not a number.
    """

    delay_s: float = 0.0
    bandwidth_Hz: float = ACCELEROMETER_HZ
    noise_m_s2_rtHz: float = ACCELEROMETER_NOISE_M_S2_RTHZ
    force_measured: bool = True

    def __post_init__(self) -> None:
        ranges = {"delay_s": (0.0, DELAY_MAX_S), "bandwidth_Hz": (10.0, 1e6), "noise_m_s2_rtHz": (0.0, 100.0)}
        for name, (least, most) in ranges.items():
            _check(self, "sensor", name, least, most)


def _check(owner: Plant | Sensor, what: str, name: str, least: float, most: float) -> None:
    """Convert a field to a number within its range."""
    given = getattr(owner, name)
    try:
        value = float(given)
    except (TypeError, ValueError):
        raise HandleError(f"{what}: {name} must be a number, is {given!r:.60}") from None
    if not least <= value <= most:
        raise HandleError(f"{what}: {name} must be {least:g} to {most:g}, is {value:g}")
    object.__setattr__(owner, name, value)
