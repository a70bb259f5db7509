"""hand.png: a touch in closed loop: what the hand meant, where the tool went, what motors and handle did."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hapscene.view.chart import save_chart
from hapscene.view.palette import INK, OKABE_ITO
from hapscene.view.plot import DPI, STYLE, envelope, legend_above, shade

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hapscene.twin.feel import Feel


def write_hand_plot(feel: "Feel", path: str | Path, title: str = "", dark: bool = False) -> None:
    """Draw heights, forces, accelerations and the motors' work over time as PNG, on light or dark ground.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    save_chart(draw_hand_plot(feel, title), path, DPI, dark)


def draw_hand_plot(feel: "Feel", title: str = "") -> "Figure":
    """The figure that `write_hand_plot` writes."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(cast(Any, STYLE)):
        figure = Figure(figsize=(13, 9.5), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(4, 1, sharex=True)
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, color=INK)
        for ax, draw in zip(axes, (_draw_height, _draw_force, _draw_acceleration, _draw_work), strict=True):
            draw(ax, feel)
            shade(ax, feel.recording)
            ax.grid(axis="y", color="#D8D8D8", linewidth=0.6)
            ax.set_axisbelow(True)
            legend_above(ax)
        axes[-1].set_xlabel("time [s]")
        axes[0].set_xlim(feel.recording.t_s[0], feel.recording.t_s[-1])
        figure.align_ylabels(axes)
    return figure


def _draw_height(ax: "Axes", feel: "Feel") -> None:
    """Heights of what the hand means, the tool, and the proxy."""
    t_s = feel.recording.t_s
    ax.plot(t_s, feel.target_W_m[:, 2] * 1e3, color=OKABE_ITO["orange"], linewidth=1.2, label="meant by the hand")
    ax.plot(t_s, feel.p_W_m[:, 2] * 1e3, color=OKABE_ITO["blue"], linewidth=1.2, label="tool")
    surface_m = np.where(feel.recording.touching, feel.recording.p_WP_m[:, 2], np.nan)
    ax.plot(t_s, surface_m * 1e3, color=INK, linewidth=1.2, linestyle=":", label="proxy on the surface")
    ax.set_ylabel("height [mm]")


def _draw_force(ax: "Axes", feel: "Feel") -> None:
    """Magnitudes of the motors' force and the hand's."""
    t_s = feel.recording.t_s
    ax.plot(t_s, np.linalg.norm(feel.f_hand_W_N, axis=1), color=OKABE_ITO["orange"], linewidth=1.2, label="hand")
    ax.plot(t_s, np.linalg.norm(feel.f_motor_W_N, axis=1), color=OKABE_ITO["blue"], linewidth=1.2, label="motors")
    ax.set_ylabel("force [N]")


def _draw_acceleration(ax: "Axes", feel: "Feel") -> None:
    """What the textures ask for, and what the handle makes of it."""
    recording = feel.recording
    parts = (
        ("asked for", recording.a_m_s2.ravel(), recording.a_t_s, "sky"),
        ("of the handle", feel.a_handle_m_s2.ravel(), recording.a_t_s - feel.latency_s, "vermilion"),
    )
    for name, a_m_s2, at_s, colour in parts:
        t_s, low, high = envelope(at_s, a_m_s2)
        ax.fill_between(
            t_s, low, high, facecolor=OKABE_ITO[colour], edgecolor=OKABE_ITO[colour], linewidth=0.5, label=name
        )
    if not recording.a_m_s2.any():
        ax.set_ylim(-1, 1)
    ax.set_ylabel("acceleration\n[m/s²]")


def _draw_work(ax: "Axes", feel: "Feel") -> None:
    """Energy that the motors gave the tool: what it ends at is dissipated where negative, made up where positive."""
    work_mJ = np.cumsum(feel.work_J) * 1e3
    ax.plot(feel.recording.t_s, work_mJ, color=OKABE_ITO["blue"], linewidth=1.2, label="given by the motors")
    ax.axhline(0.0, color=INK, linewidth=0.8)
    ax.set_ylabel("energy [mJ]")
