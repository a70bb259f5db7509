"""Pictures of the chart: one of all rows, and one of all settings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hapscene.view.chart import new_chart, save_both
from hapscene.view.palette import INK, OKABE_ITO, SHADE

from .question import Point, Question
from .rows import CHOSEN, Row, all_choices

COLOURS: Final = [OKABE_ITO[name] for name in ("blue", "vermilion", "green", "orange", "purple", "sky")]
MARKERS: Final = "osD^vPX*"
"""Markers of the methods, so that they can be distinguished without colour."""

LEAST_JND: Final = 0.01
"""Smallest error that is drawn [JND]: smaller ones are rounding, which would extend the axis."""


def draw_rows(rows: Sequence[Row], path: Path) -> list[Path]:
    """Draw time and error of the default and of the chosen setting of each lever."""
    at = range(len(rows))
    with new_chart(11.0, 0.42 * len(rows) + 1.5, f"Default and {CHOSEN}") as figure:
        time, error = figure.subplots(1, 2, sharey=True, width_ratios=(1.4, 1.0))
        for ax, default, chosen in (
            (time, [r.default.median_us for r in rows], [r.chosen.median_us for r in rows]),
            (error, *([max(c.error, LEAST_JND) for c in each] for each in _pairs(rows))),
        ):
            ax.hlines(at, default, chosen, colors=INK, linewidth=1, alpha=0.6)
            ax.plot(default, at, "o", color=COLOURS[0], markersize=8, label="default")
            ax.plot(chosen, at, "D", color=COLOURS[1], markersize=5, label=CHOSEN)
            ax.set_xscale("log")
            ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        for i, row in enumerate(rows):
            us = row.default.median_us
            low, high = max(us - row.noise_us, 0.5 * us), us + row.noise_us
            time.fill_betweenx([i - 0.3, i + 0.3], low, high, color=SHADE, zorder=0, label="" if i else "noise")
            if row.chosen != row.default:
                time.annotate(row.chosen.name, (row.chosen.median_us, i), (0, 6), textcoords="offset points",
                              ha="center", fontsize=7.5)  # fmt: skip
        time.set_yticks(at, [row.lever for row in rows])
        time.invert_yaxis()
        time.set_xlabel("time per ms of touch [µs]")
        error.axvspan(LEAST_JND / 2, 1.0, color=SHADE, zorder=0)
        error.axvline(1.0, color=INK, linewidth=1, linestyle="--")
        error.set_xlabel("error [JND or other limit]; shaded: not perceptible")
        figure.legend(*time.get_legend_handles_labels(), loc="outside upper right", ncols=3)
        return save_both(figure, path)


def _pairs(rows: Sequence[Row]) -> Any:
    return zip(*((row.default, row.chosen) for row in rows), strict=True)


def draw_settings(questions: Sequence[Question], points: Mapping[str, Sequence[Point]], path: Path) -> list[Path]:
    """Draw the error of every setting of every lever against its time."""
    panels = [(lever, choices) for q in questions for lever, choices in all_choices(q, points[q.name]).items()]
    count = -(-len(panels) // 3)
    with new_chart(13.0, 3.2 * count + 0.5, "All settings: error against time") as figure:
        axes = figure.subplots(count, 3, squeeze=False).ravel()
        for ax in axes[len(panels) :]:
            ax.set_axis_off()
        for ax, (lever, choices) in zip(axes, panels, strict=False):
            for k, method in enumerate(dict.fromkeys(c.method for c in choices)):
                own = [c for c in choices if c.method == method]
                x, y = [c.median_us for c in own], [max(c.error, LEAST_JND) for c in own]
                look: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}
                ax.plot(x, y, **look, linewidth=0.8, markersize=5, label=method or "plain")
                for c, where in zip(own, zip(x, y, strict=True), strict=True):
                    ax.annotate(c.label, where, (4, 3), textcoords="offset points", fontsize=6.5)
            times = [c.median_us for c in choices]
            wide = max(times) > 30.0 * min(times)
            ax.set(title=lever, xscale="log" if wide else "linear", yscale="log", ylim=(LEAST_JND / 2, None))
            ax.set(xlabel="time per ms of touch [µs]", ylabel="error [JND]")
            ax.axhspan(LEAST_JND / 2, 1.0, color=SHADE, zorder=0)
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_formatter(lambda value, _: f"{value:g}")
            if any(c.method for c in choices):
                ax.legend(fontsize=6.5)
        return save_both(figure, path)
