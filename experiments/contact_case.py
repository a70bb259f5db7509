"""Contacts beyond a spring and Coulomb: damping that grows with depth, adhesion, friction over speed, in closed loop.

Each against a closed form, or an equation solved by SciPy, where there is one; with the real tick and the shipped
effects, as in `friction_case`.
"""

import math
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from hapscene.constants import SLIP_CUTOFF_HZ, TICK_S
from hapscene.device.hand import Grip
from hapscene.device.omni import Omni, stand
from hapscene.device.point import PointMass
from hapscene.stability.answer import Answer
from hapscene.stability.closed_form import limit_of_small_motion, limit_without_delay
from hapscene.stability.critical import DEPTH_M, growth, limit_of_motion
from hapscene.stability.rig import AT_M, Rig, sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.effect_registry import load_effect
from hapscene.surface.swatch import Swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.twin import Twin
from hapscene.view.palette import INK, OKABE_ITO

from .border_case import border_cases

MASS_KG, DAMPING_NS_M = 0.045, 0.1
"""The tool: an Omni as a point mass, without its friction."""

DEEP_NS_M2: Final = 500.0
"""Damping that grows with the depth [N·s/m²]: a tool that falls at 0.5 m/s on to 500 N/m bounces with 0.75 of it."""

PULL_N, RANGE_M = 0.5, 2e-3
"""Adhesion, as soft as an Omni takes it."""

DRAG_KG, DRAG_N_M, DRAG_NS_M, DRAG_M_S, PRESS_N = 0.05, 100.0, 2.0, 0.02, 2.0
"""The dragged mass, the hand's spring and damper, its speed, and what it is pressed on with."""

DYNAMIC, STRIBECK_M_S = 0.3, DRAG_M_S * math.sqrt(2.0)
"""Friction is steepest at the speed of the drag."""

RIGID_N_M: Final = 1e5
"""Stiffness while it sticks where what is compared with is rigid [N/m]."""

FINE_S: Final = 2e-5
"""Tick of the drag [s]."""

LEAD: Final = Grip(2e3, 20.0)
"""The hand that brings the tool on to the surface."""

Array = NDArray[np.float64]


def contact_cases() -> list[Answer]:
    """All of them, in about 20 s."""
    return [*deep_damping(), *torn_off(), *squeal(), *rest_of_omni(), *border_cases()]


class DeepRig(Rig):
    """The rig of a wall whose damping is that at the depth at which small motion is looked at."""

    def tune(self, stiffness_N_m: float, damping_Ns_m: float = 0.0) -> None:
        super().tune(stiffness_N_m)
        self.twin.renderer.tune("wall", hunt_crossley_Ns_m2=damping_Ns_m / DEPTH_M)
        self._damping_Ns_m = damping_Ns_m


def deep_damping() -> list[Answer]:
    """Pressed to d it holds what a wall damped by χ d holds; what falls on it bounces as the closed form says."""
    answers = []
    for delay in (0, 1):
        rig = DeepRig(PointMass(MASS_KG, DAMPING_NS_M), TICK_S, delay)
        for depth_m in (1e-5, 1e-3, 4e-3):
            damper = DEEP_NS_M2 * depth_m
            known = limit_of_small_motion(MASS_KG, DAMPING_NS_M, TICK_S, delay, damper)
            what = f"stiffness from which it rings, pressed {1e3 * depth_m:g} mm deep, {delay} ticks late [N/m]"
            name = f"HC-limit-{1e3 * depth_m:g}mm-{delay}"
            answers.append(Answer(name, what, known, limit_of_motion(rig, damper), 1e-4))
    for speed in (0.2, 0.5, 1.0):
        what = f"speed after a fall at {speed:g} m/s over that before [1]"
        answers.append(Answer(f"HC-bounce-{speed:g}", what, bounce(speed), bounced(speed), 2e-3))
    return answers


def bounce(speed_m_s: float, stiffness_N_m: float = 500.0) -> float:
    """Restitution e: with a = χ v/K, a − ln(1 + a) = −a e − ln(1 − a e), of a free mass on d (K + χ ḋ)."""
    a = DEEP_NS_M2 * speed_m_s / stiffness_N_m

    def off(e: float) -> float:
        return a - math.log1p(a) + a * e + math.log1p(-a * e)

    return float(brentq(off, 1e-9, min(1.0, (1.0 - 1e-12) / a)))


