"""The tools in hand, through the page's real protocol."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.paint.page import Page

from .tab import Tab, until

TOP = np.array([0.01, 0.0, 0.02])
"""On top of the ball."""

ASIDE = np.array([0.018, 0.0, 0.018])


def drawn(page: Page, tab: Tab, *places: np.ndarray) -> tuple[np.ndarray, ...]:
    """Press at the first place, move over those between, let go at the last; the painting, which is taken back."""
    tab.point("down", places[0])
    for place in places[1:-1]:
        tab.point("move", place)
    tab.point("up", places[-1])
    tab.settle()
    painted = tuple(body.face_swatch.copy() for body in page.parts.session.scene.bodies)
    tab.send("undo")
    tab.settle()
    return painted


@pytest.mark.parametrize("tool", ["brush", "box", "sphere"])
def test_a_flick_ends_where_the_button_went_up(page: Page, tab: Tab, tool: str) -> None:
    page.parts.tools.take("wood", "wood")
    tab.send("tool", name=tool)
    flick, slow = drawn(page, tab, TOP, ASIDE), drawn(page, tab, TOP, ASIDE, ASIDE)
    for one, other, body in zip(flick, slow, page.parts.session.scene.bodies, strict=True):
        np.testing.assert_array_equal(one, other)
        assert body.name != "ball" or (one != body.face_swatch).any()


@pytest.mark.parametrize("tool", ["brush", "fill", "box", "sphere"])
def test_a_swatch_that_cannot_be_had_is_told_once_and_nothing_is_held(page: Page, tab: Tab, tool: str) -> None:
    page.parts.tools.take("nowhere", "nowhere")
    tab.send("tool", name=tool)
    tab.point("down", TOP)
    for place in (ASIDE, TOP, ASIDE):
        tab.point("move", place)
    tab.point("up", ASIDE)
    tab.settle()
    assert sum("nowhere" in said for said in tab.said) == 1
    assert not page.parts.tools.held and page.parts.session.undo_word is None


def test_a_damaged_library_is_told_and_the_scene_is_painted_on(page: Page, tab: Tab, library: Path) -> None:
    library.mkdir()
    (library / "index.json").write_text("{")
    page.parts.tools.take("epoxy", "epoxy")
    tab.point("down", TOP)  # a new swatch: the shelf is read again
    tab.point("up", TOP)
    until(lambda: any("index.json" in said for said in tab.said))
    tab.send("undo")
    until(lambda: tab.state["redo"])
    tab.settle()  # the socket is alive
