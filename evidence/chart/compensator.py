"""The question of the handle's compensator and its sensor."""

from collections.abc import Sequence
from functools import cache
from typing import Any, Final

import numpy as np

from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.handle.playback import run

from ..bench.handle import CONDITIONS, RATE_HZ, SPREAD, judge, signals
from .measuring import Array, call_us, enough
from .question import Measure, Point, Question, Setting

SENSORS: Final = (
    "known delay of 0 ms",
    "known delay of 1 ms",
    "delay 0.1 ms longer than assumed",
    "half the assumed bandwidth",
)
"""Conditions of `evidence.bench.handle.CONDITIONS` for the adaptive compensator; the others use no sensor."""

SIGNALS: Final = ("texture", "tap")

HANDLES, QUICK_HANDLES, CHUNK = 20, 2, 200
"""Number of random handles, with and without --quick; samples per timed call [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    handles = QUICK_HANDLES if quick else HANDLES
    without = [
        Setting(name, "no sensor", {"compensator": name, "sensor_name": "", "handles": handles})
        for name, made in COMPENSATORS.items()
        if not made.adapts
    ]
    adaptive = [
        Setting(name, sensor, {"compensator": name, "sensor_name": sensor, "handles": handles})
        for name, made in COMPENSATORS.items()
        if made.adapts
        for sensor in (SENSORS[:2] if quick else SENSORS)
    ]
    return without + adaptive


@cache
def _signals() -> dict[str, Array]:
    return signals()


def _sensor(name: str) -> dict[str, Any]:
    """Return the sensor of a condition and the data assumed about it, as arguments; empty without a condition."""
    return {"sensor": CONDITIONS[name].sensor, "nominal_sensor": CONDITIONS[name].believed} if name else {}


def error(compensator: str, sensor_name: str, handles: int) -> dict[str, float]:
    """Return median and 95th percentile of the spectrogram errors [%] of handles with inexact parameters."""
    found: dict[str, float] = {}
    for signal in SIGNALS:
        judged = judge(_signals()[signal], compensator, handles, **_sensor(sensor_name))
        found |= {signal: 100.0 * judged.median, f"{signal}_p95": 100.0 * judged.p95}
    return found


def time(compensator: str, sensor_name: str, handles: int) -> tuple[float, float]:
    handle = new_handle(Plant(), Plant(), compensator, RATE_HZ, **_sensor(sensor_name))[0]
    out, part = np.zeros((4, CHUNK)), _signals()["texture"][:CHUNK]
    return call_us(lambda: run(handle, part, out), CHUNK, 1000)


def advice(points: Sequence[Point]) -> str:
    """Recommend a compensator with a sensor and one without, and state how much the sensor may differ."""
    plain = enough([p for p in points if p.label == "no sensor"], "texture", 0.0)
    adaptive = [p for p in points if p.label != "no sensor"]
    one, worst = (choose(adaptive, key=lambda p: p.errors["texture"]) for choose in (min, max))
    better = worst.errors["texture"] < plain.errors["texture"]
    return (
        f"With an accelerometer on the handle use {one.method}: error {one.errors['texture']:.2g} % ({one.label}; "
        f"texture, median handle) to {worst.errors['texture']:.2g} % ({worst.label}), {one.median_us:.2g} µs per "
        f"sample including the simulated handle. Without one use {plain.method}: {plain.errors['texture']:.2g} %, "
        f"{plain.median_us:.2g} µs. "
        + (
            "A sensor that differs from its assumed data is still better than none."
            if better
            else f"A sensor that differs from its assumed data ({worst.label}) is worse than none."
        )
    )


QUESTION: Final = Question(
    name="compensator",
    title="Compensator of the handle, and its sensor",
    measures=(
        Measure("texture", "texture: error, median handle", "%"),
        Measure("texture_p95", "texture: error, 95 % of handles", "%"),
        Measure("tap", "tap: error, median handle", "%"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"Handles simulated at {RATE_HZ / 1e3:g} kHz whose six parameters differ by up to {100 * SPREAD:.0f} % from "
        "those that the compensator is made for. Spectrogram error [% of the desired signal] of wood's texture at 1 N "
        "and 0.1 m/s, and of taps of 20 m/s²."
    ),
    per="sample",
)
