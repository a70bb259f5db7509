"""Plots the interaction states of a recording above its streams."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.capture.fit.segment import InteractionState, Segmentation, SegmentedRecording
from hapscene.capture.io.streams import Array, Streams
from hapscene.view.chart import new_chart, save_chart
from hapscene.view.palette import INK, OKABE_ITO
from hapscene.view.plot import STYLE, envelope

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

__all__ = ["WORDS", "draw_states", "write_states"]


COLOURS: Final = {
    InteractionState.AIR: "#D5DAE1",
    InteractionState.STILL: OKABE_ITO["sky"],
    InteractionState.SLIDING: OKABE_ITO["green"],
    InteractionState.TAP: OKABE_ITO["vermilion"],
}
WORDS: Final = {
    InteractionState.AIR: "no contact",
    InteractionState.STILL: "at rest",
    InteractionState.SLIDING: "sliding",
    InteractionState.TAP: "tap",
}


def write_states(recordings: Sequence[SegmentedRecording], path: str | Path, titles: Sequence[str] = ()) -> None:
    """Writes a PNG file with the interaction states of recordings, one below the other.

    Args:
        recordings: filtered recordings and their segmentations.
        path: file to write.
        titles: titles of the recordings.

    Raises:
        OSError: the folder does not exist or is not writable.
    """
    save_chart(draw_states(recordings, titles), path)


def draw_states(recordings: Sequence[SegmentedRecording], titles: Sequence[str] = ()) -> "Figure":
    """Figure that `write_states` writes."""
    rows = [_streams(*recording) for recording in recordings]
    heights = [0.7 + 1.5 * len(streams) for streams in rows]
    with new_chart(13, sum(heights) + 0.7 * len(recordings), style=STYLE) as figure:
        panels = np.atleast_1d(np.array(figure.subfigures(len(recordings), 1, height_ratios=heights), dtype=object))
        for i, ((_, states), streams, panel) in enumerate(zip(recordings, rows, panels, strict=True)):
            _draw(panel, states, streams, titles[i] if i < len(titles) else "")
    return figure


_Stream = tuple[str, Array, float | None]  # label, values, threshold


def _streams(channels: Streams, states: Segmentation) -> list[_Stream]:
    """Streams of the plot: the acceleration, and all streams that are not constant."""
    streams: list[_Stream] = [("acceleration\n[m/s²]", channels.acceleration_m_s2, None)]
    if np.ptp(channels.force_N) > 0.0:
        streams.append(("normal force\n[N]", channels.force_N, states.force_on_N))
    if np.ptp(channels.speed_m_s) > 0.0:
        on = states.speed_on_m_s
        streams.append(("speed\n[mm/s]", 1e3 * channels.speed_m_s, None if on is None else 1e3 * on))
    if channels.depth_m is not None:
        streams.append(("depth\n[mm]", 1e3 * channels.depth_m, None))
    return streams


def _draw(panel: "SubFigure", states: Segmentation, streams: list[_Stream], title: str) -> None:
    """Draws a recording: a strip of states above the streams."""
    axes = panel.subplots(1 + len(streams), 1, sharex=True, height_ratios=[0.35] + [1.0] * len(streams))
    strip, seconds = axes[0], len(states.states) / states.rate_Hz
    for state, colour in COLOURS.items():
        if not states.seconds(state):
            continue
        spans = [(start / states.rate_Hz, (end - start) / states.rate_Hz) for start, end in states.runs(state)]
        label = f"{WORDS[state]} ({states.seconds(state):.1f} s)"
        strip.broken_barh(spans, (0, 1), facecolor=colour, linewidth=0, label=label)
        for ax in axes[1:]:
            for start, length in spans:
                ax.axvspan(start, start + length, facecolor=colour, alpha=0.25, linewidth=0)
    segments = states.stationary()
    for change in states.changes:
        strip.axvline(change / states.rate_Hz, color=INK, linewidth=1.2)
    if states.changes:
        strip.plot([], [], color=INK, linewidth=1.2, label=f"change point ({len(segments)} segments)")
    strip.set(ylim=(0, 1), yticks=[], xlim=(0, seconds))
    strip.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, borderaxespad=0.2)
    for ax, (label, values, threshold) in zip(axes[1:], streams, strict=True):
        t_s, low, high = envelope(np.arange(len(values)) / states.rate_Hz, values)  # shows every peak
        ax.fill_between(t_s, low, high, facecolor=INK, edgecolor=INK, linewidth=0.6)
        if threshold is not None:
            ax.axhline(threshold, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
            ax.annotate(
                "on", (1.0, threshold), xycoords=("axes fraction", "data"), xytext=(4, 0),
                textcoords="offset points", va="center", fontsize=9, color=INK,
            )  # fmt: skip
        ax.set_ylabel(label)
    axes[-1].set_xlabel("time [s]")
    panel.align_ylabels(axes[1:])
    panel.suptitle(title, x=0.01, ha="left", fontsize=12, color=INK)
