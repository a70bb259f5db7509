"""What delay does to the position–position controller, and to wave variables: rest, energy, and stiffness felt.

Each scheme lands on the plate and swings in the air, in light and firm hands, over a line that only delays and over a
bad one. Two questions are put to each run: does all come to rest where a hand is still, and did the motors give out
energy? A passive scheme can, at most, give out its allowances, of 1 mJ each. delay.png shows it all.
"""

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.hand import Grip
from hapscene.device.point import PointMass
from hapscene.parallel import Task, run_tasks
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.endpoint import SCHEMES, Coupling
from hapscene.teleoperation.link import Impairment
from hapscene.teleoperation.operation import Operated, Operation
from hapscene.teleoperation.test_plate import plate
from hapscene.twin.hand_intent import Intent
from hapscene.view.chart import new_chart, save_chart
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DELAYS_S: Final = (0.0, 0.005, 0.010, 0.020, 0.050, 0.100)
"""Delays of the study, one way [s]."""

BAD: Final = {"jitter_s": 0.005, "loss": 0.05, "reorder": 0.05}
"""The bad line: what comes to each delay."""

GRIPS: Final = ("light", "firm")


def land(grip: str) -> Intent:
    """Come down at 0.2 m/s, aim 2 cm below the surface and stay: a hard contact, then a hand that insists."""
    t_s = np.arange(4.0 / TICK_S) * TICK_S
    z_m = np.maximum(0.03 - 0.2 * np.maximum(t_s - 0.2, 0.0), -0.02)
    return Intent.along(np.column_stack((0.0 * t_s, 0.0 * t_s, z_m)), grip)


def swing(grip: str) -> Intent:
    """Swing 1 cm up and down at 3 Hz in the air for two seconds, then be still."""
    t_s = np.arange(4.0 / TICK_S) * TICK_S
    z_m = 0.03 + 0.01 * np.sin(6.0 * np.pi * t_s) * np.minimum(5.0 * t_s, 1.0) * (t_s < 2.0)
    return Intent.along(np.column_stack((0.0 * t_s, 0.0 * t_s, z_m)), grip)


CASES: Final[dict[str, Callable[[str], Intent]]] = {"land": land, "swing": swing}

REST_MAX_M_S: Final = 0.005
"""Speed of the faster tool, root mean square over the last second, above which it is not at rest [m/s]."""

ENERGY_MAX_J: Final = 2e-3
"""Energy given out above which a run is not passive [J]: the allowances of both ends."""

WALL_N_M: Final = 500.0
"""Stiffness of the plate where the stiffness felt is measured [N/m]."""


@dataclass(frozen=True)
class DelayOutcome:
    """One run of the study."""

    scheme: str
    delay_s: float
    bad: bool
    case: str
    grip: str
    rest_m_s: float
    energy_out_J: float

    @property
    def stable(self) -> bool:
        """Whether it came to rest without giving out energy."""
        return self.rest_m_s <= REST_MAX_M_S and self.energy_out_J <= ENERGY_MAX_J


def study_delays(
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
    delays_s: Iterable[float] = DELAYS_S,
    schemes: Sequence[str] = SCHEMES,
    **workers: Any,
) -> list[DelayOutcome]:
    """All runs: schemes, delays, lines, cases and grips; `workers` as of `hapscene.parallel.run_tasks`."""
    runs = [
        (scheme, delay_s, bad, case, grip)
        for delay_s in delays_s
        for scheme, bad, case, grip in product(schemes, (False, True), CASES, GRIPS)
    ]
    names = ("scheme", "delay_s", "bad", "case", "grip")
    pieces = [
        Task(
            f"{scheme}, {1e3 * delay_s:g} ms, {'bad' if bad else 'clean'} line, {case}, {grip} grip",
            run_case,
            {**dict(zip(names, run, strict=True)), "seed": seed},
        )
        for run in runs
        for scheme, delay_s, bad, case, grip in (run,)
    ]
    found = run_tasks(pieces, after=lambda done, of, key: say(f"delay {done} of {of}: {key}\n"), **workers)
    return [DelayOutcome(*run, *found[piece.key]) for run, piece in zip(runs, pieces, strict=True)]


def run_case(**case: Any) -> tuple[float, float]:
    """Rest [m/s] and energy given out [J] of one run, in whichever process."""
    operated = operate_case(**case)
    return operated.rest_m_s, operated.energy_out_J


def operate_case(scheme: str, delay_s: float, bad: bool, case: str, grip: str, seed: int = 0) -> Operated:
    """One run of the study."""
    intent = CASES[case](grip)
    line = Impairment(delay_s, **BAD) if bad else Impairment(delay_s)
    start = intent.target_W_m[0]
    operation = Operation(plate("wood"), start, coupling=Coupling(scheme), line=line, compensator="none", seed=seed)
    return operation.run(intent)


