"""The question of bodies: what a crowd costs the contact, at rest and while it moves, as `crowd` measures it."""

from collections.abc import Sequence
from typing import Final

from ..crowd import measure_bodies, measure_bound
from ..sheet import Sheet
from .exponent import fit_exponent
from .question import Measure, Point, Question, Setting, no_time

COUNTS: Final = (1, 10, 30, 100, 300, 1000)

STILL, BOUND = "at rest", "all moving, step from Python"


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    counts = COUNTS[::2] if quick else COUNTS
    return [
        Setting(method, f"{count}", {"count": count, "moving": method == BOUND, "ticks": 2000 if quick else 5000})
        for method in (STILL, BOUND)
        for count in counts
    ]


def error(count: int, moving: bool, ticks: int) -> dict[str, float]:
    """Costs of that many bodies [µs]."""
    sheet = Sheet()
    if moving:
        measure_bound(sheet, count, 3)
        return {"work": count, "step": sheet.number(f"moving {count}", "step with bound bodies")}
    name = measure_bodies(sheet, count, ticks, 3)
    found = {"work": float(count), "contact": sheet.number(name, "contact median")}
    found["late"] = sheet.number(name, "contact p99")
    if (name, "placing the moving bodies") in sheet:
        found["placing"] = sheet.number(name, "placing the moving bodies")
    return found


def advice(points: Sequence[Point]) -> str:
    still = [p for p in points if p.method == STILL]
    moving = [p for p in points if p.method == BOUND]
    steep = fit_exponent([p.errors["work"] for p in still], [p.errors["contact"] for p in still])
    one, all_ = moving[0].errors["step"], moving[-1].errors["step"]
    return (
        f"Bodies at rest are nearly free: the contact grows as {steep.words()}. Those that move cost {one:.2g} µs a "
        f"step for one and {all_:.3g} for {moving[-1].label}: give poses to those that move alone, and merge what "
        "never does only where a thousand of them stand in reach at once."
    )


QUESTION: Final = Question(
    name="bodies",
    title="How many bodies may a scene have?",
    measures=(
        Measure("contact", "contact, median", "µs"),
        Measure("late", "contact, p99", "µs"),
        Measure("placing", "placing a tenth of the bodies, which move", "µs"),
        Measure("step", "a whole step from Python while all bodies move", "µs"),
    ),
    settings=settings,
    error=error,
    time=no_time,
    advice=advice,
    conditions="Spheres of 1.3 k triangles on a grid; the tool slides over the first.",
    growth=True,
)
