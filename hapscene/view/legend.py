"""Legend of a picture: meaning of the colours, a scale bar, and a force arrow of round length."""

from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from hapscene.scene.mesh_report import length as length_text
from hapscene.view.body_triangles import used_swatches
from hapscene.view.figure_parts import PROXY_COLOUR
from hapscene.view.palette import AIR, EDGE, FORCE, PATH, Theme, distinct_colours

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["Legend", "LegendEntry", "entries_of", "measures_of"]

NAME_MAX: Final = 28
"""Maximum length of a name [characters]."""

MEASURE_MAX: Final = 0.2
"""Maximum length of the scale bar and the arrow, relative to the width of the picture [1]."""


class LegendEntry(NamedTuple):
    """A symbol and its text. `kind` is patch, line, thread, ball, bar or arrow; bars and arrows have a length."""

    text: str
    colour: str
    kind: str = "patch"
    length_px: int = 0


def entries_of(scene: "Scene", theme: Theme, path: bool = False, tool: bool = False) -> list[LegendEntry]:
    """Return the entries of a legend: used swatches, path, tool."""
    used = used_swatches(scene)
    colours = distinct_colours(scene.swatches, used)
    names = [swatch.name for swatch in scene.swatches]
    if any(body.mesh.colour_rgb is not None for body in scene.bodies):
        names[0] += " (look of the file)"
    names = [name if len(name) <= NAME_MAX else name[: NAME_MAX - 1] + "…" for name in names]
    entries = [LegendEntry(names[i], colours[i]) for i in used]
    if tool:
        entries += [LegendEntry("tool", theme.tool, "line"), LegendEntry("proxy", PROXY_COLOUR, "ball")]
    if path:
        entries += [LegendEntry("path on the surface", PATH, "line"), LegendEntry("in the air", AIR, "thread")]
    return entries


def measures_of(pixel_m: float, width: int, theme: Theme, arrow_m_N: float, f_max_N: float) -> list[LegendEntry]:
    """Return a scale bar and, if there are arrows, a force arrow, both of round length."""
    longest_m = MEASURE_MAX * width * pixel_m
    bar_m = round_down(longest_m)
    measures = [LegendEntry(length_text(bar_m), theme.ink, "bar", round(bar_m / pixel_m))]
    if arrow_m_N > 0:
        force_N = round_down(min(longest_m / arrow_m_N, f_max_N))
        text = f"force, {force_N:g} N" if force_N >= 0.00999 else f"force, {force_N * 1e3:g} mN"
        measures.insert(0, LegendEntry(text, FORCE, "arrow", round(force_N * arrow_m_N / pixel_m)))
    return measures


class Legend:
    """Draws entries in rows, and a last row of right-aligned measures.

    Attributes:
        height: total height [pixels].
    """

    def __init__(self, entries: Sequence[LegendEntry], width: int, theme: Theme) -> None:
        self._width, self._theme = width, theme
        self._size = max(11, round(width * 0.015))  # height of the text
        self._font = _font(self._size)
        self._rows: list[list[tuple[int, LegendEntry]]] = [[]]
        x = self._size
        for entry in entries:
            entry_width = self._entry_width(entry)
            if self._rows[-1] and x + entry_width > width - self._size:
                self._rows.append([])
                x = self._size
            self._rows[-1].append((x, entry))
            x += entry_width + 2 * self._size
        self.height = self._middle(len(self._rows)) + round(1.5 * self._size)

    def draw(self, measures: Sequence[LegendEntry]) -> Image.Image:
        """Draw the legend with these measures."""
        strip = Image.new("RGB", (self._width, self.height), self._theme.page)
        pen = ImageDraw.Draw(strip)
        last: list[tuple[int, LegendEntry]] = []
        x = self._width - self._size
        for entry in reversed(measures):
            x -= self._entry_width(entry)
            last.append((x, entry))
            x -= 2 * self._size
        for row, entries in enumerate([*self._rows, last]):
            for x, entry in entries:
                self._draw_sign(pen, entry, x, self._middle(row))
                text_x = x + self._sign_width(entry) + self._size // 2
                pen.text((text_x, self._middle(row)), entry.text, fill=self._theme.ink, font=self._font, anchor="lm")
        return strip

    def _draw_sign(self, pen: ImageDraw.ImageDraw, entry: LegendEntry, x: int, y: int) -> None:
        size, colour = self._size, entry.colour
        right = x + self._sign_width(entry)
        if entry.kind == "ball":
            middle, r = (x + right) // 2, round(size * 0.4)
            pen.ellipse((middle - r, y - r, middle + r, y + r), fill=colour, outline=self._theme.ink)
            return
        half = max(size // {"patch": 2, "line": 6, "thread": 12}.get(entry.kind, 8), 1)
        head = min(size, right - x) if entry.kind == "arrow" else 0
        edge = EDGE if entry.kind == "patch" else None
        pen.rectangle((x, y - half, right - head // 2, y + half), fill=colour, outline=edge)
        if entry.kind == "arrow":
            pen.polygon(((right, y), (right - head, y - head // 2), (right - head, y + head // 2)), fill=colour)
        elif entry.kind == "bar":  # with end marks
            for end in (x, right):
                pen.line((end, y - size // 2, end, y + size // 2), fill=colour, width=max(size // 10, 1))

    def _entry_width(self, entry: LegendEntry) -> int:
        return self._sign_width(entry) + self._size // 2 + int(np.ceil(self._font.getlength(entry.text)))

    def _sign_width(self, entry: LegendEntry) -> int:
        return entry.length_px or (self._size if entry.kind == "ball" else round(1.4 * self._size))

    def _middle(self, row: int) -> int:
        return round((1.5 + 1.9 * row) * self._size)


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """Return the sans-serif font of matplotlib, which is the same on every machine."""
    package = find_spec("matplotlib")  # importing matplotlib takes longer than drawing a picture
    assert package is not None and package.origin is not None
    return ImageFont.truetype(Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def round_down(value: float) -> float:
    """Round `value` > 0 down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))
