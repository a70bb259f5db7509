"""Charts for light and dark backgrounds."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image

from hapscene.view.chart import dark_twin, inline_svg, new_chart, save_both, turn_dark
from hapscene.view.palette import DARK, INK, OKABE_ITO, rgb


@pytest.fixture
def figure() -> Figure:
    """A chart with a line, points with white centres, an annotation with an arrow, a legend and a grid."""
    with new_chart(4, 3) as figure:
        axes = figure.subplots()
        axes.plot([1, 2, 3], [1, 5, 2], "o-", color=OKABE_ITO["blue"], markerfacecolor="white", label="felt")
        axes.axhline(2.0, color=INK, linestyle="--", label="limit")
        axes.annotate("here", (2, 5), (1.2, 4.5), arrowprops={"arrowstyle": "-", "color": INK}, bbox={"fc": "white"})
        axes.set(xlabel="time [s]", ylabel="force [N]", xscale="log")
        axes.legend()
    return figure


def test_turn_dark_inverts_greys(figure: Figure) -> None:
    axes = figure.axes[0]
    line, limit = axes.lines
    turn_dark(figure)
    assert to_hex(figure.get_facecolor()) == to_hex(axes.get_facecolor()) == to_hex(line.get_markerfacecolor())
    assert to_hex(axes.get_facecolor()).upper() == DARK.page
    assert to_hex(line.get_color()).upper() == OKABE_ITO["blue"]
    (annotation,) = axes.texts
    assert annotation.arrow_patch is not None and annotation.get_bbox_patch() is not None
    inks = [
        limit.get_color(),
        axes.xaxis.label.get_color(),
        annotation.get_color(),
        annotation.arrow_patch.get_edgecolor(),
    ]
    inks += [label.get_color() for label in (*axes.get_xticklabels(), *axes.get_legend().get_texts())]
    assert {to_hex(colour).upper() for colour in inks} == {DARK.ink}
    assert to_hex(annotation.get_bbox_patch().get_facecolor()).upper() == DARK.page
    grid = rgb(to_hex(axes.xaxis.get_gridlines()[0].get_color()))
    assert (rgb(DARK.page) < grid).all() and grid.mean() < 0.3


def test_save_both(figure: Figure, tmp_path: Path) -> None:
    light, dark = save_both(figure, tmp_path / "force.png", dpi=60)
    assert (light.name, dark.name) == ("force.png", "force-dark.png") and dark == dark_twin(light)
    a, b = (np.asarray(Image.open(file).convert("RGB")).astype(float) for file in (light, dark))
    assert (a[0, 0] == 255).all() and np.array_equal(b[0, 0], np.round(255 * rgb(DARK.page)))
    blue = 255 * rgb(OKABE_ITO["blue"])
    line = [np.abs(x - blue).max(axis=2) < 10 for x in (a, b)]  # edges of lines are blended with the background
    inked = [np.abs(x - x[0, 0]).max(axis=2) > 100 for x in (a, b)]
    assert line[0].sum() > 50 and (line[0] == line[1]).mean() > 0.995
    assert inked[0].sum() > 500 and (inked[0] == inked[1]).mean() > 0.97


def test_inline_svg(figure: Figure) -> None:
    drawing = inline_svg(figure, "force")
    refers, others = (set(re.findall(r"url\(#(\w+)\)", some)) for some in (drawing, inline_svg(figure, "other")))
    assert refers and not refers & others  # ids are unique on a page
    assert ET.fromstring(drawing).get("viewBox") and "width=" not in drawing.split(">")[0]
    inks = f"light-dark({INK}, {DARK.ink})".lower(), f"light-dark(#ffffff, {DARK.page})".lower()
    assert all(ink in drawing for ink in inks)
    assert f"stroke: {OKABE_ITO['blue']}".lower() in drawing  # colours do not change
    assert INK not in re.sub(r"light-dark\(.*?\)", "", drawing)
    assert ">force [N]</text>" in drawing
