"""Which compensator a handle needs, with which sensor."""

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

HEARD: Final = {
    "known delay of 0 ms": "0 ms late",
    "known delay of 1 ms": "1 ms late",
    "0.1 ms later than believed": "0.1 ms later than believed",
    "pole at half of what is believed": "half the band believed",
}
"""Sensors of `evidence.bench.handle.CONDITIONS` that the learning compensator is tried with; the others have none."""

SIGNALS: Final = ("texture", "tap")

HANDLES, QUICK_HANDLES, CHUNK = 20, 2, 200
"""Handles that are drawn, in all and in short, and samples that are timed at once [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    handles = QUICK_HANDLES if quick else HANDLES
    deaf = [
        Setting(name, "no sensor", {"compensator": name, "heard": "", "handles": handles})
        for name, made in COMPENSATORS.items()
        if not made.adapts
    ]
    heard = [
        Setting(name, HEARD[sensor], {"compensator": name, "heard": sensor, "handles": handles})
        for name, made in COMPENSATORS.items()
        if made.adapts
        for sensor in (list(HEARD)[:2] if quick else HEARD)
    ]
    return deaf + heard


@cache
def _signals() -> dict[str, Array]:
    return signals()


def error(compensator: str, heard: str, handles: int) -> dict[str, float]:
    """Spectrogram errors [%] of handles whose parameters are all off, median; and what 95 % of them stay below."""
    sensor = CONDITIONS[heard] if heard else None
    found: dict[str, float] = {}
    for signal in SIGNALS:
        judged = judge(
            _signals()[signal],
            compensator,
            handles,
            sensor.sensor if sensor else None,
            sensor.believed if sensor else None,
        )
        found |= {signal: 100.0 * judged.median, f"{signal}_p95": 100.0 * judged.p95}
    return found


def time(compensator: str, heard: str, handles: int) -> tuple[float, float]:
    sensor = CONDITIONS[heard] if heard else None
    known: dict[str, Any] = {"sensor": sensor.sensor, "nominal_sensor": sensor.believed} if sensor else {}
    handle = new_handle(Plant(), Plant(), compensator, RATE_HZ, **known)[0]
    out, part = np.zeros((4, CHUNK)), _signals()["texture"][:CHUNK]
    return call_us(lambda: run(handle, part, out), CHUNK, 1000)


def advice(points: Sequence[Point]) -> str:
    """The nearest that hears nothing and the learning one, by how much its sensor matters."""
    deaf = enough([p for p in points if p.label == "no sensor"], "texture", 0.0)
    learns = [p for p in points if p.label != "no sensor"]
    one, worst = (choose(learns, key=lambda p: p.errors["texture"]) for choose in (min, max))
    better = worst.errors["texture"] < deaf.errors["texture"]
    return (
        f"Choose {one.method} where an accelerometer is on the handle: {one.errors['texture']:.2g} % of a texture is "
        f"missed in the median handle ({one.label}), and {worst.errors['texture']:.2g} % at worst ({worst.label}), "
        f"for {one.median_us:.2g} µs a sample with the handle simulated. The best without one is {deaf.method}: "
        f"{deaf.errors['texture']:.2g} %, {deaf.median_us:.2g} µs. "
        + (
            "Even a sensor that is not what it is taken for is worth its place."
            if better
            else f"With a sensor that is not what it is taken for ({worst.label}), rather none."
        )
    )


QUESTION: Final = Question(
    name="compensator",
    title="Which compensator, with which sensor?",
    measures=(
        Measure("texture", "texture missed, median handle", "%"),
        Measure("texture_p95", "texture missed, 95 % of handles", "%"),
        Measure("tap", "tap missed, median handle", "%"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"Handles simulated at {RATE_HZ / 1e3:g} kHz, all six parameters up to {100 * SPREAD:.0f} % off the one that "
        "the compensator was made for: spectrogram error of wood's texture at 1 N and 0.1 m/s, and of taps of 20 "
        "m/s². No output is 100 %; the handle of the haptography paper missed 48 % of two taps and five drags on "
        "wood."
    ),
    per="sample",
)
