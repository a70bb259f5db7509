"""The cases of friction with known answers (F1 to F4), in closed loop with the real tick and the shipped effect.

Beside them what no formula says: on an Omni with its encoders nothing drifts at rest, and nothing chatters when a
sliding tool comes to a stop.
"""

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.hand import Grip
from hapscene.device.omni import Omni, stand
from hapscene.device.point import PointMass
from hapscene.stability.answer import Answer
from hapscene.stability.rig import AT_M, sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.swatch import Swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.result import Feel
from hapscene.twin.twin import Twin
from hapscene.view.palette import INK, OKABE_ITO

PRESS_N: Final = 1.0
"""With what the tool is pressed on [N]: as a stroke does."""

COULOMB: Final = 0.3
"""Coefficient of friction [1], static and dynamic where the case has but one."""

STICK_N_M: Final = 500.0
"""Stiffness while it sticks [N/m]: the effect's default."""

STATIC: Final = 0.5
"""Coefficient at which it breaks away [1], in the case that has one of its own."""

DRAG_KG, DRAG_N_M, DRAG_M_S, DRAG_PRESS_N = 0.05, 100.0, 0.02, 2.0
"""The dragged mass, the spring and the speed it is dragged by, and with what it is pressed on."""

RIGID_N_M: Final = 1e5
"""Stiffness while it sticks where the closed form is of rigid friction [N/m]: a thousand times that of the hand."""

STICK_NS_M: Final = 5.0
"""Damping while it sticks [N·s/m], where the device has no friction of its own to bring the tool to rest."""

WALL_NS_M: Final = 5.0
"""Damping of the wall [N·s/m], so that the depth comes to rest at once. It has no part in what is tangential."""

LEAD: Final = Grip(2e3, 20.0)
"""The hand that brings the tool on to the surface."""

LEAD_S: Final = 0.4
"""How long it takes to bring the tool to the speed that it slides at [s]."""

SETTLE_S: Final = 0.5
"""How long it does so [s]."""

OMNI_POINT: Final = PointMass(0.045, 0.1, 0.26, 5.5e-5)
"""The Omni as a point mass (data sheet, damping assumed)."""

Array = NDArray[np.float64]


def friction_cases() -> list[Answer]:
    """All of them, in about 3 s."""
    return [*loop_area(), *stick_slip(), *no_drift(), *stop(), *rest_of_omni()]


def loop_area() -> list[Answer]:
    """F1: a slider on a spring, moved to and fro by A, loses 4 F_c (A − F_c/k) a cycle (Hayward & Armstrong 2000)."""
    x_m, f_N, limit_N = rubbed()
    lost_J = -float((f_N[:-1] * np.diff(x_m)).sum())  # the work of forces that are held
    expected_J = 4.0 * limit_N * (float(np.ptp(x_m)) / 2.0 - limit_N / STICK_N_M)
    return [Answer("F1", "energy lost in a cycle [mJ]", 1e3 * expected_J, 1e3 * lost_J, 2e-3)]


def rubbed(amplitude_m: float = 5e-3, cycle_s: float = 2.0) -> tuple[Array, Array, float]:
    """A mass led on a sine: one cycle of its place (n,) [m] and of the motors' force (n,) [N], and its friction [N]."""
    tick_s = 1e-3
    twin = _twin(PointMass(0.045), tick_s)
    _press(twin, tick_s)
    count = round(cycle_s / tick_s)
    path = np.tile((*AT_M, -PRESS_N / STICK_N_M), (3 * count, 1))
    path[:, 0] += amplitude_m * np.sin(2.0 * np.pi * np.arange(3 * count) / count)
    felt = twin.run(Intent.along(path, Grip(2e4, 40.0)))  # stiff enough to lead, damped enough to rest
    cycle = slice(count, 2 * count + 1)
    limit_N = COULOMB * float(felt.recording.normal_force_N[cycle].mean())
    return felt.p_W_m[cycle, 0], felt.f_motor_W_N[cycle, 0], limit_N


