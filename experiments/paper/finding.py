"""What a figure of the paper gives here: numbers, each with the paper's own where that is known, and drawings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.report_plots import Plot, decibels, drawn
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.spectrogram import spectrogram
from hapscene.view.palette import OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Say = Callable[[str], None]

PUBLISHED: Final = "published"
REMEMBERED: Final = "as remembered, to be checked"

COLOURS: Final = tuple(OKABE_ITO[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky"))


@dataclass(frozen=True)
class Number:
    """A number of a figure: ours; the paper's, None where it is not known here; how it is known; why the two differ."""

    what: str
    ours: float
    unit: str = "1"
    paper: float | None = None
    known: str = ""
    why: str = ""


@dataclass(frozen=True)
class Finding:
    """A figure, reproduced: its title, a text, its numbers and its drawings."""

    title: str
    text: str
    numbers: list[Number]
    plots: list[Plot]


def trace_panels(name: str, t_s: Array, signals: Mapping[str, Array], labels: Mapping[str, str] | str) -> str:
    """Signals (n,) over time, one below the other, as SVG; with one label for all they share one scale."""
    most = 1.05 * max(float(np.abs(signal).max()) for signal in signals.values())

    def draw(*panels: "Axes") -> None:
        for axes, colour, (title, signal) in zip(panels, COLOURS, signals.items(), strict=False):
            # long ones as a picture inside the drawing: a path of ten thousands of points is heavy
            axes.plot(t_s, signal, color=colour, linewidth=0.7, rasterized=len(t_s) > 2000)
            axes.set_title(title, fontsize=10)
            axes.set(ylabel=labels if isinstance(labels, str) else labels[title], xlim=(t_s[0], t_s[-1]))
            if isinstance(labels, str):
                axes.set_ylim(-most, most)
        panels[-1].set_xlabel("time [s]")

    return drawn(name, draw, 0.6 + 1.1 * len(signals), panels=(1,) * len(signals))


def spectrogram_panels(name: str, signals: Mapping[str, Array], rate_Hz: float, range_dB: float = 50.0) -> str:
    """Spectrograms of signals (n,), one below the other on one scale of levels, as SVG."""
    seen = {title: spectrogram(signal, rate_Hz) for title, signal in signals.items()}
    top = max(float(decibels(magnitude**2).max()) for _, _, magnitude in seen.values())
    look: dict[str, Any] = {"origin": "lower", "aspect": "auto", "cmap": "cividis", "vmin": top - range_dB, "vmax": top}

    def draw(*panels: "Axes") -> None:
        for axes, (title, (t_s, frequency_Hz, magnitude)) in zip(panels, seen.items(), strict=True):
            shown = frequency_Hz <= ACCELERATION_BAND_HZ[1]
            extent = (t_s[0], t_s[-1], 0.0, frequency_Hz[shown][-1])
            image = axes.imshow(decibels(magnitude[:, shown] ** 2).T, extent=extent, **look)
            axes.set_title(title, fontsize=10)
            axes.set(ylabel="frequency [Hz]", ylim=ACCELERATION_BAND_HZ)
            axes.grid(visible=False)
        panels[-1].set_xlabel("time [s]")
        bar = cast(Any, panels[0].figure).colorbar(image, ax=panels, label="level [dB re 1 m/s²]", aspect=40, pad=0.02)
        bar.outline.set_visible(False)
        bar.solids.set_rasterized(True)

    return drawn(name, draw, 0.6 + 1.4 * len(signals), panels=(1,) * len(signals))
