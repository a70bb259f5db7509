"""Colours for plots and pictures, distinguishable with colour vision deficiency."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from hapscene.surface.swatch import Swatch

__all__ = [
    "AIR",
    "CHART_STYLE",
    "DARK",
    "DISTANCE_MIN",
    "EDGE",
    "FORCE",
    "INK",
    "LIGHT",
    "OKABE_ITO",
    "PATH",
    "SHADE",
    "Theme",
    "albedo_colours",
    "distinct_colours",
    "linear",
    "rgb",
]

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
"""Colour of the path in contact; visible on every shipped swatch."""

AIR: Final = "#8A93A0"
"""Colour of the path in the air."""

INK: Final = "#222222"
"""Colour of text and of lines without a category."""

EDGE: Final = "#808080"
"""Colour of outlines of swatch colours; visible on light and dark backgrounds."""

CHART_STYLE: Final[dict[str, object]] = {
    **dict.fromkeys(("axes.edgecolor", "axes.labelcolor", "text.color", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("axes.axisbelow", "axes.grid"), True),
    **dict.fromkeys(("axes.spines.right", "axes.spines.top", "legend.frameon"), False),
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "figure.titlesize": 13,
    "font.size": 10,
    "grid.color": "#E2E2E2",
    "grid.linewidth": 0.6,
}
"""Common style of charts, as matplotlib rc parameters."""

SHADE: Final = "#ECEFF3"
"""Background of plots during contact."""

FORCE: Final = OKABE_ITO["green"]
"""Colour of force arrows; no shipped swatch has it."""

DISTANCE_MIN: Final = 0.1
"""Minimum distance of two swatch colours in Oklab [1]; closer colours look equal under shading."""

_SPARE: Final = (
    *(OKABE_ITO[name] for name in ("orange", "sky", "vermilion", "yellow", "blue")),
    *("#6B4200", "#A8E6CF", "#332288", "#F7B9A8", "#5C6B00"),  # not used for paths and arrows
)


@dataclass(frozen=True)
class Theme:
    """Colours of a picture apart from the scene, "#rrggbb"."""

    background: str
    page: str
    """Background of legends and dark charts, equal to the background of pages that render Markdown."""
    ink: str
    tool: str


LIGHT: Final = Theme(background="#F2F5F9", page="#FFFFFF", ink=INK, tool="#3F4650")
DARK: Final = Theme(background="#1D2127", page="#0D1117", ink="#E6E9ED", tool="#D5DAE1")


def albedo_colours(swatches: Sequence["Swatch"]) -> list[str]:
    """Return the albedo of swatches as "#rrggbb"."""
    return ["#" + "".join(f"{round(channel * 255):02x}" for channel in swatch.albedo_rgb) for swatch in swatches]


def distinct_colours(swatches: Sequence["Swatch"], used: Sequence[int]) -> list[str]:
    """Return the albedo of swatches as "#rrggbb", with replacements for colours that resemble an earlier one in `used`.

    Fitted swatches have the default colour until one is assigned.
    """
    colours = albedo_colours(swatches)
    taken: list[str] = []
    for index in used:
        for colour in (colours[index], *_SPARE):
            if all(_distance(colour, other) >= DISTANCE_MIN for other in taken):
                colours[index] = colour
                break
        taken.append(colours[index])
    return colours


def rgb(colour: str) -> NDArray[np.float64]:
    """Convert "#rrggbb" to three numbers from 0 to 1."""
    return np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def _distance(a: str, b: str) -> float:
    """Return the distance in Oklab (Ottosson 2020, "A perceptual color space for image processing")."""
    return float(np.linalg.norm(_oklab(rgb(a)) - _oklab(rgb(b))))


def linear(srgb: ArrayLike) -> NDArray[np.float64]:
    """Convert sRGB from 0 to 1 to linear values (IEC 61966-2-1)."""
    c = np.asarray(srgb, np.float64)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def _oklab(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    cone = np.cbrt(_TO_CONE @ linear(srgb))
    return np.asarray(_FROM_CONE @ cone)


_TO_CONE: Final = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_FROM_CONE: Final = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