def stick_slip() -> list[Answer]:
    """F2: a mass dragged at V by a spring k sticks and slips.

    Period 2ΔF/(kV) + (2/ω)(π − atan(ΔFω/(kV))), amplitude √((ΔF/k)² + (V/ω)²) with ΔF = F_s − F_d and ω = √(k/m), of
    rigid friction: the spring of adhesion is a thousand times as stiff as the hand's, and damped, so that the mass
    stands still between two slips.
    """
    period_s, amplitude_m = period_and_amplitude()
    t_s, stretch_m = dragged(4.5 * period_s)
    late = t_s > 1.5 * period_s
    t_s, stretch_m = t_s[late], stretch_m[late]
    above = stretch_m > 0.5 * (stretch_m.max() + stretch_m.min())
    rises_s = t_s[1:][above[1:] & ~above[:-1]]
    return [
        Answer("F2-period", "period of stick and slip [s]", period_s, float(np.diff(rises_s).mean()), 2e-2),
        Answer("F2-amplitude", "amplitude [mm]", 1e3 * amplitude_m, 1e3 * float(np.ptp(stretch_m) / 2.0), 2e-2),
    ]


def period_and_amplitude() -> tuple[float, float]:
    """What the closed forms say of `dragged` [s], [m]."""
    gap_N, omega = (STATIC - COULOMB) * DRAG_PRESS_N, math.sqrt(DRAG_N_M / DRAG_KG)
    ratio = gap_N / (DRAG_N_M * DRAG_M_S)
    period_s = 2.0 * ratio + 2.0 / omega * (math.pi - math.atan(ratio * omega))
    return period_s, math.hypot(gap_N / DRAG_N_M, DRAG_M_S / omega)


def dragged(duration_s: float) -> tuple[Array, Array]:
    """Times (n,) [s] since a hand began to drag a mass by a spring, and how far that is drawn (n,) [m]."""
    tick_s = 1e-5  # a seventieth of the time in which the mass swings on the spring of adhesion
    damping_Ns_m = 2.0 * math.sqrt(RIGID_N_M * DRAG_KG)
    twin = _twin(PointMass(DRAG_KG), tick_s, STATIC, COULOMB, RIGID_N_M, damping_Ns_m)
    _press(twin, tick_s, DRAG_PRESS_N)
    t_s = np.arange(round(duration_s / tick_s), dtype=np.float64) * tick_s
    path = np.tile((*AT_M, -DRAG_PRESS_N / STICK_N_M), (len(t_s), 1))
    path[:, 0] += DRAG_M_S * t_s
    felt = twin.run(Intent.along(path, Grip(DRAG_N_M, 0.0), (0.0, 0.0, -DRAG_PRESS_N)))
    return t_s, path[:, 0] - felt.p_W_m[:, 0]