def trace_delay(seed: int = 0, delay_s: float = 0.05) -> dict[str, Operated]:
    """Both schemes landing in a light hand, over a line that only delays."""
    return {scheme: operate_case(scheme, delay_s, False, "land", "light", seed) for scheme in SCHEMES}


def summarise_delays(outcomes: list[DelayOutcome]) -> dict[str, Any]:
    """The worst of each scheme at each delay."""
    rows: dict[str, Any] = {}
    for outcome in outcomes:
        line = "bad" if outcome.bad else "clean"
        row = rows.setdefault(outcome.scheme, {}).setdefault(f"{outcome.delay_s * 1e3:g} ms", {})
        worst = row.setdefault(line, {"rest_mm_s": 0.0, "energy_out_mJ": 0.0, "stable": True})
        worst["rest_mm_s"] = max(worst["rest_mm_s"], round(outcome.rest_m_s * 1e3, 3))
        worst["energy_out_mJ"] = max(worst["energy_out_mJ"], round(outcome.energy_out_J * 1e3, 3))
        worst["stable"] = worst["stable"] and outcome.stable
    return rows


def study_stiffness(delays_s: Iterable[float] = DELAYS_S) -> list[dict[str, float]]:
    """Stiffness that a hand feels through waves, against its closed form, by delay.

    At rest the line is a spring of b/d: the totals of what is under way are the delay times the waves, so that
    x_leader − x_desired = d F/b. In a row with the follower's spring and the wall, 1/K = 1/K_wall + 1/K_c + d/b.
    Measured without friction, from the rests that two forces of the hand lead to.
    """
    rows = []
    for delay_s in delays_s:
        felt_N_m, line_s = measure_stiffness(Coupling("wave"), delay_s)
        predicted_N_m = predict_stiffness(line_s)
        rows.append({"delay_s": delay_s, "line_s": line_s, "felt_N_m": felt_N_m, "predicted_N_m": predicted_N_m})
    return rows


def predict_stiffness(delay_s: float, coupling: Coupling | None = None) -> float:
    """The closed form of `study_stiffness` [N/m]; at no delay it is that of the position–position controller."""
    tied = coupling or Coupling()
    return 1.0 / (1.0 / WALL_N_M + 1.0 / tied.stiffness_N_m + delay_s / tied.impedance_Ns_m)


def measure_stiffness(coupling: Coupling, delay_s: float) -> tuple[float, float]:
    """Stiffness felt at the leader [N/m], and how long a wave was under way, mean of both ways [s]."""
    scene = plate(Swatch("wall", stiffness_N_m=WALL_N_M))
    start = (0.0, 0.0, 0.002)
    bare: dict[str, Any] = {"device": PointMass(0.045, 0.1), "compensator": "none", "effects": ("wall",)}
    operation = Operation(scene, start, coupling=coupling, line=Impairment(delay_s), **bare)
    found = []
    for push_N in (-0.5, -1.0):
        operated = operation.run(Intent.hold(start, 6000, Grip(0.0, 2.0), push_W_N=(0.0, 0.0, push_N)))
        found.append((push_N, operated.leader_W_m[-1, 2]))
    queues = [end.queue[0] for end in (operation.leader.end, operation.follower.end)]
    lag_s = float(np.mean([int(queue.lag_ticks) for queue in queues])) * 1e-3
    (f0, z0), (f1, z1) = found
    return float((f1 - f0) / (z1 - z0)), lag_s


# delay.png: rest, energy and stiffness by delay, for both schemes, and one landing over time.

NAMES: Final = {"position": "position–position", "wave": "wave variables"}

COLOURS: Final = {"position": OKABE_ITO["vermilion"], "wave": OKABE_ITO["blue"]}

FLOOR_MM_S: Final = 0.01
"""Speeds below this are drawn at it [mm/s]: a tenth of what a person feels move."""

FAINT: Final = "#F6E3D9"
"""Behind delays at which the position–position controller failed."""


def write_delay_plot(
    outcomes: list[DelayOutcome], stiffness: list[dict[str, float]], trace: dict[str, Operated], path: Path
) -> None:
    """Draw the study of delay as PNG."""
    with new_chart(13, 8.5) as figure:
        axes = figure.subplots(2, 2)
        _draw_worst(axes[0, 0], outcomes, "rest_m_s", 1e3, FLOOR_MM_S, REST_MAX_M_S)
        axes[0, 0].set_title("at rest? the worst of landing and swinging, light and firm hand")
        axes[0, 0].set_ylabel("speed in the last second, rms [mm/s]")
        _draw_worst(axes[0, 1], outcomes, "energy_out_J", 1e3, 0.1, ENERGY_MAX_J)
        axes[0, 1].set_title("passive? the worst of the same")
        axes[0, 1].set_ylabel("energy given out by the motors [mJ]")
        _draw_stiffness(axes[1, 0], outcomes, stiffness)
        _draw_trace(axes[1, 1], trace)
        for ax in (axes[0, 0], axes[0, 1], axes[1, 0]):
            ax.set_xlabel("delay of the line, one way [ms]")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=2, fontsize=9)
        save_chart(figure, path)


