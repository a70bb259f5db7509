"""The proxy between two planes: hapscene's exact active set against alternating projection, error against time.

Alternating projection (von Neumann 1933; how a proxy is often solved, for it is two lines long) goes to the one plane,
then to the other, until it is near the groove's edge. Each step leaves cos α of the error, α the groove's angle: what
is quick at a right angle never arrives in a sharp groove.
"""

import math
from typing import Any, Final

from hapscene.clock import new_clock, now_ns
from hapscene.contact.planes import nearest
from hapscene.contact.world import PROXY
from hapscene.geometry import Vector, norm
from hapscene.native import native
from hapscene.records import records

from .sheet import Sheet

ANGLES_DEG: Final = (60.0, 20.0, 10.0)
"""Angles of the groove: between its two faces, through the air [°]."""

STEPS: Final = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)
"""Projections made [count]."""

TOOL_M: Final[Vector] = (0.3e-3, 0.0, -2e-3)
"""The tool, 2 mm below the edge at the origin, a little to the side [m]: the closest allowed point is the origin."""

_CALLS: Final = 2000


def measure_projection(sheet: Sheet) -> None:
    """Note time and error of both at each angle."""
    for angle_deg in ANGLES_DEG:
        name = f"groove {angle_deg:g}°"
        planes = groove(angle_deg)
        for steps in STEPS:
            least_ns = min(time_alternating_ns(planes, steps, new_clock()) for _ in range(5))
            sheet.add(name, f"{steps} projections time", least_ns, "ns")
            sheet.add(name, f"{steps} projections error", alternating_error_m(planes, steps), "m")
        least_ns = min(time_exact_ns(planes, new_clock()) for _ in range(5))
        sheet.add(name, "active set time", least_ns, "ns")
        sheet.add(name, "active set error", norm(nearest(planes[0], TOOL_M, 0.0)[1]), "m")


def groove(angle_deg: float) -> Any:
    """Planes of a groove along y, its edge at the origin, open upwards: a `PROXY` record."""
    proxy = records(1, PROXY)
    half = math.radians(angle_deg) / 2
    proxy["nhat_W"][0, :2] = (math.cos(half), 0.0, math.sin(half)), (-math.cos(half), 0.0, math.sin(half))
    proxy["skin_m"] = 1e-6
    proxy["count"] = 2
    return proxy


def alternating_error_m(planes: Any, steps: int) -> float:
    """Distance from the right point after a number of projections [m]."""
    return norm(alternate(planes[0], TOOL_M, steps))


@native
def alternate(proxy: Any, p: Vector, steps: int) -> Vector:
    """The point `p` projected in turn onto the planes that it lies behind."""
    for step in range(steps):
        n = proxy.nhat_W[step % proxy.count]
        short = proxy.offset_m[step % proxy.count] - (n[0] * p[0] + n[1] * p[1] + n[2] * p[2])
        if short > 0.0:
            p = (p[0] + short * n[0], p[1] + short * n[1], p[2] + short * n[2])
    return p


def time_alternating_ns(planes: Any, steps: int, clock: Any) -> float:
    """Time of so many projections, of `_CALLS` one after the other [ns]."""
    return float(_time_alternating(planes, steps, clock)) / _CALLS


def time_exact_ns(planes: Any, clock: Any) -> float:
    """Time of the active set, likewise [ns]."""
    return float(_time_exact(planes, clock)) / _CALLS


@native
def _time_alternating(planes: Any, steps: int, clock: Any) -> int:
    start = now_ns(clock)
    x = 0.0
    for _ in range(_CALLS):  # each call starts where the last one ended, to rounding, so that none is left out
        x = 1e-30 * alternate(planes[0], (0.3e-3 + x, 0.0, -2e-3), steps)[0]
    return int(now_ns(clock) - start) + int(x)


@native
def _time_exact(planes: Any, clock: Any) -> int:
    start = now_ns(clock)
    x = 0.0
    for _ in range(_CALLS):
        x = 1e-30 * nearest(planes[0], (0.3e-3 + x, 0.0, -2e-3), 0.0)[1][0]
    return int(now_ns(clock) - start) + int(x)
