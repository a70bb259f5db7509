"""The strip under a picture."""

from itertools import combinations

import numpy as np
import pytest
import trimesh

from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.view.legend import (
    NAME_MAX,
    LegendEntry,
    Placed,
    draw_strip,
    entries_of,
    font_size,
    force_text,
    lay_out,
    length_text,
    measures_of,
    round_down,
    strip_height,
)
from hapscene.view.palette import LIGHT, rgb


@pytest.mark.parametrize("width", [200, 320, 800, 1600])
@pytest.mark.parametrize("count", [1, 3, 8, 40])
@pytest.mark.parametrize("measure_count", [1, 2])
def test_nothing_overlaps_or_leaves_the_strip(width: int, count: int, measure_count: int) -> None:
    entries = [LegendEntry("w" * (3 + 7 * k % 40), "#000000") for k in range(count)]
    measures = measures_of(0.3 / width, width, LIGHT, 0.05, 1.3)[-measure_count:]
    placed, height = lay_out(entries, measures, width)
    assert len(placed) == count + measure_count
    assert height <= strip_height(entries, measure_count, width)
    half = font_size(width) * 0.9
    boxes = [(p.x, p.y - half, p.x + p.width, p.y + half) for p in placed]
    for x0, y0, x1, y1 in boxes:
        assert min(x0, y0) >= 0 and x1 <= width and y1 <= height
    for (ax0, ay0, ax1, ay1), (bx0, by0, bx1, by1) in combinations(boxes, 2):
        assert ax1 <= bx0 or bx1 <= ax0 or ay1 <= by0 or by1 <= ay0


def test_only_swatches_that_are_worn_are_named() -> None:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((1, 1, 1)), "m"), name="box", swatch=Swatch("under"))
    scene.paint("box", Swatch("over"))
    assert [entry.text for entry in entries_of(scene, LIGHT)] == ["over"]
    scene.paint("box", "plain", [0])
    assert [entry.text for entry in entries_of(scene, LIGHT)] == ["plain", "over"]


def test_measures_are_round_and_true() -> None:
    arrow, bar = measures_of(1e-3, 800, LIGHT, arrow_m_N=0.06, f_max_N=1.7)
    assert (bar.text, bar.length_px) == ("100 mm", 100)
    assert (arrow.text, arrow.length_px) == ("force, 1 N", 60)
    assert [round_down(m) for m in (0.0123, 0.05, 0.199, 7.0)] == pytest.approx([0.01, 0.05, 0.1, 5.0])
    assert [length_text(m) for m in (0.05, 2.0, 2e-5)] == ["50 mm", "2 m", "20 µm"]
    assert [force_text(f) for f in (2.0, 0.05, 0.002)] == ["2 N", "0.05 N", "2 mN"]


@pytest.mark.parametrize("width", [60, 200, 1600])
def test_names_are_whole_where_there_is_room_and_else_cut(width: int) -> None:
    names = ["wood", "w" * NAME_MAX, "w" * (NAME_MAX + 1)]
    texts = [placed.entry.text for placed in lay_out([LegendEntry(name, "#000000") for name in names], [], width)[0]]
    if width == 1600:
        assert texts == [*names[:2], "w" * (NAME_MAX - 1) + "…"]
    else:
        assert texts[0] == "wood" or width == 60
        assert all(text.endswith("…") and 2 <= len(text) < NAME_MAX for text in texts[1:])


def coloured(entry: LegendEntry, width: int = 800) -> tuple[np.ndarray, Placed]:
    """Where a strip (rows, columns) of one entry is not of the page, and where the entry stands."""
    (placed,), height = lay_out([entry], [], width)
    page = np.array(rgb(LIGHT.page) * 255, np.uint8)
    return np.any(np.asarray(draw_strip([placed], width, height, LIGHT)) != page, axis=2), placed


@pytest.mark.parametrize("kind", ["patch", "line", "thread", "ball", "bar", "arrow"])
def test_a_sign_is_as_long_as_it_says_and_stands_apart_from_its_text(kind: str) -> None:
    inked, placed = coloured(LegendEntry("wood", "#123456", kind, 100))
    size = font_size(800)
    long = {"bar": 100, "arrow": 100, "ball": 2 * round(0.4 * size)}.get(kind, round(1.4 * size))
    edges = np.flatnonzero(np.diff(np.concatenate(([0], inked.any(axis=0), [0])).astype(int))).reshape(-1, 2)
    sign, text = edges[0], edges[1]
    assert np.ptp(sign) == pytest.approx(long + 1, abs=2) and text[0] - sign[1] >= 0.4 * size
    assert edges[-1][1] <= placed.x + placed.width and edges[-1][1] >= placed.x + placed.width - 3
    rows = np.flatnonzero(inked[:, sign[0] : sign[1]].any(axis=1))
    assert rows.mean() == pytest.approx(placed.y, abs=0.5)
    high = {"patch": size, "ball": 0.8 * size, "arrow": size, "bar": size, "line": size / 3, "thread": size / 6}[kind]
    assert len(rows) == pytest.approx(high, abs=2.5)
