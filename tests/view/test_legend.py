"""The strip under a picture."""

from itertools import combinations

import pytest
import trimesh

from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.view.legend import (
    LegendEntry,
    entries_of,
    font_size,
    force_text,
    lay_out,
    length_text,
    measures_of,
    round_down,
    strip_height,
)
from hapscene.view.palette import LIGHT


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
