"""Units of the quantities in recordings and from probes."""

from collections.abc import Mapping
from typing import Final

__all__ = ["UNITS"]

_LENGTH: Final = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_FORCE: Final = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3}

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "acceleration": {"m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "mm/s2": 1e-3},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "position": _LENGTH,
    "force": _FORCE,
    "tangential_force": _FORCE,
    "friction": {"1": 1.0},
    "depth": _LENGTH,
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
}
"""Factor to SI units for each unit of each quantity. "friction" is the ratio of tangential to normal force. "depth"
increases into the surface. "position" is along the surface; speed is its derivative."""
