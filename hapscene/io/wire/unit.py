"""Units of the quantities in recordings and from probes."""

import math
from collections.abc import Mapping
from typing import Final

__all__ = ["UNITS"]

_LENGTH: Final = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_FORCE: Final = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3}
_ANGLE: Final = {"deg": math.pi / 180.0, "°": math.pi / 180.0, "rad": 1.0}

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "acceleration": {"m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "mm/s2": 1e-3},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "position": _LENGTH,
    "force": _FORCE,
    "tangential_force": _FORCE,
    "friction": {"1": 1.0},
    "depth": _LENGTH,
    "torque": {"Nm": 1.0, "N·m": 1.0, "mNm": 1e-3, "mN·m": 1e-3},
    "grip_force": _FORCE,
    "contact_angle": _ANGLE,
    "direction": _ANGLE,
    "orientation": {"1": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
}
"""Factor to SI units for each unit of each quantity. "friction" is the ratio of tangential to normal force. "depth"
increases into the surface. "position" is along the surface; speed is its derivative, and the sliding direction follows
from its first two axes. "contact_angle" is the angle between the axis of the tool and the surface normal, 0 if upright.
Without it, the angle is computed from "orientation", the quaternion w, x, y, z of the tool relative to the surface,
whose z axes are the axis of the tool and the normal."""
