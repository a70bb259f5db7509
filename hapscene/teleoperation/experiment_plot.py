"""experiment.png: what the follower's accelerometer read, and what the leader's hand felt, with and without handle."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.handle.spectrogram import spectrogram
from hapscene.output import whole_file
from hapscene.view.palette import INK, OKABE_ITO
from hapscene.view.plot import FREQUENCY_MAX_HZ, RANGE_DB

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hapscene.teleoperation.experiment import Rendering

TITLES: Final = {"none": "base motors alone", "inverse": "base motors and handle,\nplain inverse"}

PARTS: Final = {"all": "all", "tap": "taps", "stroke": "strokes"}

STYLE: Final[dict[str, Any]] = {
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 10,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


def write_experiment_plot(renderings: "Sequence[Rendering]", path: Path, title: str) -> None:
    """Draw, column by column, desired and rendered accelerations over time, and their spectrograms."""
    from matplotlib import rc_context

    with rc_context(cast(Any, STYLE)):
        figure = _draw(renderings, title)
        with whole_file(path) as part:
            figure.savefig(part, format="png", dpi=110, metadata={"Software": "hapscene"})


def _draw(renderings: "Sequence[Rendering]", title: str) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = [("desired:\nthe follower's accelerometer", renderings[0].desired_m_s2, INK)]
    for rendering, colour in zip(renderings, ("blue", "green", "vermilion"), strict=False):
        name = TITLES.get(rendering.compensator, f"base motors and handle,\n{rendering.compensator}")
        error = ", ".join(f"{PARTS[part]} {100 * value:.0f} %" for part, value in rendering.errors.items())
        columns.append((f"{name}\nerror: {error}", rendering.rendered_m_s2, OKABE_ITO[colour]))
    count = len(columns)
    figure = Figure(figsize=(4.2 * count + 0.8, 7.0), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"Teleoperation: {title}", x=0.01, ha="left", fontsize=13)
    grid = figure.add_gridspec(2, count + 1, width_ratios=(*[1.0] * count, 0.03))
    most_m_s2 = 1.05 * max(float(np.abs(signal).max()) for _, signal, _ in columns)
    levels = [_levels(signal) for _, signal, _ in columns]
    top_dB = float(np.ceil(max(level.max() for _, _, level in levels)))
    image: Any = None
    for k, ((name, signal, colour), (t_s, frequency_Hz, level)) in enumerate(zip(columns, levels, strict=True)):
        over, under = figure.add_subplot(grid[0, k]), figure.add_subplot(grid[1, k])
        over.plot(np.arange(len(signal)) / ACCELERATION_RATE_HZ, signal, color=colour, linewidth=0.4)
        over.set_title(name, fontsize=10, loc="left")
        over.set_ylim(-most_m_s2, most_m_s2)
        over.grid(axis="y", color="#D8D8D8", linewidth=0.6)
        over.tick_params(labelbottom=False, labelleft=k == 0)
        extent = (float(t_s[0]), float(t_s[-1]), 0.0, float(frequency_Hz[-1]))
        look: dict[str, Any] = {
            "cmap": "magma",
            "vmin": top_dB - RANGE_DB,
            "vmax": top_dB,
            "aspect": "auto",
            "origin": "lower",
        }
        image = under.imshow(level.T, extent=extent, interpolation="nearest", **look)
        under.set_ylim(0.0, FREQUENCY_MAX_HZ)
        under.set_xlabel("time [s]")
        under.tick_params(labelleft=k == 0)
        for axes in (over, under):
            axes.set_xlim(0.0, t_s[-1])
        if k == 0:
            over.set_ylabel("acceleration along the handle [m/s²]")
            under.set_ylabel("frequency [Hz]")
    figure.colorbar(image, cax=figure.add_subplot(grid[1, count]), label="dB re 1 m/s²")
    return figure


def _levels(signal: Any) -> tuple[Any, Any, Any]:
    """Times, frequencies up to the highest drawn, and magnitudes in dB (n, k)."""
    t_s, frequency_Hz, magnitude = spectrogram(signal, ACCELERATION_RATE_HZ)
    seen = frequency_Hz <= FREQUENCY_MAX_HZ
    return t_s, frequency_Hz[seen], 20.0 * np.log10(np.maximum(magnitude[:, seen], 1e-15))