def bounced(speed_m_s: float, stiffness_N_m: float = 500.0) -> float:
    """The same, by simulation with a fine tick."""
    rig = Rig(PointMass(MASS_KG), 1e-5)
    rig.tune(stiffness_N_m)
    rig.twin.renderer.tune("wall", hunt_crossley_Ns_m2=DEEP_NS_M2)
    return float(rig.throw(1e-4, speed_m_s, 8000).v_W_m_s[-1, 2] / speed_m_s)


def torn_off() -> list[Answer]:
    """A tool that is lifted off loses A e δ, pulled by A at most; beside the surface it rings as a spring of A e/δ."""
    sticky = {"adhesion_N": PULL_N, "adhesion_range_m": RANGE_M}
    height_m, f_N = lifted(_twin(PointMass(MASS_KG), ("wall", "adhesion"), **sticky))
    air = height_m[:-1] > 0.0
    lost_J = -float((f_N[:-1] * np.diff(height_m))[air].sum())

    def grows(damping_Ns_m: float) -> float:
        one = _twin(PointMass(MASS_KG, damping_Ns_m), ("wall", "adhesion"), **sticky)
        x, y = AT_M
        one.reset((x, y, 1e-4))
        for place in ((x, y, -1e-4), (x, y, 1e-7), (x + 1e-5 * RANGE_M, y, 1e-7)):  # in, out, aside
            one.run(Intent.hold(place, 20, Grip(1e7, 1e3)))
        return growth(one.run(Intent.hold(place, 240, "none")).p_W_m[:, 0] - x, 2)

    known = PULL_N * math.e / RANGE_M
    damping = float(brentq(grows, 0.2 * known * TICK_S, known * TICK_S, rtol=1e-6))
    rings = "least damping at which it does not ring, in stiffness it holds [N/m]"
    return [
        Answer("adhesion-work", "work of tearing off, A e δ [mJ]", 1e3 * PULL_N * math.e * RANGE_M, 1e3 * lost_J, 1e-2),
        Answer("adhesion-pull", "largest pull [N]", PULL_N, float(-f_N.min()), 1e-3),
        Answer("adhesion-rings", rings, known, limit_without_delay(MASS_KG, damping, TICK_S), 1e-3),
    ]


def lifted(twin: Twin, speed_m_s: float = 0.02) -> tuple[Array, Array]:
    """Height (n,) [m] of a tool that is lifted off after a press, and the force on it (n,) [N]."""
    twin.reset((*AT_M, 1e-4))
    twin.run(Intent.hold((*AT_M, -1e-3), 200, Grip(2e4, 60.0)))
    z = -1e-3 + speed_m_s * TICK_S * np.arange(round(24.0 * RANGE_M / speed_m_s / TICK_S))
    felt = twin.run(Intent.along(np.column_stack([np.tile(AT_M, (len(z), 1)), z]), Grip(2e4, 60.0)))
    return felt.p_W_m[:, 2], felt.f_motor_W_N[:, 2]


def squeal() -> list[Answer]:
    """Friction that falls with speed: quiet below the closed form's border, above it as SciPy solves the equation."""
    border = critical_fall()
    below, above = (swing(dragged(share * border)[1]) for share in (0.9, 1.1))
    static = DYNAMIC + 3.0 * border
    t_s, stretch_m = dragged(3.0 * border)
    expected_s, expected_m = solved(static)
    return [
        Answer("squeal-below", "amplitude at 0.9 of the fall that rings [mm]", 0.0, 1e3 * below, 0.02),
        Answer("squeal-above", "at 1.1 of it, over 0.02 mm [1 yes]", 1.0, float(above > 2e-5), 0.0),
        Answer("squeal-period", "period at 3 times it [ms]", 1e3 * expected_s, 1e3 * period(t_s, stretch_m), 2e-2),
        Answer("squeal-amplitude", "amplitude [mm]", 1e3 * expected_m, 1e3 * swing(stretch_m), 3e-2),
    ]


