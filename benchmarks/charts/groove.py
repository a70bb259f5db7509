"""The question of the groove: the exact active set against alternating projection, as `projection` measures them."""

from collections.abc import Sequence
from typing import Final

from hapscene.clock import new_clock
from hapscene.contact.planes import nearest
from hapscene.geometry import norm

from ..projection import ANGLES_DEG, TOOL_M, alternating_error_m, groove, time_alternating_ns, time_exact_ns
from .question import Measure, Point, Question, Setting

STEPS: Final = (1, 4, 16, 64, 256, 1024)
"""Projections made [count]."""

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
    taken = [time_alternating_ns(planes, steps, clock) if steps else time_exact_ns(planes, clock) for _ in range(30)]
    taken.sort()
    return taken[len(taken) // 2] * 1e-3, taken[-1] * 1e-3


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
