"""How the plots of a report are made: Matplotlib's SVG, its colours turned into the page's own, light or dark."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, cast

from hapscene.view.palette import OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS: Final = {
    "ink": ("#1b1f24", "#e6e9ed"),
    "muted": ("#5c6570", "#a3acb7"),
    "grid": ("#dfe3e8", "#313942"),
    "shade": ("#cfe3f1", "#203a4c"),
    "blue": (OKABE_ITO["blue"].lower(), "#5ab4e8"),
    "orange": (OKABE_ITO["vermilion"].lower(), "#f29a4a"),
    "green": (OKABE_ITO["green"].lower(), "#3fcfa4"),
    "purple": ("#a8457f", "#d98bb5"),
}
"""Colours of the plots by name, on light and on dark ground: Okabe & Ito's, shifted where their contrast on the
ground would be less than 3 to 1. Lines that must be told apart differ in dash or width as well."""

INK, MUTED, GRID, SHADE = (COLOURS[name][0] for name in ("ink", "muted", "grid", "shade"))
BLUE, ORANGE, GREEN, PURPLE = (COLOURS[name][0] for name in ("blue", "orange", "green", "purple"))

WIDTH_IN: Final = 4.4
"""Width of a plot [in]. At 9 points its text is 10 px high on a phone of 360 px."""

_STYLE: Final[dict[str, Any]] = {
    "svg.fonttype": "none",  # text stays text: small, and searched, read aloud and copied
    "font.family": "DejaVu Sans",  # its metrics are laid out with; the page names look-alikes
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.4,
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
}


@dataclass(frozen=True)
class Key:
    """An entry of a plot's legend: what the lines or points of a look are."""

    text: str
    colour: str
    look: str = "solid"  # solid, dashed, dotted, dot, ring, area


@dataclass(frozen=True)
class Plot:
    """A plot of the page: a drawing, or the reason why there is none."""

    title: str
    caption: str
    svg: str = ""
    alternative: str = ""
    legend: tuple[Key, ...] = ()
    wide: bool = False


def drawn(draw: Callable[["Figure"], None], height_in: float = 2.7, width_in: float = WIDTH_IN) -> str:
    """The SVG element that `draw` fills, its colours those of the page; the same for the same content."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with rc_context(cast(Any, _STYLE | {"svg.hashsalt": f"{draw.__qualname__}{height_in}"})):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' (?:width|height)="[\d.]+pt"', "", svg, count=2)  # the page sets them
    for name, (light, _) in COLOURS.items():
        svg = svg.replace(light, f"var(--{name})")
    return svg.strip()
