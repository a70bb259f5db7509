"""Charts, each on the light and on the dark ground of pages that show Markdown."""

import html
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.files import whole_file
from hapscene.view.palette import DARK, INK, rgb

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GREY_SPREAD: Final = 0.06
"""Colours whose red, green and blue differ by less are greys: page, ink, grid. What is more colourful tells
categories apart, and can be seen on both grounds."""

_PARTS: Final = ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor")
"""What of an artist may have a colour."""


def save_chart(figure: "Figure", path: str | Path, dpi: int, dark: bool = False) -> Path:
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
