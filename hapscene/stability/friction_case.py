"""The cases of friction with known answers, each in the closed loop with the real tick and the shipped effect: F1 to F4.

Beside them what no formula says: on an Omni with its encoders nothing drifts at rest, and nothing chatters when a
sliding tool comes to a stop.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.hand import Grip
from hapscene.device.omni import Omni, stand
from hapscene.device.point import PointMass
from hapscene.output import whole_file
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.swatch import Swatch
from hapscene.twin.feel import Feel
from hapscene.twin.intent import Intent
from hapscene.twin.twin import Twin

PRESS_N: Final = 1.0
"""With what the tool is pressed on [N]: as a stroke does."""

COULOMB: Final = 0.3
"""Coefficient of friction [1], static and dynamic where the case has but one."""

STICK_N_M: Final = 500.0
"""Stiffness while it sticks [N/m]: the effect's default."""

RIGID_N_M: Final = 1e5
"""Stiffness while it sticks where the closed form is of rigid friction [N/m]: a thousand times that of the hand."""

WALL_NS_M: Final = 5.0
"""Damping of the wall [N·s/m], so that the depth comes to rest at once. It has no part in what is tangential."""

LEAD: Final = Grip(2e3, 20.0)
"""The hand that brings the tool on to the surface."""

SETTLE_S: Final = 0.5
"""How long it does so [s]."""

OMNI_POINT: Final = PointMass(0.045, 0.1, 0.26, 5.5e-5)
"""The Omni as a point mass (data sheet, damping assumed)."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Answer:
    """One answer: what was expected of it and what was found.

    Attributes:
        id: of the case.
        what: the quantity and its unit.
        expected, found: its values.
        tolerance: largest error allowed.
        at_most: the answer is a bound: only what is over it is an error.
    """

    id: str
    what: str
    expected: float
    found: float
    tolerance: float
    at_most: bool = False

    @property
    def error(self) -> float:
        """Relative; absolute, in the quantity's unit, where 0 is expected."""
        apart = self.found - self.expected
        apart = max(0.0, apart) if self.at_most else abs(apart)
        return apart / abs(self.expected) if self.expected else apart

    @property
    def ok(self) -> bool:
        return bool(self.error <= self.tolerance)


def friction_cases() -> list[Answer]:
    """All of them, in about 3 s."""
    return [*loop_area(), *stick_slip(), *no_drift(), *stop(), *rest_of_omni()]


def loop_area() -> list[Answer]:
    """F1: a slider on a spring, moved to and fro by A, loses 4 F_c (A − F_c/k) a cycle (Hayward & Armstrong 2000).

    A hand leads a mass on a sine; what a cycle takes is the work of the motors along it.
    """
    amplitude_m, cycle_s, tick_s = 5e-3, 2.0, 1e-3
    twin = _twin(PointMass(0.045), tick_s)
    _press(twin, tick_s)
    count = round(cycle_s / tick_s)
    x_m = amplitude_m * np.sin(2.0 * np.pi * np.arange(3 * count) / count)
    hand = Grip(2e4, 40.0)  # stiff enough to follow, soft enough for the mass to come to rest at this tick
    path = np.column_stack((AT_M[0] + x_m, np.full(len(x_m), AT_M[1]), np.full(len(x_m), -PRESS_N / STICK_N_M)))
    felt = twin.run(Intent.along(path, hand))
    x, f_N = felt.p_W_m[:, 0], felt.f_motor_W_N[:, 0]
    cycle = slice(count, 2 * count + 1)
    lost_J = -float((f_N[cycle][:-1] * np.diff(x[cycle])).sum())
    reached_m, limit_N = float(np.ptp(x[cycle]) / 2.0), COULOMB * float(felt.recording.normal_force_N[cycle].mean())
    expected_J = 4.0 * limit_N * (reached_m - limit_N / STICK_N_M)
    return [Answer("F1", "energy lost in a cycle [mJ]", 1e3 * expected_J, 1e3 * lost_J, 1e-2)]


