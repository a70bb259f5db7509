"""The legend of a picture."""

import numpy as np
import pytest
import trimesh

from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.view.palette import LIGHT, rgb
from hapscene.view.picture import Legend, LegendEntry, entries_of, length_text, measures_of, round_down


def inked(legend: Legend, measures: list[LegendEntry]) -> np.ndarray:
    """Mask of the pixels of a legend that differ from the background."""
    return np.any(np.asarray(legend.draw(measures)) != np.round(rgb(LIGHT.page) * 255), axis=2)


@pytest.mark.parametrize("count", [1, 40])
def test_layout(count: int) -> None:
    width = 800
    legend = Legend([LegendEntry("w" * (3 + 7 * k % 20), "#000000") for k in range(count)], width, LIGHT)
    measures = measures_of(0.3 / width, width, LIGHT, 0.05, 1.3)
    entries, both = inked(legend, []), inked(legend, measures)
    assert both.shape == (legend.height, width) and (count == 40) == (legend.height > 100)
    assert not both[:, :10].any() and not both[:, -10:].any() and not both[:6].any() and not both[-6:].any()
    rows = np.flatnonzero((both & ~entries).any(axis=1))
    bar = inked(legend, measures[1:])[rows.min() :].any(axis=0)
    start, size = int(bar.argmax()), 12  # the arrow ends two sizes before the bar
    gap = both[rows.min() :, :start].any(axis=0)
    assert not gap[start - 2 * size + 1 :].any() and gap[start - 2 * size - 3 : start - 2 * size + 1].any()
    assert not entries[rows.min() :].any() and not (both & ~entries)[:, : width // 3].any()


def test_text_is_legible_in_small_pictures() -> None:
    """Text of 11 pixels at least, else 1.5 % of the width; a row of measures and margins are 3.4 and 1.5 times that."""
    for width, size in ((640, 11), (1600, 24)):
        assert Legend([], width, LIGHT).height == round(3.4 * size) + round(1.5 * size)


HEIGHTS_PX = {"patch": 25, "line": 9, "thread": 5, "ball": 21, "bar": 25, "arrow": 25}


@pytest.mark.parametrize("kind", HEIGHTS_PX)
def test_signs(kind: str) -> None:
    """In a row of 24 pixels height, the text 12 pixels behind the sign."""
    length = 60 if kind in ("bar", "arrow") else 24 if kind == "ball" else 34
    legend = Legend([LegendEntry("H", "#000000", kind, 60 if length == 60 else 0)], 1600, LIGHT)
    mask = inked(legend, [])
    sign, text = mask[:, : 24 + length + 6], mask[:, 24 + length + 6 :]
    rows, columns = np.flatnonzero(sign.any(axis=1)), np.flatnonzero(sign.any(axis=0))
    assert rows.max() - rows.min() + 1 == HEIGHTS_PX[kind] and rows.min() + rows.max() == 2 * 36
    assert columns.min() == pytest.approx(24, abs=2) and columns.max() == pytest.approx(24 + length, abs=2)
    start, end = np.flatnonzero(text.any(axis=0))[[0, -1]] + 24 + length + 6
    assert start == pytest.approx(24 + length + 12, abs=4) and end - start > 8


def test_only_used_swatches_are_listed() -> None:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((1, 1, 1)), "m"), name="box", swatch=Swatch("under"))
    scene.paint("box", Swatch("over"))
    assert [entry.text for entry in entries_of(scene, LIGHT)] == ["over"]
    scene.paint("box", "plain", [0])
    assert [entry.text for entry in entries_of(scene, LIGHT)] == ["plain", "over"]


def test_measures() -> None:
    arrow, bar = measures_of(1e-3, 800, LIGHT, arrow_m_N=0.06, f_max_N=1.7)
    assert (bar.text, bar.length_px) == ("100 mm", 100)
    assert (arrow.text, arrow.length_px) == ("force, 1 N", 60)
    assert [round_down(m) for m in (0.0123, 0.05, 0.199, 7.0)] == pytest.approx([0.01, 0.05, 0.1, 5.0])
    assert [length_text(m) for m in (0.05, 2.0, 2e-5)] == ["50 mm", "2 m", "20 µm"]
    assert measures_of(1e-5, 800, LIGHT, arrow_m_N=0.06, f_max_N=0.002)[0].text == "force, 2 mN"
