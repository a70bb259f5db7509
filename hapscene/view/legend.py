"""The strip under a picture: what the colours mean, and how long things are. Nothing in it overlaps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from hapscene.scene.mesh_report import length as length_text
from hapscene.view.body_triangles import used_swatches
from hapscene.view.figure_parts import PROXY_COLOUR
from hapscene.view.palette import AIR, EDGE, FORCE, PATH, Theme, distinct_colours

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

NAME_MAX: Final = 28
"""Longest name that is written in full [characters]."""

MEASURE_MAX: Final = 0.2
"""Longest scale bar or arrow, as a fraction of the picture's width [1]."""


@dataclass(frozen=True)
class LegendEntry:
    """A sign and its text. `kind` is patch, line, thread, ball, bar or arrow; bars and arrows have a length."""

    text: str
    colour: str
    kind: str = "patch"
    length_px: int = 0


@dataclass(frozen=True)
class Placed:
    """An entry at its place [pixels]: left end, middle of its row, width of all of it."""

    entry: LegendEntry
    x: int
    y: int
    width: int


def entries_of(scene: "Scene", theme: Theme, path: bool = False, tool: bool = False) -> list[LegendEntry]:
    """What the colours of a picture mean: the swatches that some face wears, the path, the tool."""
    used = used_swatches(scene)
    colours = distinct_colours(scene.swatches, used)
    names = [swatch.name for swatch in scene.swatches]
    if any(body.mesh.colour_rgb is not None for body in scene.bodies):
        names[0] += " (colours of the file)"
    entries = [LegendEntry(names[i], colours[i]) for i in used]
    if tool:
        entries += [LegendEntry("tool", theme.tool, "line"), LegendEntry("proxy", PROXY_COLOUR, "ball")]
    if path:
        entries += [LegendEntry("path on the surface", PATH, "line"), LegendEntry("in the air", AIR, "thread")]
    return entries


def measures_of(pixel_m: float, width: int, theme: Theme, arrow_m_N: float, f_max_N: float) -> list[LegendEntry]:
    """A scale bar of a round length; and an arrow of a round force, where there are arrows."""
    longest_m = MEASURE_MAX * width * pixel_m
    bar_m = round_down(longest_m)
    measures = [LegendEntry(length_text(bar_m), theme.ink, "bar", round(bar_m / pixel_m))]
    if arrow_m_N > 0:
        force_N = round_down(min(longest_m / arrow_m_N, f_max_N))
        arrow = LegendEntry(f"force, {force_text(force_N)}", FORCE, "arrow", round(force_N * arrow_m_N / pixel_m))
        measures.insert(0, arrow)
    return measures


def lay_out(entries: Sequence[LegendEntry], measures: Sequence[LegendEntry], width: int) -> tuple[list[Placed], int]:
    """Entries in rows from the left, measures at the right of the last row or in one more.

    Returns:
        Each entry at its place in the strip, and the strip's height [pixels].
    """
    font, size = _font(font_size(width)), font_size(width)
    gap, left, right = 2 * size, size, width - size
    placed: list[Placed] = []
    row, x = 0, left
    for entry in entries:
        fitted, entry_width = _fitted(entry, font, size, right - left)
        if x > left and x + entry_width > right:
            row, x = row + 1, left
        placed.append(Placed(fitted, x, _middle(row, size), entry_width))
        x += entry_width + gap
    last = [_fitted(entry, font, size, right - left) for entry in measures]
    beside = sum(w for _, w in last) + gap * (len(last) - 1) <= right - left
    for group in [last] if beside and last else [[one] for one in last]:
        at = right - sum(w for _, w in group) - gap * (len(group) - 1)
        if placed and at < placed[-1].x + placed[-1].width + gap:
            row += 1
        for fitted, entry_width in group:
            placed.append(Placed(fitted, at, _middle(row, size), entry_width))
            at += entry_width + gap
    return placed, _middle(row, size) + round(1.5 * size)


def strip_height(entries: Sequence[LegendEntry], measure_count: int, width: int) -> int:
    """Height that the strip can need, before the lengths of its measures are known [pixels]."""
    longest = [LegendEntry("force, 0.0005 N", FORCE, "arrow", round(MEASURE_MAX * width))] * measure_count
    return lay_out(entries, longest, width)[1]


def draw_strip(placed: Sequence[Placed], width: int, height: int, theme: Theme) -> Any:
    """The strip as an image of Pillow's."""
    strip = Image.new("RGB", (width, height), theme.page)
    pen, size = ImageDraw.Draw(strip), font_size(width)
    font = _font(size)
    for item in placed:
        sign = _draw_sign(pen, item, size, theme)
        pen.text((item.x + sign + size // 2, item.y), item.entry.text, fill=theme.ink, font=font, anchor="lm")
    return strip


def font_size(width: int) -> int:
    """Size of the text in a picture of this width [pixels]."""
    return max(11, round(width * 0.015))


def _draw_sign(pen: ImageDraw.ImageDraw, item: Placed, size: int, theme: Theme) -> int:
    """Draw what stands before the text; return its width."""
    entry, x, y = item.entry, item.x, item.y
    width = _sign_width(entry, size)
    half = {"patch": size // 2, "line": max(size // 6, 1), "thread": max(size // 12, 1), "bar": max(size // 8, 1)}
    if entry.kind == "arrow":
        head = min(size, width)
        thick = max(size // 8, 1)
        pen.rectangle((x, y - thick, x + width - head // 2, y + thick), fill=entry.colour)
        pen.polygon(
            ((x + width, y), (x + width - head, y - head // 2), (x + width - head, y + head // 2)), fill=entry.colour
        )
    elif entry.kind == "ball":
        middle, r = x + width // 2, round(size * 0.4)
        pen.ellipse((middle - r, y - r, middle + r, y + r), fill=entry.colour, outline=theme.ink)
    else:
        edge = EDGE if entry.kind == "patch" else None
        pen.rectangle((x, y - half[entry.kind], x + width, y + half[entry.kind]), fill=entry.colour, outline=edge)
    if entry.kind == "bar":  # with ends, so that it is seen to be measured
        for end in (x, x + width):
            pen.line((end, y - size // 2, end, y + size // 2), fill=entry.colour, width=max(size // 10, 1))
    return width


def _sign_width(entry: LegendEntry, size: int) -> int:
    return {"bar": entry.length_px, "arrow": entry.length_px, "ball": size}.get(entry.kind, round(1.4 * size))


def _fitted(entry: LegendEntry, font: ImageFont.FreeTypeFont, size: int, most: int) -> tuple[LegendEntry, int]:
    """The entry with its text cut to what there is room for, and its width [pixels]."""
    text = entry.text if len(entry.text) <= NAME_MAX else entry.text[: NAME_MAX - 1] + "…"
    sign = _sign_width(entry, size) + size // 2
    while len(text) > 2 and sign + font.getlength(text) > most:
        text = text[:-2] + "…"
    return replace(entry, text=text), sign + int(np.ceil(font.getlength(text)))


def _middle(row: int, size: int) -> int:
    return round((1.5 + 1.9 * row) * size)


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """The sans serif that comes with matplotlib: the same on every machine."""
    package = find_spec("matplotlib")  # not imported: that takes longer than all the rest of a picture
    assert package is not None and package.origin is not None
    return ImageFont.truetype(Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def round_down(value: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten that is not over `value` > 0."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))


def force_text(force_N: float) -> str:
    """A force with the unit that makes it readable."""
    return f"{force_N:g} N" if force_N >= 0.00999 else f"{force_N * 1e3:g} mN"