def stick_slip(static: float = 0.5, dynamic: float = 0.3) -> list[Answer]:
    """F2: a mass dragged at V by a spring k sticks and slips.

    Period 2ΔF/(kV) + (2/ω)(π − atan(ΔFω/(kV))), amplitude √((ΔF/k)² + (V/ω)²) with ω = √(k/m), of rigid friction
    that drops by 2ΔF... where it breaks away. Between two slips the mass must stand still, so the spring of adhesion
    is stiff and damped.
    """
    mass_kg, k_N_m, drag_m_s, press_N = 0.05, 100.0, 0.02, 2.0
    gap_N, omega = (static - dynamic) * press_N, math.sqrt(k_N_m / mass_kg)
    period_s = 2 * gap_N / (k_N_m * drag_m_s) + 2 / omega * (math.pi - math.atan(gap_N * omega / (k_N_m * drag_m_s)))
    amplitude_m = math.hypot(gap_N / k_N_m, drag_m_s / omega)
    t_s, stretch_m, _ = dragged(mass_kg, k_N_m, drag_m_s, press_N, static, dynamic, 4.5 * period_s)
    late = t_s > 1.5 * period_s
    t_s, stretch_m = t_s[late], stretch_m[late]
    above = stretch_m > 0.5 * (stretch_m.max() + stretch_m.min())
    rises_s = t_s[1:][above[1:] & ~above[:-1]]
    return [
        Answer("F2-period", "period of stick and slip [s]", period_s, float(np.diff(rises_s).mean()), 2e-2),
        Answer("F2-amplitude", "amplitude [mm]", 1e3 * amplitude_m, 1e3 * float(np.ptp(stretch_m) / 2.0), 2e-2),
    ]


def dragged(
    mass_kg: float, k_N_m: float, drag_m_s: float, press_N: float, static: float, dynamic: float, duration_s: float
) -> tuple[Array, Array, Array]:
    """Times (n,) [s] since a hand began to drag, how far its spring is drawn (n,) [m], and the mass's speed (n,)."""
    tick_s = 1e-5  # a fortieth of the time in which the mass rings on the spring of adhesion
    damping = 2.0 * math.sqrt(RIGID_N_M * mass_kg)
    twin = _twin(PointMass(mass_kg), tick_s, static, dynamic, RIGID_N_M, damping)
    _press(twin, tick_s, press_N)
    t_s = np.arange(round(duration_s / tick_s)) * tick_s
    path = np.tile((*AT_M, -press_N / STICK_N_M), (len(t_s), 1))
    path[:, 0] += drag_m_s * t_s
    felt = twin.run(Intent.along(path, Grip(k_N_m, 0.0), (0.0, 0.0, -press_N)))
    return t_s, path[:, 0] - felt.p_W_m[:, 0], felt.v_W_m_s[:, 0]


def no_drift() -> list[Answer]:
    """F3: held at 0.5 F_c and shaken by 0.2 F_c for 50 s, a mass stays where it is (Dahl's model creeps 59 z_max).

    In units of z_max = F_c/k, from the mean over the first second in which it has settled to that over the last.
    """
    tick_s, count = 1e-3, 50_000
    twin = _twin(PointMass(0.045), tick_s, damping_Ns_m=5.0)
    _press(twin, tick_s)
    limit_N = COULOMB * PRESS_N
    push = np.zeros((count, 3))
    push[:, 0] = limit_N * (0.5 + 0.2 * np.sin(2.0 * np.pi * 37.0 * tick_s * np.arange(count)))
    push[:, 2] = -PRESS_N
    felt = twin.run(Intent(np.zeros((count, 3)), np.zeros((count, 3)), push))
    x, second = felt.p_W_m[:, 0], round(1.0 / tick_s)
    drift = abs(float(x[-second:].mean() - x[second : 2 * second].mean())) / (limit_N / STICK_N_M)
    return [Answer("F3", "drift in 50 s over z_max [1]", 0.0, drift, 1e-9)]


def stop() -> list[Answer]:
    """F4: a mass that slides to rest stops in ⌈v₀m/(F_cT)⌉ steps, and then rests (Kikuuwe et al. 2006)."""
    answers = []
    for speed_m_s in (0.05, 0.103, 0.2037):
        felt, limit_N = slid(PointMass(0.045), speed_m_s, damping_Ns_m=5.0)
        steps = math.ceil(speed_m_s * 0.045 / (limit_N * 1e-3))
        v = felt.v_W_m_s[:, 0]
        name = f"F4-{1e3 * speed_m_s:.0f}mm_s"
        answers += [
            Answer(name, "steps to a stop [count]", steps, float(np.argmax(v <= 0.0)), 1.01 / steps),
            Answer(f"{name}-chatter", "reversals of force within 3 ticks [count]", 0, _reversals(felt), 0.0),
            Answer(f"{name}-rest", "speed after 0.4 s [mm/s]", 0.0, 1e3 * float(np.abs(v[400:]).max()), 1e-3),
        ]
    return answers


