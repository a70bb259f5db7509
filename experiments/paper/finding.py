"""What a figure of the paper gives here: numbers, each with the paper's own where that is known, and drawings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.report.plots import Plot, drawn
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