def critical_fall() -> float:
    """µ_s − µ_d from which a drag at `DRAG_M_S` rings [1].

    Small motion about it is (m s² + b s + k + µ' F s/(1 + τ s)) x = 0 with the low-pass τ on the slip speed, and stable
    while −µ' F < b + k b τ²/(m + b τ) (Routh); µ' = −√(2/e) (µ_s − µ_d)/v_s at v = v_s/√2.
    """
    tau = 1.0 / (2.0 * math.pi * SLIP_CUTOFF_HZ)
    most = DRAG_NS_M * (1.0 + DRAG_N_M * tau**2 / (DRAG_KG + DRAG_NS_M * tau))
    return most * STRIBECK_M_S / (PRESS_N * math.sqrt(2.0 / math.e))


@cache
def dragged(fall: float, seconds: float = 4.0) -> tuple[Array, Array]:
    """Times (n,) [s], and how far a hand that drags is ahead (n,) [m], from a steady slide on."""
    rigid = {"tangential_stiffness_N_m": RIGID_N_M, "tangential_damping_Ns_m": 2.0 * math.sqrt(RIGID_N_M * DRAG_KG)}
    twin = _twin(
        PointMass(DRAG_KG), ("wall", "friction"), FINE_S, damping_Ns_m=5.0, friction_static=DYNAMIC + fall,
        friction_dynamic=DYNAMIC, friction_stribeck_m_s=STRIBECK_M_S, effects={"friction": rigid},
    )  # fmt: skip
    down = (-0.5 * DRAG_M_S * seconds, AT_M[1], -PRESS_N / 500.0)
    push = (0.0, 0.0, -PRESS_N)
    twin.reset((*down[:2], 1e-4))
    twin.run(Intent.hold(down, round(0.3 / FINE_S), LEAD, push_W_N=push))
    count, lead = round(seconds / FINE_S), round(0.3 / FINE_S)
    path = np.tile(down, (lead + count, 1))
    path[:, 0] += DRAG_M_S * FINE_S * np.arange(lead + count)
    twin.run(Intent.along(path[:lead], LEAD, push))
    hand = path[lead:].copy()
    hand[:, 0] += (DYNAMIC + fall * math.exp(-0.5)) * PRESS_N / DRAG_N_M
    felt = twin.run(Intent.along(hand, Grip(DRAG_N_M, DRAG_NS_M), push))
    return FINE_S * np.arange(count, dtype=np.float64), hand[:, 0] - felt.p_W_m[:, 0]


