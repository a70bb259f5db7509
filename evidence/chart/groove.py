"""How the proxy is found between two planes: the exact active set against alternating projection.

Alternating projection (von Neumann 1933) goes to the one plane, then to the other, until it is near the groove's edge.
Each step leaves cos α of the error, α the groove's angle: fast at a right angle, endless in a sharp groove.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

from hapscene.clock import new_clock, now_ns
from hapscene.compiled.native import native
from hapscene.contact.planes import nearest
from hapscene.contact.world import PROXY
from hapscene.geometry import Vector, norm
from hapscene.records import records

from .question import Measure, Point, Question, Setting

ANGLES_DEG: Final = (60.0, 20.0, 10.0)
"""Angles of the groove: between its two faces, through the air [°]."""

STEPS: Final = (1, 4, 16, 64, 256, 1024)
"""Projections made [count]."""

TOOL_M: Final[Vector] = (0.3e-3, 0.0, -2e-3)
"""The tool, 2 mm below the edge at the origin, a little to the side [m]: the closest allowed point is the origin."""

CALLS: Final = 2000
"""Solutions that are timed at once [count]."""

EXACT: Final = "active set"

ROUNDING_M: Final = 1e-15
"""Under which an error is that of float64 at a millimetre's scale [m]: it is drawn as this, for 0 has no place."""


def settings(quick: bool, scene: str | None) -> Sequence[Setting]:
    angles = ANGLES_DEG[::2] if quick else ANGLES_DEG
    found = [Setting(EXACT, f"{angle:g}°", {"angle_deg": angle, "steps": 0}) for angle in angles]
    return found + [
        Setting(f"projection, {angle:g}°", f"{steps}", {"angle_deg": angle, "steps": steps})
        for angle in angles
        for steps in (STEPS[::2] if quick else STEPS)
    ]


def error(angle_deg: float, steps: int) -> dict[str, float]:
    """Distance of the proxy from the groove's edge, the closest point there is; no steps for the active set."""
    planes = groove(angle_deg)
    off_m = alternating_error_m(planes, steps) if steps else norm(nearest(planes[0], TOOL_M, 0.0)[1])
    return {"off": max(off_m, ROUNDING_M) * 1e3}


def time(angle_deg: float, steps: int) -> tuple[float, float]:
    planes, clock = groove(angle_deg), new_clock()
    taken = [time_ns(planes, steps, clock) for _ in range(30)]
    taken.sort()
    return taken[len(taken) // 2] * 1e-3, taken[-1] * 1e-3


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


def time_ns(planes: Any, steps: int, clock: Any) -> float:
    """Time of so many projections, or of the active set where `steps` is 0 [ns]."""
    return float(_time_alternating(planes, steps, clock) if steps else _time_exact(planes, clock)) / CALLS


@native
def _time_alternating(planes: Any, steps: int, clock: Any) -> int:
    start = now_ns(clock)
    x = 0.0
    for _ in range(CALLS):  # each call starts where the last one ended, to rounding, so that none is left out
        x = 1e-30 * alternate(planes[0], (0.3e-3 + x, 0.0, -2e-3), steps)[0]
    return int(now_ns(clock) - start) + int(x)


@native
def _time_exact(planes: Any, clock: Any) -> int:
    start = now_ns(clock)
    x = 0.0
    for _ in range(CALLS):
        x = 1e-30 * nearest(planes[0], (0.3e-3 + x, 0.0, -2e-3), 0.0)[1][0]
    return int(now_ns(clock) - start) + int(x)


def advice(points: Sequence[Point]) -> str:
    exact = max(p.median_us for p in points if p.method == EXACT)
    worst = max((p.errors["off"] for p in points if "projection" in p.method and p.median_us <= exact), default=0.0)
    return (
        f"Take the active set: it is there in {exact:.2f} µs at every angle, to rounding, where projection is still "
        f"up to {worst:.2g} mm off in as much time. Projection is enough only where no two faces meet at less than a "
        "right angle."
    )


QUESTION: Final = Question(
    name="groove",
    title="How is the proxy found between two planes?",
    measures=(Measure("off", "proxy from the closest point", "mm"),),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions="A tool 2 mm below the edge of a groove of 60, 20 or 10°; the closest allowed point is the edge itself, "
    "known beforehand.",
    per="solution",
)
