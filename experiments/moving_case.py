"""What moves under the tool: walls that come and go, tools that fly through, bodies that are pushed, games that stall.

Each has a closed form, by the force that is held over a tick of T and a wall of stiffness K.
"""

import math
import warnings
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.bridge.simulation import Bridge, ChatterWarning, ratio_max
from hapscene.clock import new_clock
from hapscene.constants import TICK_S
from hapscene.contact.prediction import FRAME, HORIZON_S, PREDICTED, SHARE, predict_bodies
from hapscene.device.model import Limits, limits_of
from hapscene.records import records
from hapscene.renderer import Renderer
from hapscene.stability.answer import Answer
from hapscene.stability.rig import AT_M, sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.swatch import Swatch
from hapscene.view.palette import INK, OKABE_ITO

Array = NDArray[np.float64]

STIFFNESS_N_M: Final = 500.0
"""Of every wall here [N/m]: the zoo's."""

FRAME_S: Final = 1.0 / 60.0
"""From pose to pose, and from shape to shape, of a program that draws [s]."""

SPEED_M_S: Final = 0.05
"""How fast a wall moves [m/s]: the zoo's moving bodies."""

COUNTS: Final = (1, 2, 4, 17)
"""Ticks in a step of a simulation: the last at 60 Hz."""

STALLS_S: Final = (0.01, 0.05, 0.1, 0.2, 0.5)
"""How long a game stands still [s], beside the time from frame to frame."""

FELT_N: Final = 0.07
"""The step of force that is felt beside a newton [N]: 7 % (Pang, Tan & Durlach 1991)."""


def _renderer(limits: Limits | None = None) -> Renderer:
    wall = Swatch("wall", stiffness_N_m=STIFFNESS_N_M)
    return Renderer(sheet(wall), ["wall"], tick_s=TICK_S, a_rate_Hz=1.0 / TICK_S, limits=limits)


def _poses(height_m: Array) -> Array:
    X_WB = np.tile(np.eye(4), (len(height_m), 1, 1))
    X_WB[:, 2, 3] = height_m
    return X_WB


def force_under(height_m: Array) -> Array:
    """Force (n,) on a tool that stands still at z = 0 while the wall is at heights (n,) [m], tick by tick [N]."""
    renderer = _renderer()
    path = np.tile((*AT_M, 0.0), (len(height_m), 1))
    path[0, 2] = max(0.0, height_m[0]) + 1e-3  # from above the wall
    return renderer.run(path, {"sheet": _poses(height_m)}).f_W_N[:, 2]


def deformed(speed_m_s: float, frames: int = 24) -> Array:
    """The same while the wall's shape rises at a speed, a new one each 17 ticks [N]."""
    renderer, each = _renderer(), round(FRAME_S / TICK_S)
    corners = np.array([(-0.1, -0.1, 0.0), (0.1, -0.1, 0.0), (0.1, 0.1, 0.0), (-0.1, 0.1, 0.0)])
    renderer.reset((*AT_M, 1e-3))
    f_N = []
    for frame in range(frames):
        renderer.deform("sheet", corners + np.array((0.0, 0.0, speed_m_s * each * TICK_S * frame)))
        f_N += [renderer.step((*AT_M, 0.0)).f_W_N[2] for _ in range(each)]
    return np.array(f_N)


def largest_step(f_N: Array, after: int = 2) -> float:
    """Largest step of force between ticks [N], past the beginning."""
    return float(np.abs(np.diff(f_N[after:])).max())


def wall_swings(ticks: int = 40, amplitude_m: float = 1e-3, cycles: int = 5) -> tuple[float, float]:
    """Energy that a wall which swings under a still tool gives away in a cycle of so many ticks [J]; in closed form."""
    turn = 2.0 * np.pi * np.arange(cycles * ticks + 2) / ticks
    height_m = 2.0 * amplitude_m + amplitude_m * np.sin(turn)
    f_N = force_under(height_m)
    gained = -(f_N[1:-1] * np.diff(height_m)[1:]).sum() / cycles  # as of a tool that moves over the wall
    return float(gained), STIFFNESS_N_M * amplitude_m**2 * ticks * math.sin(math.pi / ticks) ** 2