def slid(
    device: PointMass | Omni, speed_m_s: float, damping_Ns_m: float = 0.0, duration_s: float = 1.0
) -> tuple[Feel, float]:
    """A tool pressed on with `PRESS_N` slides at a speed when the hand stops leading it, and is held by friction alone.

    Returns:
        What was felt from there, and the friction that was there [N].
    """
    tick_s = 1e-3
    twin = _twin(device, tick_s, damping_Ns_m=damping_Ns_m)
    _press(twin, tick_s)
    lead = round(0.1 / tick_s)
    path = np.tile((*AT_M, -PRESS_N / STICK_N_M), (lead, 1))
    path[:, 0] += speed_m_s * tick_s * np.arange(1, lead + 1)
    twin.run(Intent.along(path, LEAD, (0.0, 0.0, -PRESS_N)))
    if isinstance(device, PointMass):
        twin.body.arm.point.v_m_s[0, 0] = speed_m_s  # to the last digit
    count = round(duration_s / tick_s)
    felt = twin.run(Intent.hold(path[-1], count, "none", (0.0, 0.0, -PRESS_N)))
    return felt, COULOMB * float(felt.recording.normal_force_N[0])


def rest_of_omni() -> list[Answer]:
    """An Omni with friction and encoders of its own: no chatter when a sliding tool stops, no drift where it stands."""
    answers = []
    for name, device in (("point", OMNI_POINT), ("omni", Omni())):
        felt, _ = slid(device, 0.2, duration_s=2.0)
        last = felt.v_W_m_s[-1000:]
        answers += [
            Answer(f"stop-{name}", "reversals of force within 3 ticks [count]", 0, _reversals(felt), 0.0),
            Answer(
                f"rest-{name}", "speed at rest, rms [mm/s]", 0.0, 1e3 * float(np.sqrt((last**2).sum(1).mean())), 0.1
            ),
        ]
        twin = _twin(device, 1e-3)
        _press(twin, 1e-3)
        half = 0.5 * COULOMB * PRESS_N
        felt = twin.run(Intent.hold((*AT_M, 0.0), 20_000, "none", (half, 0.0, -PRESS_N)))
        drift_m = float(np.linalg.norm(felt.p_W_m[-1, :2] - felt.p_W_m[2000, :2]))
        answers.append(Answer(f"drift-{name}", "drift in 18 s at half the friction [µm]", 0.0, 1e6 * drift_m, 1.0))
    return answers


def draw_friction(path: str | Path, rows: list[Answer] | None = None) -> None:
    """Chart of stick and slip, and of a tool that slides to a stop, with and without damping of the adhesion."""
    raise NotImplementedError


def _reversals(felt: Feel) -> int:
    """How often the force along x changes its sign, and changes it back within 3 ticks, both times to 2 mN or more."""
    f_N = felt.f_motor_W_N[:, 0]
    sign = np.where(np.abs(f_N) < 2e-3, 0.0, np.sign(f_N))
    turns = np.flatnonzero(np.diff(sign[sign != 0.0]))
    return int((np.diff(turns) <= 3).sum())


def _twin(
    device: PointMass | Omni,
    tick_s: float,
    static: float = COULOMB,
    dynamic: float = COULOMB,
    stick_N_m: float = STICK_N_M,
    damping_Ns_m: float = 0.0,
) -> Twin:
    adhesion = {"tangential_stiffness_N_m": stick_N_m, "tangential_damping_Ns_m": damping_Ns_m}
    swatch = Swatch(
        "rough",
        stiffness_N_m=STICK_N_M,
        damping_Ns_m=WALL_NS_M,
        friction_static=static,
        friction_dynamic=dynamic,
        effects={"friction": adhesion},
    )
    at: Any = stand((*AT_M, 0.0)) if isinstance(device, Omni) else None
    return Twin(sheet(swatch), device, ("wall", "friction"), tick_s=tick_s, a_rate_Hz=1.0 / tick_s, X_WD=at)


def _press(twin: Twin, tick_s: float, press_N: float = PRESS_N) -> None:
    """Bring the tool on to the surface and press, until it is at rest."""
    twin.reset((*AT_M, 1e-4))
    depth = (*AT_M, -press_N / STICK_N_M)
    twin.run(Intent.hold(depth, round(SETTLE_S / tick_s), LEAD, (0.0, 0.0, -press_N)))
