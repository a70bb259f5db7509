"""Colours that the colour-blind can tell apart, the same in every plot and picture."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from hapscene.surface.swatch import Swatch

OKABE_ITO: Final = {
    "blue": "#0072B2",
    "orange": "#E69F00",
    "green": "#009E73",
    "vermilion": "#D55E00",
    "sky": "#56B4E9",
    "purple": "#CC79A7",
    "yellow": "#F0E442",
    "black": "#000000",
}
"""The palette of Okabe & Ito 2008, "Color Universal Design"."""

PATH: Final = OKABE_ITO["purple"]
"""Where the tool touches; seen on every swatch that is shipped."""

AIR: Final = "#8A93A0"
"""Where the tool is in the air."""

INK: Final = "#222222"
"""Text, and lines that carry no category."""

SHADE: Final = "#ECEFF3"
"""Behind a plot while the tool touches."""


def swatch_colours(count: int) -> list[str]:
    """A colour for each of `count` swatches: grey for the first, which is plain, then the palette in turn."""
    names = ("orange", "sky", "green", "vermilion", "yellow", "blue")
    return ["#BBBBBB", *(OKABE_ITO[names[i % len(names)]] for i in range(count - 1))][:count]


def albedo_colours(swatches: Sequence["Swatch"]) -> list[str]:
    """The swatches' own colours, as "#rrggbb"."""
    return ["#" + "".join(f"{round(channel * 255):02x}" for channel in swatch.albedo_rgb) for swatch in swatches]