def flown_through(speed_m_s: float, limits: Limits, phases: int = 16) -> tuple[float, float]:
    """Energy that comes out of nothing while a tool flies into a wall and out again [J]: in the mean, at most.

    It turns where the force is long cut at its limit.
    """
    way, renderer, made_J = speed_m_s * TICK_S, _renderer(limits), []
    deep = math.ceil(3.0 * limits.force_N / STIFFNESS_N_M / way)
    for phase in (np.arange(phases) + 0.5) / phases:
        depth = np.concatenate((np.arange(-2, deep), np.arange(deep, -4, -1))) * way + phase * way
        path = np.column_stack((np.full(len(depth), AT_M[0]), np.full(len(depth), AT_M[1]), -depth))
        renderer.reset(path[0])
        f_N = renderer.run(path).f_W_N[:-1, 2]
        made_J.append(float((f_N * np.diff(path[:, 2])).sum()))
    return float(np.mean(made_J)), max(made_J)


class Plate:
    """A plate that lies on the tool by its weight, by the semi-implicit Euler method."""

    names = ("sheet",)

    def __init__(self, mass_kg: float, step_s: float, weight_N: float) -> None:
        self.mass_kg, self.step_s, self.weight_N = mass_kg, step_s, weight_N
        self.z_m, self.v_m_s = 0.97 * weight_N / STIFFNESS_N_M, 0.0

    def read(self, X_WB: Array) -> None:
        X_WB[0] = _poses(np.array([self.z_m]))[0]

    def mobility(self, body: int) -> Array:
        return np.diag([0.0, 0.0, 1.0 / self.mass_kg, 0.0, 0.0, 0.0])

    def advance(self, wrench_W: Array) -> None:
        self.v_m_s += (wrench_W[0, 2] + self.weight_N) / self.mass_kg * self.step_s
        self.z_m += self.v_m_s * self.step_s


