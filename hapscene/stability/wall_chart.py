"""The chart of the stability region (Z-width) of a device, with swatches in it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.device.model import Limits
from hapscene.stability.z_width import STIFFNESS_N_M, Point, StableRegion
from hapscene.view.chart import new_chart, save_both
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["write_z_width_chart"]

WIDTH_MAX_IN: Final = 10.0
"""Largest width of the chart [in]: at a page width of 830 pixels its text is 11 pixels high."""

TOP_N_M: Final = 1.15e5
"""Top of the chart [N/m]. Walls that were stable at the largest tested stiffness are drawn up to it."""

LABEL: Final[dict[str, Any]] = {
    **{"va": "center", "fontsize": 9, "zorder": 4, "bbox": {"facecolor": "white", "linewidth": 0.0, "pad": 0.5}},
    "arrowprops": {"arrowstyle": "-", "color": INK, "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2},
}
"""Style of the label of a swatch."""

LABEL_RATIO: Final = 1.42
"""Least ratio of the heights of two labels on the logarithmic axis [1]; closer ones would overlap."""

LABELS_MAX: Final = 4
"""Most swatches at one position that have separate labels [count]."""


def draw_panels(
    path: Path, rows: int, columns: int, size: tuple[float, float], draw: Callable[[Any, Any], None]
) -> None:
    """Write a PNG of rows × columns panels of a size [in], narrower if they would exceed `WIDTH_MAX_IN`.

    `draw` receives the figure and its axes (rows, columns).
    """
    with new_chart(min(size[0] * columns, WIDTH_MAX_IN), size[1] * rows) as figure:
        draw(figure, figure.subplots(rows, columns, squeeze=False))
        save_both(figure, path, dpi=160)


def write_z_width_chart(
    path: Path,
    regions: Sequence[StableRegion],
    points: dict[tuple[float, int], list[Point]],
    caps: dict[tuple[float, int], Limits],
) -> None:
    """Draw the stable regions: one panel for each rate (across) and delay (down); `points` and `caps` are by rate
    and delay."""
    rates = sorted({region.rate_Hz for region in regions})
    delays = sorted({region.delay_ticks for region in regions})

    def draw(figure: Any, axes: Any) -> None:
        for row, delay in enumerate(delays):
            for column, rate_Hz in enumerate(rates):
                ax, key = axes[row, column], (rate_Hz, delay)
                here = [region for region in regions if (region.rate_Hz, region.delay_ticks) == key]
                _draw_regions(ax, here)
                _draw_caps(ax, caps[key])
                _draw_points(ax, points[key])
                delay_text = "no delay" if delay == 0 else f"delay {delay} tick{'s' if delay > 1 else ''}"
                ax.set_title(f"{rate_Hz / 1e3:g} kHz, {delay_text}")
                ax.set_xlabel("wall damping [N·s/m]" if row == len(delays) - 1 else "")
                ax.set_ylabel("wall stiffness [N/m]" if column == 0 else "")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(rates)))

    draw_panels(path, len(delays), len(rates), (5.2, 4.4), draw)


def _draw_regions(ax: "Axes", regions: Sequence[StableRegion]) -> None:
    """Draw the region of the first device filled, of the others as lines, and the closed form."""
    bottom = STIFFNESS_N_M[0]
    for n, region in enumerate(regions):
        B = np.array(region.damping_Ns_m)
        K = np.clip(np.array(region.limit_N_m), bottom, TOP_N_M)
        colour, line = OKABE_ITO[("blue", "orange", "green")[n % 3]], ("o-", "s-", "D-")[n % 3]
        if n == 0:
            ax.fill_between(B, bottom, K, color=colour, alpha=0.16, linewidth=0, label=f"{region.device}: stable")
        ax.plot(B, K, line, color=colour, markersize=3.5, label=f"{region.device}: simulated limit")
    theory = np.array(regions[0].closed_N_m)
    kept = theory > 0.0
    x, y = np.array(regions[0].damping_Ns_m)[kept], np.clip(theory[kept], bottom, TOP_N_M)
    ax.plot(x, y, "--", color=INK, linewidth=1.2, label="closed form, without friction")
    ax.set_xscale("symlog", linthresh=0.5, linscale=0.6)
    ax.set(yscale="log", xlim=(-0.75, max(regions[0].damping_Ns_m)), ylim=(bottom, TOP_N_M))
    ticks = (0, 0.5, 2, 8, 32, 128)
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.xaxis.minorticks_off()
    heights = (50, 200, 1000, 5000, 20_000, 100_000)
    ax.set_yticks(heights, [f"{height:,}" for height in heights])
    ax.yaxis.minorticks_off()


def _draw_caps(ax: "Axes", caps: Limits) -> None:
    """Draw the range to which the device's own limits restrict each wall."""
    if np.isfinite(caps.stiffness_N_m) and np.isfinite(caps.damping_Ns_m):
        K, B = caps.stiffness_N_m, caps.damping_Ns_m
        label = "limits of the device"
        ax.plot((0.0, B, B), (K, K, STIFFNESS_N_M[0]), ":", color=OKABE_ITO["purple"], linewidth=2.2, label=label)


def _label(point: Point, points: Sequence[Point]) -> str:
    """The label of a swatch; several at one position share one label with their number."""
    here = [other.swatch for other in points if _place(other) == _place(point)]
    if len(here) <= LABELS_MAX:
        return point.swatch if point.stable else f"{point.swatch}: unstable"
    label = f"{len(here)} swatches" + ": unstable" * (not point.stable)
    return label if point.swatch == here[0] else ""


def _place(point: Point) -> tuple[str, str, bool]:
    return f"{point.stiffness_N_m:.2g}", f"{point.damping_Ns_m:.2g}", point.stable


def _draw_points(ax: "Axes", points: Sequence[Point]) -> None:
    """Draw the swatches with their labels."""
    height = 0.0
    for point in sorted(points, key=lambda p: p.stiffness_N_m):
        K, B = point.stiffness_N_m, point.damping_Ns_m
        marker, colour = ("o", OKABE_ITO["green"]) if point.stable else ("X", OKABE_ITO["vermilion"])
        ax.plot(B, K, marker, color=colour, markersize=7, markeredgecolor="white", zorder=5, clip_on=False)
        name = _label(point, points)
        if not name:
            continue
        height = max(K, LABEL_RATIO * height)
        x, align = (1.35 * B, "left") if B > 0.1 else (B - 0.12, "right")
        ax.annotate(name, (B, K), (x, height), ha=align, **LABEL)
    for label, marker, colour in (("stable swatch", "o", "green"), ("unstable swatch", "X", "vermilion")):
        ax.plot([], [], marker, color=OKABE_ITO[colour], markersize=7, linestyle="", label=label)
