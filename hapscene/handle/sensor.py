"""The accelerometer in the handle: delay, bandwidth, noise; and whether the force is measured."""

from dataclasses import dataclass
from typing import Final

from hapscene.errors import HandleError

__all__ = ["ACCELEROMETER_HZ", "ACCELEROMETER_NOISE_M_S2_RTHZ", "DELAY_MAX_S", "Sensor"]

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
            given = getattr(self, name)
            try:
                value = float(given)
            except (TypeError, ValueError):
                raise HandleError(f"sensor: {name} must be a number, is {given!r:.60}") from None
            if not least <= value <= most:
                raise HandleError(f"sensor: {name} must be {least:g} to {most:g}, is {value:g}")
            object.__setattr__(self, name, value)
