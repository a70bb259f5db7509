"""Charts in a common style for light and dark backgrounds, as PNG or as SVG in HTML pages."""

import html
import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np

from hapscene.errors import printable
from hapscene.io.files import whole_file
from hapscene.view.palette import CHART_STYLE, DARK, INK, rgb

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["dark_twin", "inline_svg", "new_chart", "picture", "save_both", "save_chart", "turn_dark"]

GREY_SPREAD: Final = 0.06
"""Maximum difference of the channels of a grey [1]. Greys are background, text and grid; more saturated colours mark
categories and are visible on both backgrounds."""

_PARTS: Final = ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor")
"""Colour properties of matplotlib artists."""


@contextmanager
def new_chart(
    width_in: float,
    height_in: float,
    title: str = "",
    style: Mapping[str, Any] | None = None,
    *,
    layout: Literal["constrained"] | None = "constrained",
) -> Iterator["Figure"]:
    """Context manager: create a figure of this size [in] in the common style, without a window.

    `style` has rc parameters of matplotlib that override `CHART_STYLE`; without a layout engine, positions are fixed.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(cast(Any, {**CHART_STYLE, **(style or {})})):  # the stub lists every key as a literal
        figure = Figure(figsize=(width_in, height_in), layout=layout)
        if title:
            figure.suptitle(printable(title), x=0.01, ha="left")
        yield figure


def save_chart(figure: "Figure", path: str | Path, dpi: int = 110, dark: bool = False) -> Path:
    """Write a figure as PNG. With `dark`, convert it to a dark background first; the conversion modifies the figure."""
    if dark:
        turn_dark(figure)
    with whole_file(path) as part:
        figure.savefig(part, format="png", dpi=dpi, metadata={"Software": "hapscene"})
    return Path(path)


def save_both(figure: "Figure", path: Path, dpi: int = 120) -> list[Path]:
    """Write a figure as `path`, and with a dark background as `dark_twin(path)`."""
    return [save_chart(figure, path, dpi), save_chart(figure, dark_twin(path), dpi, dark=True)]


def dark_twin(path: Path) -> Path:
    """Return the path of the dark version of a chart: speed-dark.png for speed.png."""
    return path.with_stem(f"{path.stem}-dark")


def picture(path: str, alt: str) -> str:
    """Return HTML for a chart from `save_both`, light or dark, with a description `alt`; `path` is relative to the
    page."""
    stem, dot, suffix = path.rpartition(".")
    return f"""<picture>
  <source media="(prefers-color-scheme: dark)" srcset="{stem}-dark{dot}{suffix}">
  <img src="{path}" alt="{html.escape(alt)}">
</picture>"""


def inline_svg(figure: "Figure", name: str) -> str:
    """Return a figure as an SVG element for an HTML page, for light and dark backgrounds. The result is deterministic.

    Greys use the CSS function `light-dark()`, so the page must declare `color-scheme: light dark`. Text remains text.
    The name, unique on the page, makes the ids in the SVG unique.
    """
    from matplotlib import rc_context

    text = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    drawing = text.getvalue()
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing[drawing.index("<svg") :], flags=re.DOTALL)
    drawing = re.sub(r' (?:width|height)="[\d.]+pt"', "", drawing, count=2)  # the page sets the size
    return re.sub(r"(?<=: )#[0-9a-f]{6}\b", _light_or_dark, drawing).strip()


def _light_or_dark(colour: re.Match[str]) -> str:
    from matplotlib.colors import to_hex

    dark = _turned(colour[0])
    return colour[0] if dark is None else f"light-dark({colour[0]}, {to_hex(dark)})"


def turn_dark(figure: "Figure") -> None:
    """Convert a figure for a dark background: invert the brightness of greys; other colours do not change."""
    figure.draw_without_rendering()  # creates all ticks
    turned = []
    for artist in _artists(figure):
        for part in _PARTS:
            colour = getattr(artist, f"get_{part}", lambda: None)()
            other = None if colour is None else _turned(colour)
            if other is not None:
                turned.append((getattr(artist, f"set_{part}"), other))
    for put, other in turned:  # set afterwards, since some artists inherit colours
        put(other)


def _artists(figure: "Figure") -> Iterator[Any]:
    """Yield all artists, including arrows and boxes of texts, which `findobj` omits."""
    for artist in figure.findobj():
        yield artist
        if hasattr(artist, "get_bbox_patch"):
            yield from filter(None, (getattr(artist, "arrow_patch", None), artist.get_bbox_patch()))


def _turned(colour: Any) -> Any:
    """Convert a colour, or colours (n, 4), for a dark background; None if unchanged."""
    from matplotlib.colors import to_rgba_array

    try:
        rgba = to_rgba_array(colour)
    except ValueError:  # "auto" or "inherit"
        return None
    grey = np.ptp(rgba[:, :3], axis=1) < GREY_SPREAD
    if not grey.any():
        return None
    page, ink = rgb(DARK.page), rgb(DARK.ink)
    depth = (1.0 - rgba[grey, :3].mean(axis=1)) / (1.0 - rgb(INK).mean())
    rgba[grey, :3] = page + np.minimum(depth, 1.0)[:, None] * (ink - page)
    return rgba if len(rgba) > 1 else rgba[0]
