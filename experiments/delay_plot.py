"""delay.png: rest, energy and stiffness by delay, for both schemes, and one landing over time."""

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from hapscene.files import whole_file
from hapscene.teleoperation.endpoint import SCHEMES
from hapscene.teleoperation.experiment import STYLE
from hapscene.teleoperation.operation import Operated
from hapscene.view.palette import INK, OKABE_ITO

from .delay_study import ENERGY_MAX_J, REST_MAX_M_S, DelayOutcome, predict_stiffness

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(cast(Any, STYLE)):
        figure = Figure(figsize=(13, 8.5), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, 2)
        _draw_worst(axes[0, 0], outcomes, "rest_m_s", 1e3, FLOOR_MM_S, REST_MAX_M_S)
        axes[0, 0].set_title("at rest? the worst of landing and swinging, light and firm hand", loc="left", fontsize=10)
        axes[0, 0].set_ylabel("speed in the last second, rms [mm/s]")
        _draw_worst(axes[0, 1], outcomes, "energy_out_J", 1e3, 0.1, ENERGY_MAX_J)
        axes[0, 1].set_title("passive? the worst of the same", loc="left", fontsize=10)
        axes[0, 1].set_ylabel("energy given out by the motors [mJ]")
        _draw_stiffness(axes[1, 0], outcomes, stiffness)
        _draw_trace(axes[1, 1], trace)
        for ax in axes.ravel():
            ax.grid(color="#E4E4E4", linewidth=0.6)
            ax.set_axisbelow(True)
        for ax in (axes[0, 0], axes[0, 1], axes[1, 0]):
            ax.set_xlabel("delay of the line, one way [ms]")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=2, fontsize=9)
        with whole_file(path) as part:
            figure.savefig(part, format="png", dpi=110, metadata={"Software": "hapscene"})


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
            ax.plot(
                np.array(delays_s) * 1e3, values, dash, marker=marker, color=COLOURS[scheme], label=label, markersize=5
            )
    ax.text(101.0, floor * 1.12, f"{floor:g} and less", ha="right", va="bottom", fontsize=8)
    ax.axhline(limit * scale, color=INK, linewidth=0.9, linestyle=":")
    ax.text(101.0, limit * scale * 1.1, "limit", ha="right", va="bottom")
    ax.set_yscale("log")


def _draw_stiffness(ax: "Axes", outcomes: list[DelayOutcome], stiffness: list[dict[str, float]]) -> None:
    """Stiffness felt through both schemes."""
    spans = _shade(ax, outcomes)
    delay_ms = np.linspace(0.0, 100.0, 201)
    ax.plot(
        delay_ms, [predict_stiffness(d * 1e-3) for d in delay_ms], color=COLOURS["wave"], label="waves, closed form"
    )
    measured = [(row["line_s"] * 1e3, row["felt_N_m"]) for row in stiffness]
    ax.plot(*np.array(measured).T, "o", color=COLOURS["wave"], label="waves, measured")
    last_ms = min((a for a, _ in spans), default=100.0)
    ax.plot((0.0, last_ms), [predict_stiffness(0.0)] * 2, color=COLOURS["position"], label="position–position")
    if spans:
        ax.text(last_ms + 2.0, 215.0, "here position–position\nis unstable", fontsize=9, va="top")
    ax.set_ylim(bottom=0.0)
    ax.set_title("a plate of 500 N/m through a spring of 500 N/m", loc="left", fontsize=10)
    ax.set_ylabel("stiffness felt [N/m]")
    ax.legend(loc="upper right", fontsize=9)


def _draw_trace(ax: "Axes", trace: dict[str, Operated]) -> None:
    """The leader's height while it lands."""
    for scheme, operated in trace.items():
        ax.plot(
            operated.t_s, operated.leader_W_m[:, 2] * 1e3, color=COLOURS[scheme], linewidth=1.0, label=NAMES[scheme]
        )
    ax.axhline(0.0, color=INK, linewidth=0.9, linestyle=":")
    ax.text(4.05, 0.0, "plate", va="center")
    ax.set_title("landing in a light hand, 50 ms each way", loc="left", fontsize=10)
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
