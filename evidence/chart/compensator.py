"""The question of the handle's compensator and its sensor."""

from collections.abc import Sequence
from functools import cache
from time import perf_counter_ns
from typing import Any, Final

import numpy as np

from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.handle_loop import run
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import ACCELEROMETER_HZ, Plant, Sensor
from hapscene.perception import BAND_DB

from ..bench.handle import RATE_HZ, SPREAD, judge, signals
from .measuring import ISRAR, Array, spread_us
from .question import Measure, Point, Question, Setting

SENSORS: Final = {
    "known delay of 0 ms": (Sensor(), Sensor()),
    "known delay of 1 ms": (Sensor(delay_s=1e-3), Sensor(delay_s=1e-3)),
    "delay 0.1 ms longer than assumed": (Sensor(delay_s=0.4e-3), Sensor(delay_s=0.3e-3)),
    "half the assumed bandwidth": (Sensor(bandwidth_Hz=0.5 * ACCELEROMETER_HZ), Sensor()),
}
"""Actual and assumed sensor of the adaptive compensator, by condition; the other compensators use no sensor."""

LIMIT: Final = 100.0 * (10.0 ** (BAND_DB / 20.0) - 1.0)
"""Just-noticeable error of the amplitude [%]."""

SIGNALS: Final = ("texture", "tap")

HANDLES, CHUNK, CALLS = 20, 200, 1000
"""Number of random handles; samples per timed call; timed calls [count]."""


def settings(scene_file: str | None) -> list[Setting]:
    return [
        Setting(
            *("Compensator of the handle", name, ""),
            {"compensator": name, "sensor_name": sensor, "handles": HANDLES},
            case=sensor,
            default=name == "adaptive",
        )
        for name, made in COMPENSATORS.items()
        for sensor in (SENSORS if made.adapts else ("",))
    ]


@cache
def _signals() -> dict[str, Array]:
    return signals()


def _sensor(name: str) -> dict[str, Any]:
    """Return the sensor of a condition and the data assumed about it, as arguments; empty without a condition."""
    return dict(zip(("sensor", "nominal_sensor"), SENSORS[name], strict=True)) if name else {}


def error(compensator: str, sensor_name: str, handles: int) -> dict[str, float]:
    """Return the 95th percentile of the spectrogram errors [%] of handles with inexact parameters."""
    return {
        signal: 100.0 * judge(_signals()[signal], compensator, handles, **_sensor(sensor_name)).p95
        for signal in SIGNALS
    }


def time(compensator: str, sensor_name: str, handles: int) -> tuple[float, float]:
    handle = new_handle(Plant(), Plant(), compensator, RATE_HZ, **_sensor(sensor_name))[0]
    out, part = np.zeros((4, CHUNK)), _signals()["texture"][:CHUNK]
    times_ns = []
    for _ in range(CALLS + 1):
        start_ns = perf_counter_ns()
        run(handle, part, out)
        times_ns.append(perf_counter_ns() - start_ns)
    return spread_us(1e-3 * RATE_HZ / CHUNK * np.array(times_ns[1:]))  # the first call compiles


def caveat(used: Sequence[Point], every: Sequence[Point]) -> str:
    """Return whether the compensator needs a sensor."""
    return "handles without an accelerometer" if any(p.case for p in used) else ""


QUESTION: Final = Question(
    name="compensator",
    title="Compensator of the handle, and its sensor",
    measures=(
        Measure("texture", "texture, 95 % of handles", "%", LIMIT, ISRAR),
        Measure("tap", "tap, 95 % of handles", "%", LIMIT, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    caveat=caveat,
    conditions=(
        f"Handles simulated at {RATE_HZ / 1e3:g} kHz whose six parameters differ by up to {100 * SPREAD:.0f} % from "
        "those that the compensator is made for. Spectrogram error [% of the desired signal] of wood's texture at 1 N "
        "and 0.1 m/s, and of taps of 20 m/s². The adaptive compensator uses a sensor; the "
        "largest error over several sensors counts. Time: with the simulated handle."
    ),
)