def _draw_worst(ax: "Axes", outcomes: list[DelayOutcome], name: str, scale: float, floor: float, limit: float) -> None:
    """The worst by delay, a line for each scheme and line, and the limit."""
    _shade(ax, outcomes)
    delays_s = sorted({outcome.delay_s for outcome in outcomes})
    for scheme in SCHEMES:
        for bad, dash, marker in ((False, "-", "o"), (True, "--", "s")):
            worst = [
                max(getattr(o, name) for o in outcomes if (o.scheme, o.bad, o.delay_s) == (scheme, bad, delay_s))
                for delay_s in delays_s
            ]
            label = f"{NAMES[scheme]}, {'jitter 5 ms, 5 % lost, 5 % overtaken' if bad else 'delay alone'}"
            values = np.maximum(np.array(worst) * scale, floor)
            delays_ms = np.array(delays_s) * 1e3
            ax.plot(delays_ms, values, dash, marker=marker, color=COLOURS[scheme], label=label, markersize=5)
    ax.text(101.0, floor * 1.12, f"{floor:g} and less", ha="right", va="bottom", fontsize=8)
    ax.axhline(limit * scale, color=INK, linewidth=0.9, linestyle=":")
    ax.text(101.0, limit * scale * 1.1, "limit", ha="right", va="bottom")
    ax.set_yscale("log")


def _draw_stiffness(ax: "Axes", outcomes: list[DelayOutcome], stiffness: list[dict[str, float]]) -> None:
    """Stiffness felt through both schemes."""
    spans = _shade(ax, outcomes)
    delay_ms = np.linspace(0.0, 100.0, 201)
    predicted_N_m = [predict_stiffness(d * 1e-3) for d in delay_ms]
    ax.plot(delay_ms, predicted_N_m, color=COLOURS["wave"], label="waves, closed form")
    measured = [(row["line_s"] * 1e3, row["felt_N_m"]) for row in stiffness]
    ax.plot(*np.array(measured).T, "o", color=COLOURS["wave"], label="waves, measured")
    last_ms = min((a for a, _ in spans), default=100.0)
    ax.plot((0.0, last_ms), [predict_stiffness(0.0)] * 2, color=COLOURS["position"], label="position–position")
    if spans:
        ax.text(last_ms + 2.0, 215.0, "here position–position\nis unstable", fontsize=9, va="top")
    ax.set_ylim(bottom=0.0)
    ax.set_title("a plate of 500 N/m through a spring of 500 N/m")
    ax.set_ylabel("stiffness felt [N/m]")
    ax.legend(loc="upper right", fontsize=9)


def _draw_trace(ax: "Axes", trace: dict[str, Operated]) -> None:
    """The leader's height while it lands."""
    for scheme, operated in trace.items():
        z_mm = operated.leader_W_m[:, 2] * 1e3
        ax.plot(operated.t_s, z_mm, color=COLOURS[scheme], linewidth=1.0, label=NAMES[scheme])
    ax.axhline(0.0, color=INK, linewidth=0.9, linestyle=":")
    ax.text(4.05, 0.0, "plate", va="center")
    ax.set_title("landing in a light hand, 50 ms each way")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("height of the leader's tool [mm]")
    ax.set_xlim(0.0, 4.4)
    ax.legend(loc="lower left", fontsize=9, ncols=2)
    low, high = ax.get_ylim()
    ax.set_ylim(low - 0.15 * (high - low), high)


def _shade(ax: "Axes", outcomes: list[DelayOutcome]) -> list[tuple[float, float]]:
    """Shade the delays [ms] at which the position–position controller failed; returns the spans."""
    delays_ms = sorted({outcome.delay_s * 1e3 for outcome in outcomes})
    failed = {o.delay_s * 1e3 for o in outcomes if o.scheme == "position" and not o.stable and not o.bad}
    edges = [0.0, *[(a + b) / 2 for a, b in pairwise(delays_ms)], delays_ms[-1]]
    spans = [(a, b) for (a, b), d in zip(pairwise(edges), delays_ms, strict=True) if d in failed]
    for a, b in spans:
        ax.axvspan(a, b, color=FAINT, linewidth=0, zorder=0)
    return spans


def main(out: Path) -> None:
    """Run the study, and write delay.png and delay.json into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    outcomes, stiffness = study_delays(say=lambda text: print(text, end="")), study_stiffness()
    write_delay_plot(outcomes, stiffness, trace_delay(), out / "delay.png")
    summary = {"delay": summarise_delays(outcomes), "stiffness": stiffness}
    (out / "delay.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
