"""The tool at the tip of a device: its handle's direction, its acceleration along it, and how vibration moves it."""

import math
from typing import Any, Final

import numpy as np

from hapscene.contact.geometry import Vector
from hapscene.contact.world import records
from hapscene.native import native

SHAKE_HZ: Final = 10.0
"""Corner below which a vibration's displacement is let go [Hz]: keeps its double integral from drifting. Half of where
the acceleration channel begins."""

COUPLING_HZ: Final = 12.0
"""Corner of the high-pass, Butterworth of second order, through which the accelerometer is heard [Hz]: gravity and the
hand's own motion are none of the handle's, which has no travel for them. 6 % are lost at 20 Hz."""

TOOL: Final = np.dtype(
    [
        ("axis_W", "f8", (3,)),  # along the handle, a unit vector
        ("before_m", "f8"),  # along it: the tip a sample ago
        ("before_m_s", "f8"),  # and its velocity
        ("shake_m", "f8"),  # displacement by vibration
        ("shake_m_s", "f8"),
        ("slow", "f8", (2,)),  # state of the accelerometer's high-pass
    ],
    align=True,
)
"""What is remembered of a tool from sample to sample."""


def new_tool(p_W_m: Any, axis_W: Any) -> Any:
    """(1,) TOOL at rest at `p_W_m` (3,), with the handle along `axis_W` (3,)."""
    tool = records(1, TOOL)
    tool.axis_W = np.asarray(axis_W, np.float64) / np.linalg.norm(axis_W)
    tool.before_m = tool.axis_W[0] @ np.asarray(p_W_m)
    return tool


@native
def accelerate(tool: Any, p_W_m: Vector, h_s: float) -> float:
    """Acceleration of the tip along the handle in the sample that ended at `p_W_m` [m/s²]: its second difference."""
    n = tool.axis_W
    x = n[0] * p_W_m[0] + n[1] * p_W_m[1] + n[2] * p_W_m[2]
    v = (x - tool.before_m) / h_s
    a = (v - tool.before_m_s) / h_s
    tool.before_m, tool.before_m_s = x, v
    return float(a)


@native
def couple(tool: Any, a_m_s2: float, h_s: float) -> float:
    """A sample of acceleration as the accelerometer gives it, high-passed [m/s²].

    Trapezoidal state-variable filter (Zavalishin 2012, "The Art of VA Filter Design", 4.4): exact at its corner.
    """
    g = math.tan(math.pi * COUPLING_HZ * h_s)
    slow, damping = tool.slow, math.sqrt(2.0)
    high = (a_m_s2 - (damping + g) * slow[0] - slow[1]) / (1.0 + g * (damping + g))
    band = g * high + slow[0]
    low = g * band + slow[1]
    slow[0], slow[1] = g * high + band, g * band + low
    return float(high)


@native
def shake(tool: Any, a_m_s2: float, h_s: float) -> None:
    """Move the tool by a sample of vibration [m/s²]."""
    leak = 2.0 * math.pi * SHAKE_HZ * h_s
    tool.shake_m_s += a_m_s2 * h_s - leak * tool.shake_m_s
    tool.shake_m += tool.shake_m_s * h_s - leak * tool.shake_m
