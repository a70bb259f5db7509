"""Fields and fixtures that are too stiff for their device: where a guide rings, a magnet hums and a viscosity kicks.

A tool in a field is a mass on a spring that the tick holds, so the limits of walls are theirs: W1 and W2 of
`hapscene.stability.closed_form`. Beyond, a field hums and does not diverge, for it ends at its reach.
"""

import math
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hapscene.constants import TICK_S
from hapscene.device.hand import Grip
from hapscene.device.point import PointMass
from hapscene.stability.answer import Answer
from hapscene.stability.closed_form import limit_of_small_motion, limit_with_one_delay, limit_without_delay
from hapscene.stability.critical import growth
from hapscene.stability.rig import sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.field_frame import EASE_S, FADED_MOST
from hapscene.surface.swatch import Swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.twin import Twin
from hapscene.view.palette import INK, OKABE_ITO

Array = NDArray[np.float64]

HERE_M: Final = (0.0, 0.0, 0.05)
"""Where the field stands: off all surfaces."""

REACH_M: Final = 0.01
"""How far it goes [m]: the default of guide and magnet."""

MASS_KG: Final = 0.045
"""The tool: an Omni as a point mass, without its friction."""

DAMPING_NS_M: Final = 0.1
"""And its damping, as `hapscene.device.model` assumes it [N·s/m]."""

SMALL: Final = 1e-5
"""Motion that is small, over the reach [1]: the field is a spring to 1e-10 there."""

LEAD: Final = Grip(1e7, 1e3)
"""The hand that holds the tool while the field rises [N/m, N·s/m]."""

SAMPLES: Final = 240
"""Ticks over which small motion is looked at [count]."""

FIELDS: Final[dict[str, tuple[str, dict[str, Any], str, float]]] = {
    "guide to a point": ("guide", {"points_m": HERE_M}, "stiffness_N_m", 1.0),
    "forbidden half space": (
        "guide",
        {"points_m": HERE_M, "normal": (1.0, 0.0, 0.0), "repelling": 1.0},
        "stiffness_N_m",
        1.0,
    ),
    "magnet": ("magnet", {"points_m": [HERE_M]}, "strength_N", FADED_MOST * REACH_M),
}
"""Effect, settings, and the number that is stiffness times the last [1 or m]."""

HUMS: Final = (1.3, 1.6, 2.0, 2.5)
"""Stiffness over the critical at which a magnet's hum is looked at [1]."""


@cache
def _twin(field: str, damping_Ns_m: float, delay_ticks: int) -> Twin:
    effect, settings, _, _ = FIELDS[field]
    tool = PointMass(MASS_KG, damping_Ns_m)
    return Twin(
        sheet(Swatch("wall")),
        tool,
        effects=(effect,),
        settings={effect: {**settings, "reach_m": REACH_M}},
        tick_s=TICK_S,
        a_rate_Hz=1.0 / TICK_S,
        delay_ticks=delay_ticks,
    )


def let_go(field: str, stiffness_N_m: float, off_m: float, count: int, damping_Ns_m: float, delay: int = 0) -> Array:
    """The tool's way (count,) from the field's middle [m], held `off_m` aside until it has risen, then let go."""
    effect, _, name, scale = FIELDS[field]
    twin = _twin(field, damping_Ns_m, delay)
    twin.renderer.tune_field(effect, **{name: scale * stiffness_N_m})
    push_W_N = (-stiffness_N_m * REACH_M if field == "forbidden half space" else 0.0, 0.0, 0.0)
    start = (off_m, *HERE_M[1:])
    twin.reset(start)
    twin.run(Intent.hold(start, round(1.2 * EASE_S / TICK_S) + delay, LEAD, push_W_N=push_W_N))
    return twin.run(Intent.hold(start, count, "none", push_W_N=push_W_N)).p_W_m[:, 0]


def critical(field: str, damping_Ns_m: float = DAMPING_NS_M, delay_ticks: int = 0) -> float:
    """The stiffness of a field beyond which small motion in it grows [N/m], by simulation."""

    def grows(stiffness_N_m: float) -> float:
        return growth(
            let_go(field, stiffness_N_m, SMALL * REACH_M, SAMPLES, damping_Ns_m, delay_ticks), delay_ticks + 2
        )

    low = damping_Ns_m / TICK_S / (4.0 + 8.0 * delay_ticks)
    high = 2.0 * low
    while grows(high) < 0.0:
        low, high = high, 2.0 * high
    return float(brentq(grows, low, high, rtol=1e-9))


def largest_viscosity(cutoff_Hz: float) -> float:
    """The damping of `viscosity` beyond which a free tool without damping of its own is kicked [N·s/m]."""
    twin = Twin(
        sheet(Swatch("wall")),
        PointMass(MASS_KG),
        effects=("viscosity",),
        settings={"viscosity": {"cutoff_Hz": cutoff_Hz}},
        a_rate_Hz=1.0 / TICK_S,
    )

    def grows(damping_Ns_m: float) -> float:
        twin.renderer.tune_field("viscosity", damping_Ns_m=damping_Ns_m)
        twin.reset(HERE_M, (1e-3, 0.0, 0.0))
        return growth(np.diff(twin.run(Intent.hold(HERE_M, 60, "none")).p_W_m[:, 0]), 2)

    return float(brentq(grows, 0.5 * MASS_KG / TICK_S, 2.2 * MASS_KG / TICK_S, rtol=1e-9))


