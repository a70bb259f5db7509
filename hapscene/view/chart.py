"""Charts in one style, each on light and on dark ground: as PNG, or as a drawing inside an HTML page."""

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
"""Colours whose red, green and blue differ by less are greys: page, ink, grid. What is more colourful tells
categories apart, and can be seen on both grounds."""

_PARTS: Final = ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor")
"""What of an artist may have a colour."""


@contextmanager
def new_chart(
    width_in: float,
    height_in: float,
    title: str = "",
    style: Mapping[str, Any] | None = None,
    *,
    layout: Literal["constrained"] | None = "constrained",
) -> Iterator["Figure"]:
    """A figure to be drawn on in the style of all charts, without a window.

    Args:
        width_in, height_in: its size [in].
        title: stands over it.
        style: what differs from `CHART_STYLE`, as matplotlib's rc parameters.
        layout: matplotlib's, which fits axes to their labels; None leaves them where they are put.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(cast(Any, {**CHART_STYLE, **(style or {})})):  # its type lists every key by name
        figure = Figure(figsize=(width_in, height_in), layout=layout)
        if title:
            figure.suptitle(printable(title), x=0.01, ha="left")
        yield figure


def save_chart(figure: "Figure", path: str | Path, dpi: int = 110, dark: bool = False) -> Path:
    """Write a figure that was drawn for light ground as PNG; with `dark` it is turned dark, and stays it.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    if dark:
        turn_dark(figure)
    with whole_file(path) as part:
        figure.savefig(part, format="png", dpi=dpi, metadata={"Software": "hapscene"})
    return Path(path)


def save_both(figure: "Figure", path: Path, dpi: int = 120) -> list[Path]:
    """Write a figure as `path` and, on dark ground, as `dark_twin(path)`."""
    return [save_chart(figure, path, dpi), save_chart(figure, dark_twin(path), dpi, dark=True)]


def dark_twin(path: Path) -> Path:
    """Where the same chart is on dark ground: speed.png has speed-dark.png beside it."""
    return path.with_stem(f"{path.stem}-dark")


def picture(path: str, told: str) -> str:
    """HTML, for a Markdown page, of a chart that `save_both` wrote: light or dark as the reader has it.

    Args:
        path: of the light one, as seen from the page.
        told: what is to be seen, for those who cannot.
    """
    stem, dot, suffix = path.rpartition(".")
    return f"""<picture>
  <source media="(prefers-color-scheme: dark)" srcset="{stem}-dark{dot}{suffix}">
  <img src="{path}" alt="{html.escape(told)}">
</picture>"""


def inline_svg(figure: "Figure", name: str) -> str:
    """A figure that was drawn for light ground as an SVG element of an HTML page: light or dark as the reader has it.

    Its greys are CSS's `light-dark()`, so the page must say `color-scheme: light dark`. Text stays text: small, and
    searched, read aloud and copied. The same content makes the same drawing.

    Args:
        figure: what is drawn.
        name: one of its own on the page, so that no drawing refers to another's parts.
    """
    from matplotlib import rc_context

    text = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    drawing = text.getvalue()
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing[drawing.index("<svg") :], flags=re.DOTALL)
    drawing = re.sub(r' (?:width|height)="[\d.]+pt"', "", drawing, count=2)  # the page sets them
    return re.sub(r"(?<=: )#[0-9a-f]{6}\b", _light_or_dark, drawing).strip()


def _light_or_dark(colour: re.Match[str]) -> str:
    from matplotlib.colors import to_hex

    dark = _turned(colour[0])
    return colour[0] if dark is None else f"light-dark({colour[0]}, {to_hex(dark)})"


def turn_dark(figure: "Figure") -> None:
    """Have a figure's greys on the dark page as they were on white: the darkest are the lightest. Colours stay."""
    figure.draw_without_rendering()  # all ticks are there from now on
    turned = []
    for artist in _artists(figure):
        for part in _PARTS:
            colour = getattr(artist, f"get_{part}", lambda: None)()
            other = None if colour is None else _turned(colour)
            if other is not None:
                turned.append((getattr(artist, f"set_{part}"), other))
    for put, other in turned:  # all at last: some parts take their colour from others
        put(other)


def _artists(figure: "Figure") -> Iterator[Any]:
    """All that is drawn, also what matplotlib does not count as parts of a text: its arrow and its box."""
    for artist in figure.findobj():
        yield artist
        if hasattr(artist, "get_bbox_patch"):
            yield from filter(None, (getattr(artist, "arrow_patch", None), artist.get_bbox_patch()))


def _turned(colour: Any) -> Any:
    """The colour, or colours (n, 4), for dark ground; None where they stay."""
    from matplotlib.colors import to_rgba_array

    try:
        rgba = to_rgba_array(colour)
    except ValueError:  # "auto", or one that stands for another
        return None
    grey = np.ptp(rgba[:, :3], axis=1) < GREY_SPREAD
    if not grey.any():
        return None
    page, ink = rgb(DARK.page), rgb(DARK.ink)
    depth = (1.0 - rgba[grey, :3].mean(axis=1)) / (1.0 - rgb(INK).mean())
    rgba[grey, :3] = page + np.minimum(depth, 1.0)[:, None] * (ink - page)
    return rgba if len(rgba) > 1 else rgba[0]