def chatters(ratio: float, count: int) -> bool:
    """Whether a plate's motion on the tool grows, K T²/m being `ratio`, T `count` ticks."""
    step_s, weight_N = count * TICK_S, 0.3
    bridge = Bridge(Plate(STIFFNESS_N_M * step_s**2 / ratio, step_s, weight_N))
    renderer = _renderer()
    renderer.reset((*AT_M, 0.02))
    f_N: list[float] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ChatterWarning)
        for _ in range(160):
            bridge.step(renderer, lambda: (*AT_M, 0.0), lambda c: f_N.append(float(c.f_W_N[2])))
    off = np.abs(np.array(f_N[count:]) - weight_N)
    part = len(off) // 4
    lost = min(f_N[len(f_N) // 2 :]) == 0.0
    return bool(lost or off[-part:].max() > 1.02 * off[part : 2 * part].max())


def chatter_ratio(count: int) -> float:
    """The K T²/m from which on it does [1]."""
    low, high = 1.0, 5.0
    while high - low > 1e-2:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if chatters(middle, count) else (middle, high)
    return 0.5 * (low + high)


def stalled(stall_s: float, speed_m_s: float) -> tuple[Array, int]:
    """Places (n,) at which a body that moves evenly is felt [m], its game standing still for a time; when it goes on.

    Args:
        stall_s: how much later than due one frame comes.
        speed_m_s: of the body, which goes on in the game's time; the frames say it.
    """
    frames, predicted, impulse = records(1, FRAME), records(1, PREDICTED), np.zeros((1, 6))
    X_WB, teleported, clock = _poses(np.zeros(1))[None].copy(), np.zeros(1, np.int64), new_clock()
    each, late = 16, round(stall_s / TICK_S)
    due = [each * k + (late if k >= 20 else 0) for k in range(30)]
    place, start_ns = [], 10**12
    for k in range(due[-1] + 1):
        if k in due:
            frame = frames[0]
            frame.count += 1
            frame.X_WB, frame.v = _poses(np.array([speed_m_s * TICK_S * k]))[0], (0, 0, speed_m_s, 0, 0, 0)
            frame.time_ns, frame.lasts_s = start_ns + round(1e9 * TICK_S * k), HORIZON_S
            frame.count += 1
        now = start_ns + round(1e9 * TICK_S * k)
        predict_bodies(frames, predicted, np.zeros(1, np.int64), impulse, X_WB, teleported, now, clock, TICK_S)
        place.append(float(X_WB[0, 0, 2, 3]))
    return np.array(place), due[20]


def lag_m(stall_s: float, speed_m_s: float) -> float:
    """How far a body that was told its speed is behind when the game goes on [m]: it went on for `HORIZON_S`."""
    return speed_m_s * max(0.0, stall_s + 0.016 - HORIZON_S)


def catch_up_m_s(stall_s: float, speed_m_s: float) -> float:
    """How fast it is then felt to move [m/s]: what it is behind is made up in the mean time between frames."""
    behind_m, period_s = lag_m(stall_s, speed_m_s), 0.016 + SHARE * stall_s
    return speed_m_s + (behind_m + speed_m_s * TICK_S if behind_m > 0.0 else 0.0) / min(period_s, HORIZON_S)


def moving_cases() -> list[Answer]:
    """All of them, in some seconds."""
    step_N = STIFFNESS_N_M * SPEED_M_S * TICK_S
    height_m: Array = SPEED_M_S * TICK_S * np.arange(200.0)
    held_m = height_m[17 * (np.arange(200) // 17)]
    rows = [
        Answer(
            "wall-ticks",
            "step of force, a pose each tick, K v T [N]",
            step_N,
            largest_step(force_under(height_m)),
            1e-9,
        ),
        Answer(
            "wall-frames", "the same, poses held for 17 ticks [N]", 17 * step_N, largest_step(force_under(held_m)), 1e-9
        ),
        Answer(
            "wall-shapes", "the same, a shape each 17 ticks [N]", step_N, largest_step(deformed(SPEED_M_S), 85), 1e-6
        ),
    ]
    for ticks in (8, 40):
        gained, known = wall_swings(ticks)
        what = f"a wall swings in {ticks} ticks: energy a cycle, K A² n sin²(π/n) [mJ]"
        rows.append(Answer(f"wall-swings-{ticks}", what, 1e3 * known, 1e3 * gained, 1e-9))
    limits = limits_of("omni", TICK_S)
    for speed in (1.0, 2.0, 4.0):
        cut, guarded = flown_through(speed, Limits(limits.force_N))[0], flown_through(speed, limits)[1]
        due = 1e3 * limits.force_N * speed * TICK_S
        most = 1e3 * (STIFFNESS_N_M * (speed * TICK_S) ** 2 + limits.force_N * limits.quantum_m)
        rows.append(Answer(f"through-{speed:g}", "a tool flies through, mean energy, F v T [mJ]", due, 1e3 * cut, 1e-9))
        what = "the same with the passivity controller, at most, K v² T² + F Δ [mJ]"
        rows.append(Answer(f"through-{speed:g}-guarded", what, most, 1e3 * guarded, 0.0, at_most=True))
    for count in COUNTS:
        what = f"a pushed body, steps of {count} ticks: K T²/m from which it chatters [1]"
        rows.append(Answer(f"pushed-{count}", what, ratio_max(count), chatter_ratio(count), 0.02))
    for stall in STALLS_S:
        place, k = stalled(stall, SPEED_M_S)
        behind = SPEED_M_S * TICK_S * (k - 1) - place[k - 1]
        fastest = float(np.diff(place[k : k + 12]).max()) / TICK_S
        ms = f"{1e3 * stall:g}"
        rows.append(
            Answer(f"stall-{ms}", f"stall of {ms} ms: behind [mm]", 1e3 * lag_m(stall, SPEED_M_S), 1e3 * behind, 1e-9)
        )
        what = f"stall of {ms} ms: catches up at [mm/s]"
        rows.append(Answer(f"stall-{ms}-speed", what, 1e3 * catch_up_m_s(stall, SPEED_M_S), 1e3 * fastest, 1e-9))
    return rows


def draw_moving(path: Path) -> None:
    """Chart: energy of a fast tool, masses that chatter, and what a stall does to the force; lines are closed forms."""
    limits = limits_of("omni", TICK_S)

    def draw(_: Any, axes: Any) -> None:
        through, pushed, stalls = axes[0]
        line, some = np.geomspace(0.2, 8.0, 60), np.geomspace(0.25, 8.0, 9)
        through.plot(line, limits.force_N * line, color=INK, linewidth=1.2, label="F v T")
        bound = 1e3 * (STIFFNESS_N_M * (line * TICK_S) ** 2 + limits.force_N * limits.quantum_m)
        through.plot(
            line, np.minimum(bound, limits.force_N * line), "--", color=INK, linewidth=1.2, label="K v² T² + F Δ"
        )
        for label, given, which, (colour, marker) in (
            ("force cut, nothing else", Limits(limits.force_N), 0, ("vermilion", "o")),
            ("and passivity controller", limits, 1, ("blue", "s")),
        ):
            made = [1e3 * flown_through(v, given)[which] for v in some]
            through.plot(some, made, marker, color=OKABE_ITO[colour], fillstyle="none", label=label)
        through.axhline(2.0, color=OKABE_ITO["black"], linestyle=":", linewidth=1.0)
        through.set(xscale="log", yscale="log", xlabel="speed of the tool [m/s]", ylabel="energy out of nothing [mJ]")
        through.set_xticks([0.25, 0.5, 1, 2, 4, 8], ["0.25", "0.5", "1", "2", "4", "8"])
        through.xaxis.minorticks_off()
        through.set_title("Into a wall and out again: 500 N/m, 3.3 N, 1 kHz")
        through.legend(loc="upper left", fontsize=9)
        step_ms = np.arange(1.0, 21.0)
        counts = np.array(COUNTS)
        least = [1e3 * STIFFNESS_N_M * (1e-3 * n) ** 2 / ratio_max(round(n)) for n in step_ms]
        found = [1e3 * STIFFNESS_N_M * (TICK_S * n) ** 2 / chatter_ratio(n) for n in COUNTS]
        pushed.plot(step_ms, least, color=INK, linewidth=1.2, label="closed form")
        pushed.fill_between(step_ms, 1e-2, least, color=OKABE_ITO["vermilion"], alpha=0.12, linewidth=0)
        pushed.text(4.0, 0.03, "chatters", color=OKABE_ITO["vermilion"])
        pushed.plot(counts, found, "o", color=OKABE_ITO["vermilion"], fillstyle="none", label="simulated")
        pushed.set(xscale="log", yscale="log", ylim=(1e-2, 200.0), xlabel="step of the simulation [ms]")
        pushed.set(ylabel="mass of the pushed body [g]")
        pushed.set_title("A body that is pushed, at 500 N/m")
        pushed.legend(loc="upper left", fontsize=9)
        stall_s = np.geomspace(0.008, 0.6, 80)
        for speed, (colour, marker) in zip(
            (0.02, 0.05, 0.2), (("blue", "o"), ("green", "s"), ("orange", "D")), strict=True
        ):
            step = 1e3 * STIFFNESS_N_M * TICK_S
            known = [step * catch_up_m_s(s, speed) for s in stall_s]
            stalls.plot(1e3 * stall_s, known, color=OKABE_ITO[colour], linewidth=1.2)
            runs = [(s, *stalled(s, speed)) for s in STALLS_S]
            seen = [step * np.diff(place[k : k + 12]).max() / TICK_S for _, place, k in runs]
            stalls.plot(
                1e3 * np.array(STALLS_S),
                seen,
                marker,
                color=OKABE_ITO[colour],
                fillstyle="none",
                label=f"{speed:g} m/s",
            )
        stalls.axhline(1e3 * FELT_N, color=OKABE_ITO["black"], linestyle=":", linewidth=1.0)
        stalls.text(9.0, 1.1e3 * FELT_N, "felt beside 1 N", fontsize=9)
        stalls.set(xscale="log", yscale="log", xlabel="the game stands still for [ms]", ylabel="step of force [mN]")
        stalls.set_title("A body catches up after a stall, at 500 N/m")
        stalls.legend(loc="upper left", fontsize=9)

    draw_panels(path, 1, 3, (5.4, 4.6), draw)
