"""The result of reproducing a figure: numbers beside those that the paper states, and drawings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.report.plots import drawn as report_plot
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.spectrogram import SPECTROGRAM_S, decibels, spectrogram
from hapscene.view.palette import OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Progress = Callable[[str], None]

COLOURS: Final = tuple(OKABE_ITO[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky"))

WIDTH_IN: Final = 6.4
"""Width of a drawing [in]."""

RANGE_DB: Final = 50.0
"""Range of the spectrograms below their maximum [dB]."""


SETTING: Final = "a setting, not a result"
"""Note of a number that is chosen as in the paper."""


@dataclass(frozen=True)
class Number:
    """A number of a figure.

    Attributes:
        quantity: what it is.
        value: the value found here.
        unit: its unit; "1" for a dimensionless number.
        paper: the value that the paper states; None if it states none.
        place: where the paper states it, such as "Fig. 4, caption".
        note: what the simulation knows and an experiment does not, or why the two values differ.
    """

    quantity: str
    value: float
    unit: str = "1"
    paper: float | None = None
    place: str = ""
    note: str = ""


@dataclass(frozen=True)
class Plot:
    """A drawing with its title and caption."""

    title: str
    caption: str
    svg: str


@dataclass(frozen=True)
class FigureResult:
    """A reproduced figure: its title, a description, its numbers and its drawings."""

    title: str
    text: str
    numbers: list[Number]
    plots: list[Plot]


def drawn(name: str, draw: Callable[..., None], height_in: float, panels: tuple[float, ...] = (1,)) -> str:
    """Draw a plot in the width of the page, as the report of a fit does; return the SVG element."""
    return report_plot(name, draw, height_in, 3, panels, WIDTH_IN)


def trace_panels(name: str, t_s: Array, signals: Mapping[str, Array], labels: Mapping[str, str] | str) -> str:
    """Return signals (n,) over time as SVG, one panel each; if all share one label, they share one scale."""
    most = 1.05 * max(float(np.abs(signal).max()) for signal in signals.values())

    def draw(*panels: "Axes") -> None:
        for axes, colour, (title, signal) in zip(panels, COLOURS, signals.items(), strict=False):
            # Long signals are rasterised: an SVG path of tens of thousands of points is slow to display.
            axes.plot(t_s, signal, color=colour, linewidth=0.7, rasterized=len(t_s) > 2000)
            axes.set_title(title, fontsize=10)
            axes.set(ylabel=labels if isinstance(labels, str) else labels[title], xlim=(t_s[0], t_s[-1]))
            if isinstance(labels, str):
                axes.set_ylim(-most, most)
        panels[-1].set_xlabel("time [s]")

    return drawn(name, draw, 0.6 + 1.1 * len(signals), (1,) * len(signals))


def spectrogram_panels(name: str, signals: Mapping[str, Array], rate_Hz: float) -> str:
    """Return the spectrograms of signals (n,) as SVG, one panel each, with a common colour scale."""
    spectrograms = {title: spectrogram(signal, rate_Hz) for title, signal in signals.items()}
    top = max(decibels(magnitude).max() for _, _, magnitude in spectrograms.values())
    step = 0.5 * SPECTROGRAM_S

    def draw(*panels: "Axes") -> None:
        for axes, (title, (time, frequency, magnitude)) in zip(panels, spectrograms.items(), strict=True):
            inside = frequency <= ACCELERATION_BAND_HZ[1]
            image = axes.imshow(
                decibels(magnitude[:, inside]).T,
                origin="lower", aspect="auto", cmap="cividis", vmin=top - RANGE_DB, vmax=top, interpolation="nearest",
                extent=(time[0] - 0.5 * step, time[-1] + 0.5 * step, -0.5 * frequency[1], frequency[inside][-1]),
            )  # fmt: skip
            axes.set(title=title, ylabel="frequency [Hz]", ylim=ACCELERATION_BAND_HZ)
            axes.grid(visible=False)
        panels[-1].set_xlabel("time [s]")
        bar = panels[0].figure.colorbar(image, ax=panels, label="level [dB re 1 m/s²]", aspect=40, pad=0.02)
        cast(Any, bar.solids).set_rasterized(True)  # otherwise each of its 256 colours is a path

    return drawn(name, draw, 1.8 + 1.4 * len(signals), (1,) * len(signals))