def no_drift() -> list[Answer]:
    """F3: held at 0.5 F_c and shaken by 0.2 F_c for 50 s, a mass stays where it is (Dahl's model creeps 59 z_max).

    In units of z_max = F_c/k, from the mean over the first second in which it has settled to that over the last.
    """
    tick_s, count = 1e-3, 50_000
    twin = _twin(PointMass(0.045), tick_s, damping_Ns_m=STICK_NS_M)
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
        felt, limit_N = slid(PointMass(0.045), speed_m_s, damping_Ns_m=STICK_NS_M)
        steps = math.ceil(speed_m_s * 0.045 / (limit_N * 1e-3))
        v = felt.v_W_m_s[:, 0]
        name = f"F4-{1e3 * speed_m_s:.0f}mm_s"
        answers += [
            Answer(name, "steps to a stop [count]", steps, float(np.argmax(v <= 0.0)), 0.0),
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
    start = np.linspace(0.0, 1.0, round(LEAD_S / tick_s))
    path = np.tile((*AT_M, -PRESS_N / STICK_N_M), (len(start), 1))
    path[:, 0] += speed_m_s * LEAD_S * (start**3 - 0.5 * start**4)  # from rest to that speed, without a kick
    path[:, 0] -= 0.5 * speed_m_s * LEAD_S
    twin.run(Intent.hold(path[0], len(start), LEAD, push_W_N=(0.0, 0.0, -PRESS_N)))
    path = np.vstack((path, 2.0 * path[-1] - path[-2]))  # where it lets go, still moving
    grip = np.tile(LEAD.row(), (len(path), 1))
    grip[-1] = 0.0
    twin.run(Intent.along(path, grip, (0.0, 0.0, -PRESS_N)))
    if isinstance(device, PointMass):
        twin.body.arm.point.v_m_s[0, 0] = speed_m_s  # to the last digit
    count = round(duration_s / tick_s)
    felt = twin.run(Intent.hold(path[-1], count, "none", push_W_N=(0.0, 0.0, -PRESS_N)))
    return felt, COULOMB * float(felt.recording.normal_force_N[0])


def rest_of_omni() -> list[Answer]:
    """An Omni with friction and encoders of its own: no chatter when a sliding tool stops, no drift where it stands."""
    answers = []
    for name, device in (("point", OMNI_POINT), ("omni", Omni())):
        felt, _ = slid(device, 0.2, duration_s=2.0)
        rest_m_s = float(np.sqrt((felt.v_W_m_s[-1000:] ** 2).sum(1).mean()))
        answers += [
            Answer(f"stop-{name}", "reversals of force within 3 ticks [count]", 0, _reversals(felt), 0.0),
            Answer(f"rest-{name}", "speed at rest, rms [mm/s]", 0.0, 1e3 * rest_m_s, 0.1),
        ]
        twin = _twin(device, 1e-3)
        _press(twin, 1e-3)
        half = 0.5 * COULOMB * PRESS_N
        felt = twin.run(Intent.hold((*AT_M, 0.0), 20_000, "none", push_W_N=(half, 0.0, -PRESS_N)))
        drift_m = float(np.linalg.norm(felt.p_W_m[-1, :2] - felt.p_W_m[2000, :2]))
        answers.append(Answer(f"drift-{name}", "drift in 18 s at half the friction [µm]", 0.0, 1e6 * drift_m, 1.0))
    return answers


def draw_friction(path: Path) -> None:
    """Chart of the loop (F1), of stick and slip (F2), and of tools that slide to a stop (F4)."""
    draw_panels(path, 1, 3, (5.2, 4.2), _draw)


def _draw(_: Any, axes: Any) -> None:
    loop, slip, stopping = axes[0]
    x_m, f_N, limit_N = rubbed()
    loop.plot(1e3 * (x_m - x_m.mean()), -f_N, color=OKABE_ITO["blue"], label="hand on the surface")
    for sign in (-1.0, 1.0):
        loop.axhline(sign * limit_N, color=INK, linestyle=":", linewidth=1.0, label="± F_c" if sign > 0.0 else None)
    loop.set(xlabel="place along the surface [mm]", ylabel="force [N]", ylim=(-0.4, 0.5))
    loop.set_title("F1: one cycle of a sine")
    loop.legend(loc="upper left", ncols=2)

    period_s, amplitude_m = period_and_amplitude()
    t_s, stretch_m = dragged(3.5 * period_s)
    some = slice(None, None, 50)
    slip.plot(t_s[some], 1e3 * stretch_m[some], color=OKABE_ITO["blue"], label="spring of the hand")
    rest_m = COULOMB * DRAG_PRESS_N / DRAG_N_M
    for sign in (-1.0, 1.0):
        y_mm = 1e3 * (rest_m + sign * amplitude_m)
        slip.axhline(y_mm, color=INK, linestyle=":", linewidth=1.0, label="closed form" if sign > 0.0 else None)
    peak_s = float(t_s[np.argmax(stretch_m[: round(0.9 * len(t_s) / 3.5 * 2)])])
    for k in range(3):
        slip.vlines(peak_s + k * period_s, 0.0, 10.7, color=INK, linestyle=":", linewidth=1.0)
    slip.set(title="F2: stick and slip of a dragged mass", xlabel="time [s]", ylabel="stretch [mm]", ylim=(0.0, 13.0))
    slip.legend(loc="upper left", ncols=2)

    for name, colour, device, damping in (
        ("no friction of its own, undamped", "vermilion", PointMass(0.045, 0.1), 0.0),
        (f"the same, adhesion damped by {STICK_NS_M:g} N·s/m", "blue", PointMass(0.045, 0.1), STICK_NS_M),
        ("Omni", "green", Omni(), 0.0),
    ):
        felt, _ = slid(device, 0.2, damping, 0.3)
        t_ms = 1e3 * felt.recording.t_s[:300] - 1e3 * felt.recording.t_s[0]
        stopping.plot(t_ms, 1e3 * felt.v_W_m_s[:, 0], color=OKABE_ITO[colour], label=name)
    stopping.set(title="F4: a tool slides to a stop", xlabel="time [ms]", ylabel="speed [mm/s]", ylim=(-80.0, 280.0))
    stopping.legend(loc="upper right")


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
    twin.run(Intent.hold(depth, round(SETTLE_S / tick_s), LEAD, push_W_N=(0.0, 0.0, -press_N)))