def swing(stretch_m: Array) -> float:
    """Half of what a way goes to and fro in its last quarter [m]."""
    return float(np.ptp(stretch_m[-len(stretch_m) // 4 :])) / 2.0


def period(t_s: Array, x: Array) -> float:
    """Of the last half of a swing [s]."""
    t_s, x = t_s[len(t_s) // 2 :], x[len(x) // 2 :]
    above = x > 0.5 * (x.max() + x.min())
    return float(np.diff(t_s[1:][above[1:] & ~above[:-1]]).mean())


def solved(static: float, cycles: int = 12) -> tuple[float, float]:
    """Period [s] and amplitude [m] of its stick and slip, of rigid friction, by SciPy."""
    tau = 1.0 / (2.0 * math.pi * SLIP_CUTOFF_HZ)

    def slip(_: float, y: Array) -> list[float]:
        stretch, v, u = y
        mu = DYNAMIC + (static - DYNAMIC) * math.exp(-((u / STRIBECK_M_S) ** 2))
        pull = DRAG_N_M * stretch + DRAG_NS_M * (DRAG_M_S - v)
        return [DRAG_M_S - v, (pull - mu * PRESS_N) / DRAG_KG, (abs(v) - u) / tau]

    def stops(_: float, y: Array) -> float:
        return float(y[1])

    stops.terminal, stops.direction = True, -1.0  # type: ignore[attr-defined]
    breaks_m = (static * PRESS_N - DRAG_NS_M * DRAG_M_S) / DRAG_N_M
    stretch, u, periods, ends = breaks_m, 0.0, [], []
    for _ in range(cycles):
        slid = solve_ivp(slip, (0.0, 10.0), [stretch, 1e-9, u], events=stops, rtol=1e-9, atol=1e-12, max_step=1e-3)
        stick_s = max(0.0, (breaks_m - slid.y[0, -1]) / DRAG_M_S)
        periods.append(float(slid.t[-1]) + stick_s)
        ends.append((float(slid.y[0].max()), float(slid.y[0].min())))
        stretch, u = breaks_m, float(slid.y[2, -1]) * math.exp(-stick_s / tau)
    high, low = ends[-1]
    return periods[-1], (high - low) / 2.0


def rest_of_omni() -> list[Answer]:
    """An Omni with encoders, pressed on what has all of it: it stands still, and does not drift."""
    twin = _twin(
        Omni(), ("wall", "friction", "adhesion"), X_WD=stand((*AT_M, 0.0)), damping_Ns_m=0.5, hunt_crossley_Ns_m2=300.0,
        friction_static=0.5, friction_dynamic=0.3, friction_stribeck_m_s=0.02, friction_viscous_s_m=1.0,
        adhesion_N=PULL_N, adhesion_range_m=RANGE_M,
    )  # fmt: skip
    twin.reset((*AT_M, 1e-4))
    twin.run(Intent.hold((*AT_M, -2e-3), 500, LEAD, push_W_N=(0.0, 0.0, -1.0)))
    felt = twin.run(Intent.hold((*AT_M, 0.0), 10_000, "none", push_W_N=(0.4, 0.0, -1.0)))
    rest_m_s = float(np.sqrt((felt.v_W_m_s[-2000:] ** 2).sum(1).mean()))
    drift_m = float(np.linalg.norm(felt.p_W_m[-1, :2] - felt.p_W_m[2000, :2]))
    return [
        Answer("rest-omni", "speed at rest, rms [mm/s]", 0.0, 1e3 * rest_m_s, 0.1),
        Answer("drift-omni", "drift in 8 s between dynamic and static friction [µm]", 0.0, 1e6 * drift_m, 1.0),
    ]


def draw_contact(path: Path) -> None:
    """Chart: what a wall whose damping grows with depth holds, and the amplitude of the squeal."""
    draw_panels(path, 1, 2, (5.2, 4.2), _draw)


def _draw(_: Any, axes: Any) -> None:
    deep, squeals = axes[0]
    depth = np.geomspace(1e-6, 2e-2, 60)
    for delay, style in ((0, "-"), (1, "--")):
        known = [limit_of_small_motion(MASS_KG, DAMPING_NS_M, TICK_S, delay, DEEP_NS_M2 * d) for d in depth]
        deep.plot(1e3 * depth, known, style, color=INK, label=("closed form", "a tick late")[delay])
        rig = DeepRig(PointMass(MASS_KG, DAMPING_NS_M), TICK_S, delay)
        some = depth[5::14]
        found = [limit_of_motion(rig, DEEP_NS_M2 * d) for d in some]
        label = None if delay else "simulated"
        deep.plot(1e3 * some, found, "o", color=OKABE_ITO["blue"], fillstyle="none", label=label)
    deep.set(xscale="log", yscale="log", xlabel="depth at which it is pressed [mm]", ylabel="largest stiffness [N/m]")
    deep.set_title(f"Damping of {DEEP_NS_M2:g} N·s/m² times the depth")
    deep.legend(loc="upper left")

    border = critical_fall()
    falls = np.array([0.5, 0.9, 1.1, 1.5, 2.0, 3.0])
    found = [1e3 * swing(dragged(float(share * border))[1]) for share in falls]
    squeals.plot(falls, found, "o", color=OKABE_ITO["vermilion"], fillstyle="none", label="simulated")
    line = np.linspace(1.2, 3.0, 5)
    squeals.plot(line, [1e3 * solved(DYNAMIC + s * border)[1] for s in line], color=INK, label="solved by SciPy")
    squeals.axvspan(0.0, 1.0, color=OKABE_ITO["green"], alpha=0.12, linewidth=0)
    squeals.set(xlabel="fall of friction over the border [1]", ylabel="amplitude [mm]")
    squeals.set_title("Friction that falls with speed")
    squeals.legend(loc="upper left")


def _twin(
    device: PointMass | Omni, used: tuple[str, ...], tick_s: float = TICK_S, X_WD: Any = None, **numbers: Any
) -> Twin:
    scene = sheet(Swatch("contact", **numbers))
    return Twin(scene, device, [load_effect(name) for name in used], tick_s=tick_s, a_rate_Hz=1.0 / tick_s, X_WD=X_WD)
