"""Plots of a recorded touch over time (plots.png), and of a closed-loop touch (hand.png)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.render.recording import Recording
from hapscene.view.chart import new_chart
from hapscene.view.palette import INK, OKABE_ITO, SHADE

__all__ = ["STYLE", "draw_hand_plot", "draw_plot", "envelope"]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hapscene.loop.result import ClosedLoopResult


COLUMN_COUNT: Final = 2000
"""Number of columns of a plotted signal [count]; each shows the range of its samples, so peaks remain visible."""

WINDOW_S: Final = 0.05
"""Window length of the spectrogram [s]: a frequency resolution of 20 Hz, and taps still appear short."""

WINDOWS: Final = 1200
"""Number of windows of the spectrogram [count], about one per pixel column; more if they would overlap less than
half."""

RANGE_DB: Final = 60.0
"""Dynamic range of the spectrogram [dB]."""

FREQUENCY_MAX_HZ: Final = 1000.0
"""Maximum plotted frequency [Hz], above which vibration is not perceived."""


def draw_plot(recording: Recording, title: str = "", colours: Sequence[str] | None = None) -> "Figure":
    """Return a figure of swatch, force, penetration depth, acceleration and its spectrogram over time.

    Args:
        recording: recording of at least one tick.
        title: title of the figure.
        colours: colour "#rrggbb" of each swatch in `recording.swatch_names`. Default: a palette.
    """
    with new_chart(*SIZE_IN, title, STYLE, layout=None) as figure:
        swatch_count = len(np.unique(recording.swatch[recording.swatch >= 0]))
        axes = _rows(figure, (0.4, 3, 2, 2, 2.6), legend_rows=-(-swatch_count // LEGEND_COLUMNS))
        _draw_swatches(axes[0], recording, colours or [*OKABE_ITO.values()] * len(recording.swatch_names))
        _draw_force(axes[1], recording)
        _draw_depth(axes[2], recording)
        _draw_acceleration(axes[3], recording)
        _, bottom, _, height = axes[4].get_position().bounds
        bar = figure.add_axes((RIGHT + 0.01, bottom, 0.01, height))  # beside the plots, to hide no data
        _draw_spectrogram(axes[4], bar, recording)
        for ax in axes[1:4]:
            shade(ax, recording)
        axes[0].yaxis.set_label_coords(-0.005, 0.5)
        axes[0].set_xlim(recording.t_s[0], recording.t_s[-1] + _tick_s(recording))
    return figure


def _rows(figure: "Figure", heights: Sequence[float], legend_rows: int = 1) -> list["Axes"]:
    """Create axes with a common time axis and space for legends above each; more rows of legend above the first.

    Their positions are fixed, since fitting them to labels would double the time for text layout.
    """
    top = 1.0 - TITLE - LEGEND_ROW * max(legend_rows, 1)
    gap = LEGEND_ROW * len(heights) / (top - BOTTOM - LEGEND_ROW * (len(heights) - 1))
    grid = figure.add_gridspec(
        len(heights), 1, height_ratios=heights, left=LEFT, right=RIGHT, bottom=BOTTOM, top=top, hspace=gap
    )
    axes = [figure.add_subplot(grid[0])]
    axes += [figure.add_subplot(grid[row], sharex=axes[0]) for row in range(1, len(heights))]
    for ax in axes:
        ax.yaxis.set_label_coords(-0.052, 0.5)
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time [s]")
    return axes


SIZE_IN: Final = (13.0, 9.5)
"""Size of the figures [in]."""

LEFT, RIGHT, BOTTOM, TITLE, LEGEND_ROW = 0.076, 0.93, 0.055, 0.044, 0.034
"""Limits of the axes, and heights of the title and of a legend row, relative to the figure [1]."""

LEGEND_COLUMNS: Final = 8
"""Number of entries in a legend row [count]."""

STYLE: Final[dict[str, Any]] = {"axes.grid.axis": "y", "font.size": 11}
"""Differences from the common chart style."""


def _draw_swatches(ax: "Axes", recording: Recording, colours: Sequence[str]) -> None:
    """Draw a bar that shows the touched swatch."""
    for index in np.unique(recording.swatch[recording.swatch >= 0]):
        spans = _spans(recording.swatch == index, recording)
        name, colour = recording.swatch_names[index], colours[index]
        ax.broken_barh(spans, (0, 1), facecolor=colour, edgecolor="#777777", linewidth=0.5, label=name)
    ax.set_ylim(0, 1)
    ax.set_yticks([])
    ax.set_ylabel("swatch", rotation=0, ha="right", va="center")
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)
    ax.tick_params(bottom=False)
    legend_above(ax)


def _draw_force(ax: "Axes", recording: Recording) -> None:
    """Draw magnitude and components of the force."""
    t_s, f_W_N = recording.t_s, recording.f_W_N
    ax.plot(t_s, np.linalg.norm(f_W_N, axis=1), color="#A9AFB8", linewidth=4.0, label="magnitude")
    for axis, colour in enumerate(("vermilion", "green", "blue")):
        ax.plot(t_s, f_W_N[:, axis], color=OKABE_ITO[colour], linewidth=1.0, label="xyz"[axis])
    ax.set_ylabel("force [N]")
    legend_above(ax)


def _draw_depth(ax: "Axes", recording: Recording) -> None:
    """Draw the penetration depth."""
    ax.plot(recording.t_s, recording.depth_m * 1e3, color=OKABE_ITO["blue"], linewidth=1.2)
    ax.set_ylim(bottom=0)
    ax.set_ylabel("depth [mm]")


def _draw_acceleration(ax: "Axes", recording: Recording) -> None:
    """Draw the acceleration with all peaks."""
    _fill_accelerations(ax, recording, (None, recording.a_m_s2, recording.a_t_s, "vermilion"))


def _fill_accelerations(ax: "Axes", recording: Recording, *parts: tuple[str | None, Any, Any, str]) -> None:
    """Draw accelerations (n, block) with label, times (n block,) and colour, with all peaks."""
    for label, a_m_s2, at_s, colour in parts:
        t_s, low, high = envelope(at_s, a_m_s2.ravel())
        rgb = OKABE_ITO[colour]
        ax.fill_between(t_s, low, high, facecolor=rgb, edgecolor=rgb, linewidth=0.5, label=label)
    if not recording.a_m_s2.any():
        ax.set_ylim(-1, 1)
    ax.set_ylabel("acceleration\n[m/s²]")


def _draw_spectrogram(ax: "Axes", bar: "Axes", recording: Recording) -> None:
    """Draw the power spectral density of the acceleration over time [dB]."""
    from matplotlib import mlab

    a_m_s2, rate_Hz = recording.a_m_s2.ravel(), recording.a_rate_Hz
    ax.set_ylabel("acceleration,\nfrequency [Hz]")
    ax.set_ylim(0, min(FREQUENCY_MAX_HZ, rate_Hz / 2))
    ax.grid(visible=False)
    bar.set_visible(False)
    length = int(WINDOW_S * rate_Hz)
    if len(a_m_s2) < 2 * length or not a_m_s2.any():
        ax.text(0.5, 0.5, "silence", transform=ax.transAxes, ha="center", va="center")
        return
    hop = max(min(length // 2, len(a_m_s2) // WINDOWS), 1)
    found = mlab.specgram(a_m_s2, length, rate_Hz, "mean", noverlap=length - hop, pad_to=2 * length)
    density, frequency_Hz, t_s = map(np.asarray, found)
    seen = frequency_Hz <= FREQUENCY_MAX_HZ
    level_dB = 10 * np.log10(np.maximum(density[seen], 1e-30))
    top_dB = float(np.ceil(level_dB.max()))
    extent = (recording.t_s[0] + t_s[0], recording.t_s[0] + t_s[-1], 0.0, float(frequency_Hz[seen][-1]))
    image = ax.imshow(
        level_dB, origin="lower", aspect="auto", cmap="magma", vmin=top_dB - RANGE_DB, vmax=top_dB, extent=extent
    )
    bar.set_visible(True)
    ax.figure.colorbar(image, cax=bar, label="dB re 1 (m/s²)²/Hz")


def legend_above(ax: "Axes") -> None:
    """Draw the legend above the axes."""
    handles, names = ax.get_legend_handles_labels()
    if handles:
        ax.legend(
            handles,
            names,
            bbox_to_anchor=(0, 1.0),
            loc="lower left",
            ncols=LEGEND_COLUMNS,
            borderpad=0.2,
            handlelength=1.2,
        )


def shade(ax: "Axes", recording: Recording) -> None:
    """Shade the times of contact."""
    spans = _spans(recording.touching, recording)
    if spans:
        ax.broken_barh(spans, (0, 1), transform=ax.get_xaxis_transform(), facecolor=SHADE, linewidth=0, zorder=0)


def _spans(mask: NDArray[np.bool_], recording: Recording) -> list[tuple[float, float]]:
    """Return start and duration [s] of each run of True in `mask` (n,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    times_s = np.append(recording.t_s, recording.t_s[-1] + _tick_s(recording))[edges]
    return [(float(a), float(b - a)) for a, b in times_s.reshape(-1, 2)]


def _tick_s(recording: Recording) -> float:
    """Return the tick period [s], which is the length of an acceleration block."""
    return float(recording.a_m_s2.shape[1] / recording.a_rate_Hz)


def envelope(
    t_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Reduce a signal to `COLUMN_COUNT` columns; return their times, minima and maxima."""
    stride = max(len(values) // COLUMN_COUNT, 1)
    start = np.arange(0, len(values), stride)
    return t_s[start], np.minimum.reduceat(values, start), np.maximum.reduceat(values, start)


# hand.png: a closed-loop touch with simulated hand: target and device position, forces, accelerations, energy.


def draw_hand_plot(result: "ClosedLoopResult", title: str = "") -> "Figure":
    """Return a figure of heights, forces, accelerations and motor work over time."""
    with new_chart(*SIZE_IN, title, STYLE, layout=None) as figure:
        axes = _rows(figure, (1, 1, 1, 1))
        for ax, draw in zip(axes, (_draw_height, _draw_hand_force, _draw_hand_acceleration, _draw_work), strict=True):
            draw(ax, result)
            shade(ax, result.recording)
            legend_above(ax)
        axes[0].set_xlim(result.recording.t_s[0], result.recording.t_s[-1])
    return figure


def _draw_height(ax: "Axes", result: "ClosedLoopResult") -> None:
    """Draw the heights of the target of the hand, the device and the proxy."""
    t_s = result.recording.t_s
    ax.plot(t_s, result.target_W_m[:, 2] * 1e3, color=OKABE_ITO["orange"], linewidth=1.2, label="target of the hand")
    ax.plot(t_s, result.p_W_m[:, 2] * 1e3, color=OKABE_ITO["blue"], linewidth=1.2, label="device")
    surface_m = np.where(result.recording.touching, result.recording.p_WP_m[:, 2], np.nan)
    ax.plot(t_s, surface_m * 1e3, color=INK, linewidth=1.2, linestyle=":", label="proxy on the surface")
    ax.set_ylabel("height [mm]")


def _draw_hand_force(ax: "Axes", result: "ClosedLoopResult") -> None:
    """Draw the magnitudes of the forces of motors and hand."""
    t_s = result.recording.t_s
    ax.plot(t_s, np.linalg.norm(result.f_hand_W_N, axis=1), color=OKABE_ITO["orange"], linewidth=1.2, label="hand")
    ax.plot(t_s, np.linalg.norm(result.f_motor_W_N, axis=1), color=OKABE_ITO["blue"], linewidth=1.2, label="motors")
    ax.set_ylabel("force [N]")


def _draw_hand_acceleration(ax: "Axes", result: "ClosedLoopResult") -> None:
    """Draw the requested acceleration and that of the handle."""
    recording = result.recording
    requested = ("requested", recording.a_m_s2, recording.a_t_s, "sky")
    measured = ("handle", result.a_handle_m_s2, recording.a_t_s - result.latency_s, "vermilion")
    _fill_accelerations(ax, recording, requested, measured)


def _draw_work(ax: "Axes", result: "ClosedLoopResult") -> None:
    """Draw the energy from the motors; its final value is negative if energy is dissipated, positive if generated."""
    work_mJ = np.cumsum(result.work_J) * 1e3
    ax.plot(result.recording.t_s, work_mJ, color=OKABE_ITO["blue"], linewidth=1.2, label="work of the motors")
    ax.axhline(0.0, color=INK, linewidth=0.8)
    ax.set_ylabel("energy [mJ]")