@cache
def balance(amplitude: float) -> float:
    """Stiffness over the critical at which a magnet hums with that amplitude, over its reach [1].

    Where a cycle gains nothing: the force f, half a tick late, gives T/2 ∫ f'(x) v dx, the damper takes b ∫ v dx, and
    b = K_critical T/2. v(x) is that of the swing without either, by the magnet's potential.
    """
    x = amplitude * np.sin(0.5 * np.pi * (np.arange(400) + 0.5) / 400)
    speed = np.sqrt((1.0 - x**2) ** 3 - (1.0 - amplitude**2) ** 3) * np.sqrt(amplitude**2 - x**2)  # dx is in the last
    return float(speed.sum() / (speed * (1.0 - 6.0 * x**2 + 5.0 * x**4)).sum())


def hum_m(ratio: float) -> float:
    """Amplitude of a magnet's hum whose stiffness is that many times the critical [m]; NaN where it throws out."""
    if ratio >= balance(1.0):
        return math.nan
    return REACH_M * float(brentq(lambda a: balance(a) - ratio, 1e-6, 1.0)) if ratio > 1.0 else 0.0


def hum(ratio: float, seconds: float = 8.0) -> float:
    """The same, by simulation."""
    stiffness = ratio * limit_without_delay(MASS_KG, DAMPING_NS_M, TICK_S)
    x = let_go("magnet", stiffness, 0.2 * REACH_M, round(seconds / TICK_S), DAMPING_NS_M)
    return float(np.abs(x[-500:]).max())


def field_cases() -> list[Answer]:
    """All of them, in some seconds."""
    rows = []
    for field in FIELDS:
        for delay, expected in ((0, limit_without_delay), (1, limit_with_one_delay)):
            known = expected(MASS_KG, DAMPING_NS_M, TICK_S)
            what = f"{field}: stiffness from which it rings, {delay} ticks late [N/m]"
            rows.append(Answer(f"W{1 + delay}-{field}", what, known, critical(field, delay_ticks=delay), 1e-6))
    for cutoff_Hz in (50.0, 500.0):
        what = f"viscosity, cut-off {cutoff_Hz:g} Hz: most damping, 2 m/T [N·s/m]"
        rows.append(
            Answer(f"viscosity-{cutoff_Hz:g}", what, 2.0 * MASS_KG / TICK_S, largest_viscosity(cutoff_Hz), 1e-6)
        )
    for ratio in HUMS:
        what = f"magnet {ratio:g} times as stiff: amplitude of its hum [mm]"
        rows.append(Answer(f"hum-{ratio:g}", what, 1e3 * hum_m(ratio), 1e3 * hum(ratio), 0.01))
    for share in (0.9, 1.1):
        what = f"at {share:g} of the stiffness that throws the tool out: thrown (1 yes, 0 no) [1]"
        thrown = hum(share * balance(1.0), 4.0) > REACH_M
        rows.append(Answer(f"hum-thrown-{share:g}", what, float(share > 1.0), float(thrown), 0.0))
    return rows


def draw_fields(path: Path) -> None:
    """Chart: limits over the device's damping against the closed form, and the hum beyond it."""

    def draw(_: Any, axes: Any) -> None:
        left, right = axes[0]
        dampings = np.geomspace(0.02, 2.0, 7)
        line = np.geomspace(0.015, 2.6, 60)
        for delay, style in ((0, "-"), (1, "--")):
            known = [limit_of_small_motion(MASS_KG, b, TICK_S, delay) for b in line]
            left.plot(
                line, known, style, color=INK, linewidth=1.2, label=f"closed form, {('in time', 'a tick late')[delay]}"
            )
        for field, (colour, marker) in zip(FIELDS, (("blue", "o"), ("green", "s"), ("vermilion", "D")), strict=True):
            x, y = zip(*((b, critical(field, b, d)) for b in dampings for d in (0, 1)), strict=True)
            size = 5 + 2 * "os D".index(marker)  # all three lie on one another
            left.plot(x, y, marker, color=OKABE_ITO[colour], fillstyle="none", markersize=size, label=field)
        rings = [limit_without_delay(MASS_KG, b, TICK_S) for b in line]
        left.fill_between(line, rings, 1e4, color=OKABE_ITO["vermilion"], alpha=0.12, linewidth=0)
        left.text(0.022, 2500.0, "rings", color=OKABE_ITO["vermilion"])
        left.set(xscale="log", yscale="log", ylim=(8.0, 6e3), xlim=(line[0], line[-1]))
        left.set(xlabel="damping of device and hand [N·s/m]", ylabel="stiffness in the middle of the field [N/m]")
        left.set_title("Too stiff: a tool of 45 g at 1 kHz")
        left.legend(loc="lower right", fontsize=9)
        out = balance(1.0)
        ratio = np.linspace(1.0, 0.999 * out, 200)
        right.plot(ratio, [1e3 * hum_m(r) for r in ratio], color=INK, linewidth=1.2, label="energy of a cycle")
        some = (1.1, *HUMS, 3.0, 3.4)
        right.plot(
            some, [1e3 * hum(r) for r in some], "D", color=OKABE_ITO["vermilion"], fillstyle="none", label="simulated"
        )
        right.axvspan(out, 5.0, color=OKABE_ITO["vermilion"], alpha=0.12, linewidth=0)
        right.text(out + 0.1, 2.0, "throws the\ntool out")
        right.axvspan(0.0, 1.0, color=OKABE_ITO["green"], alpha=0.12, linewidth=0)
        right.text(0.4, 2.0, "rests", rotation=90)
        right.set(xlabel="stiffness over the limit [1]", ylabel="amplitude [mm]", xlim=(0.0, 5.0), ylim=(0.0, 11.0))
        right.set_title("A magnet that hums: reach 10 mm")
        right.legend(loc="lower right", fontsize=9)

    draw_panels(path, 1, 2, (5.6, 4.6), draw)
