"""What keeps a stiff wall still, and what is left of it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hapscene.device.model import DEVICES
from hapscene.renderer import Renderer
from hapscene.stability.rig import sheet
from hapscene.surface.swatch import Swatch
from hapscene_experiments.stabiliser_case import BARE, GESTURES, OUT_J, REST_M_S, STABILISERS, run_case, stabiliser

from .measuring import measured, spread_us, stroke_path, ticks_ns
from .question import Measure, Point, Question, Setting

STIFFNESSES_N_M: Final = (2000.0, 5000.0)

TOUCHED: Final = {"omni": DEVICES["omni"], "bare": BARE}
"""The Omni, and the same without friction and encoder steps."""

MM_S, MJ = (0.01, 1e4), (1e-3, 1e3)
"""What less and what more is drawn as: a loop that blows up has no number."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    names = ("none", "virtual damping", "passivity", "coupling") if quick else STABILISERS
    cases = [("omni", 2000.0)] if quick else [(d, k) for d in TOUCHED for k in STIFFNESSES_N_M]
    gestures = list(GESTURES[:1] if quick else GESTURES)
    return [
        Setting(name, f"{d}, {k / 1e3:g} N/mm", {"name": name, "device": d, "stiffness_N_m": k, "gestures": gestures})
        for name in names
        for d, k in cases
    ]


def error(name: str, device: str, stiffness_N_m: float, gestures: Sequence[str]) -> dict[str, float]:
    """The worst of some gestures of a light hand: stiffness that is left, energy out, speed where it should rest.

    A wall on which the tool never rests keeps nothing.
    """
    rows = [run_case(TOUCHED[device], gesture, stiffness_N_m, name) for gesture in gestures]
    return {
        "kept": 100.0 * min(0.0 if math.isnan(row.kept) else row.kept for row in rows),
        "energy": float(np.clip(1e3 * max(row.out_J for row in rows), *MJ)),
        "late": float(np.clip(1e3 * max(row.late_m_s for row in rows), *MM_S)),
    }


def time(name: str, device: str, stiffness_N_m: float, gestures: Sequence[str]) -> tuple[float, float]:
    chosen = stabiliser(name, TOUCHED[device], stiffness_N_m)
    limits = replace(chosen.limits, stiffness_N_m=math.inf)  # the same wall for all: only the tick's work differs
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=chosen.damping_Ns_m)
    renderer = Renderer(sheet(swatch), ("wall",), limits=limits, crease_rad=chosen.crease_rad)
    return spread_us(ticks_ns(renderer, stroke_path()))


def advice(points: Sequence[Point]) -> str:
    """What keeps most of the stiffness among those that rest and give no energy, in all cases."""
    worst: dict[str, dict[str, float]] = {}
    for p in measured(points, "kept"):
        of = worst.setdefault(p.method, {"kept": math.inf, "energy": 0.0, "late": 0.0, "us": p.median_us})
        of["kept"] = min(of["kept"], p.errors["kept"])
        of["energy"], of["late"] = max(of["energy"], p.errors["energy"]), max(of["late"], p.errors["late"])
    calm = [n for n, of in worst.items() if of["energy"] <= 1e3 * OUT_J and of["late"] <= 1e3 * REST_M_S]
    if not calm:
        least = min(worst, key=lambda n: worst[n]["energy"])
        return (
            f"None keeps all of these walls still: {least} gives least, {worst[least]['energy']:.2g} mJ. Choose "
            "softer walls, more damping in the device or a faster loop."
        )
    chosen = max(calm, key=lambda n: worst[n]["kept"])
    loud = max(worst, key=lambda n: worst[n]["energy"])
    also = [f"{n} ({worst[n]['kept']:.0f} %)" for n in calm if n != chosen]
    return (
        f"Choose {chosen}: it keeps {worst[chosen]['kept']:.0f} % of the stiffness or more and gives at most "
        f"{worst[chosen]['energy']:.2g} mJ, for a tick of {worst[chosen]['us']:.2g} µs; also still: "
        f"{'; '.join(also) or 'none'}. {loud[0].upper()}{loud[1:]} gives "
        f"{worst[loud]['energy']:.0f} mJ{' or more' if worst[loud]['energy'] >= MJ[1] else ''}. Where walls are "
        "softer than the device holds by itself, none is needed."
    )


QUESTION: Final = Question(
    name="stabiliser",
    title="What keeps a stiff wall still?",
    measures=(
        Measure("kept", "stiffness kept, worst gesture", "%", log=False, more_is_better=True),
        Measure("energy", "energy given to the hand", "mJ", 1e3 * OUT_J, "the Omni's 45 g", limit="a weak tap"),
        Measure("late", "speed where it should rest", "mm/s", 1e3 * REST_M_S, "half an encoder's noise", limit="rest"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "A light hand taps and presses a sheet and tours a ridge, at 1 kHz: an Omni, and the same without friction "
        "and encoder steps (bare); the worst of the three gestures. Time of a whole tick with a wall, all sent the "
        "same way."
    ),
)
