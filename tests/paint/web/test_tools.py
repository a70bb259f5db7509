"""The tools in hand, through the page's real protocol."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")


import hapscene
from hapscene.paint.model.session import FILLS, Session
from hapscene.paint.web.page import Page
from hapscene.paint.web.tool_panel import FORCE_N
from hapscene.paint.web.tools import CORNERS_MAX, RADIUS_SHARE, LassoOutline

from ..conftest import make_scene
from ..tab import Tab

TOP = np.array([0.01, 0.0, 0.02])
"""Point on top of the ball [m]."""

ASIDE = np.array([0.018, 0.0, 0.018])


def drawn(page: Page, tab: Tab, *places: np.ndarray) -> tuple[np.ndarray, ...]:
    """Make a stroke through points; return the painted faces of each body and undo the stroke."""
    tab.point("down", places[0])
    for place in places[1:-1]:
        tab.point("move", place)
    tab.point("up", places[-1])
    tab.settle()
    painted = tuple(body.face_swatch.copy() for body in page.context.session.scene.bodies)
    tab.send("undo")
    tab.settle()
    return painted


@pytest.mark.parametrize("tool", ["brush", "sphere"])
def test_fast_stroke_ends_at_the_release_point(page: Page, tab: Tab, tool: str) -> None:
    tab.tools.choose_swatch("wood", "wood")
    tab.send("tool", name=tool)
    flick, slow = drawn(page, tab, TOP, ASIDE), drawn(page, tab, TOP, ASIDE, ASIDE)
    for one, other, body in zip(flick, slow, page.context.session.scene.bodies, strict=True):
        np.testing.assert_array_equal(one, other)
        assert body.name != "ball" or (one != body.face_swatch).any()


@pytest.mark.parametrize("tool", ["brush", "fill", "sphere"])
def test_missing_swatch_is_reported_once_and_ends_the_stroke(page: Page, tab: Tab, tool: str) -> None:
    tab.tools.choose_swatch("nowhere", "nowhere")
    tab.send("tool", name=tool)
    tab.point("down", TOP)
    for place in (ASIDE, TOP, ASIDE):
        tab.point("move", place)
    tab.point("up", ASIDE)
    tab.settle()
    assert sum("nowhere" in said for said in tab.said) == 1
    assert not tab.tools.pressed and page.context.session.painting.undo_text is None


def test_damaged_library_is_reported_and_painting_continues(page: Page, tab: Tab, library: Path) -> None:
    library.mkdir()
    (library / "index.json").write_text("{")
    tab.tools.choose_swatch("epoxy", "epoxy")
    tab.point("down", TOP)  # a new swatch: the library is read again
    tab.point("up", TOP)
    tab.wait(lambda: any("index.json" in said for said in tab.said))
    tab.send("undo")
    tab.wait(lambda: tab.state["redo"])
    tab.settle()  # the connection still works


def test_a_long_outline_keeps_its_ends_and_every_second_corner_between() -> None:
    outline = LassoOutline()
    for k in range(CORNERS_MAX):
        for pointer in (SimpleNamespace(x=k, y=-k),) * 2:  # a pointer that rests adds nothing
            outline.add(pointer)
    assert outline.corners == [(k, -k) for k in range(CORNERS_MAX)]
    outline.add(SimpleNamespace(x=CORNERS_MAX, y=0))
    assert outline.corners == [*((k, -k) for k in range(0, CORNERS_MAX, 2)), (CORNERS_MAX, 0)]
    view: Any = SimpleNamespace(eye=lambda pointer: (np.eye(4), 0.5))
    assert outline.take(view, SimpleNamespace()) is not None and outline.corners == []


def test_the_brush_stays_within_its_bounds(page: Page, tab: Tab) -> None:
    tools = tab.tools
    low, usual, high = (share * page.context.view.diagonal_m for share in RADIUS_SHARE)
    for asked, taken in ((0.0, low), (usual, usual), (1e3, high)):
        tools.resize(asked)
        assert tools.radius_m == taken


STROKE = {"Size [mm]", "Falloff [%]", "Opacity [%]"}
SETTINGS = {
    "brush": STROKE,
    "eraser": STROKE,
    "fill": {"Fill", "Angle [°]"},
    "sphere": {"Size [mm]", "Opacity [%]"},
    "lasso": {"Opacity [%]"},
    "touch": {"Force [N]"},
    "pick": set(),
}


def test_each_tool_shows_its_settings(page: Page, tab: Tab) -> None:
    names = set().union(*SETTINGS.values())

    def shown() -> set[str]:
        props = [control["props"] for control in list(tab.controls.values())]
        return {one["label"] for one in props if one.get("label") in names and one["visible"]}

    for tool, labels in SETTINGS.items():
        tab.send("tool", name=tool)
        tab.wait(lambda labels=labels: shown() == labels)
    step, diameter_mm = tab.control("Size [mm]")["props"]["step"], 2e3 * tab.tools.radius_m
    assert diameter_mm <= tab.control("Size [mm]")["value"] <= diameter_mm + step <= 1.1 * diameter_mm
    for label, value in (("Falloff [%]", 25), ("Opacity [%]", 50), ("Angle [°]", 90)):
        tab.set(label, value)
    for label, value in (("Force [N]", 99.0), ("Fill", FILLS[1]), ("Fill", "all")):
        tab.set(label, value)
    for show in ("feel", "all"):
        tab.set("Show", show)
    tab.settle()
    found = [getattr(tab.tools, name) for name in ("falloff", "opacity", "angle_rad", "force_N")]
    assert found == pytest.approx([0.25, 0.5, np.pi / 2, FORCE_N[1]])
    assert tab.tools.fill == FILLS[1] and page.context.view.show == "feel"


def test_stroke_without_effect_reports_the_reason(page: Page, tab: Tab) -> None:
    tab.tools.choose_swatch("plain", "plain")
    for tool, message in (("brush", "plain already"), ("eraser", "nothing to erase")):
        tab.send("tool", name=tool)
        tab.point("down", TOP)
        tab.point("up", TOP)
        tab.settle()
        assert sum(message in said for said in tab.said) == 1
    assert not page.context.session.document.changed


@pytest.mark.parametrize("tool", ["brush", "eraser", "fill", "sphere"])
def test_press_beside_the_surface_is_reported(page: Page, tab: Tab, tool: str) -> None:
    tab.send("tool", name=tool)
    tab.point("down", np.array([0.0, 0.9, 0.0]))
    tab.settle()
    assert sum("no surface here" in said for said in tab.said) == 1
    assert not page.context.session.document.changed


def test_on_a_scene_without_swatches_the_first_stroke_is_seen(tmp_path: Path) -> None:
    make_scene(tmp_path)
    scene = hapscene.Scene()
    scene.add(tmp_path / "ball.obj", name="ball", unit="mm")
    session = Session(scene, tmp_path / "ball.scene.json")
    with Page(session, port=0, with_hand=False) as page:
        tab = Tab(page)
        tab.wait(lambda: any("Paint with <b>wood</b>" in str(c["props"].get("content")) for c in tab.controls.values()))
        tab.point("down", (0.0, 0.0, 0.02))
        tab.point("up", (0.0, 0.0, 0.02))
        tab.settle()
        assert scene.swatches[1].name == "wood" and (scene.bodies[0].face_swatch == 1).any()
        assert tab.control("Stiffness [N/m]")["value"] == scene.swatches[1].stiffness_N_m
        tab.close()
    session.document.close()


def test_two_pages_have_their_own_tools_and_share_the_painting(page: Page, tab: Tab) -> None:
    other = Tab(page)
    tab.choose("wood")
    other.choose("leather")
    tab.send("tool", name="fill")
    other.send("size", factor=0.5)
    for each in (tab, other):
        each.settle()
    assert (tab.state["tool"], tab.state["swatch"]) == ("fill", "wood")
    assert (other.state["tool"], other.state["swatch"]) == ("brush", "leather")
    other_tools = other.tools
    assert other.control("Size [mm]")["value"] < 0.6 * tab.control("Size [mm]")["value"]
    tab.point("down", TOP)
    tab.wait(lambda: other.state["undo"])  # both see the painting
    assert not any("painted" in said for said in other.said) and "leather" not in [
        swatch.name for swatch in page.context.session.scene.swatches
    ]
    other.point("hover", TOP)
    other.settle()
    assert other.tools._marks._ring.visible and not tab.tools._marks._ring.visible
    other.close()
    tab.wait(lambda: list(page.clients) == [tab.client])
    again = Tab(page)  # a reloaded page gets its tools back
    assert again.tools is other_tools
    again.close()


def test_strokes_of_two_pages_at_once_are_both_painted_whole(page: Page, tab: Tab) -> None:
    """Each move ends the step of the other stroke; the line must have no gap there."""
    other, session = Tab(page), page.context.session
    tab.choose("wood")
    other.choose("leather")
    tab.tools.radius_m = other.tools.radius_m = 0.001
    for do, x in (("down", -1.0), ("move", 0.0), ("up", 1.0)):
        for each, y in ((tab, 0.005), (other, -0.005)):
            each.point(do, TOP + np.array([0.009 * x, y, -0.002 * abs(x)]))
            each.settle()
            assert each.tools.stroking == (do != "up")
    names = [swatch.name for swatch in session.scene.swatches]
    for y, name in ((0.005, "wood"), (-0.005, "leather")):
        for x in np.linspace(-0.8, 0.8, 17):
            place = TOP + np.array([0.009 * x, y, 0.05])
            hit = session.pick(place, (0.0, 0.0, -1.0))
            assert names[session.swatch_at(hit)] == name
    assert not tab.tools.pressed and not other.tools.pressed
    other.close()


def test_choosing_a_swatch_is_no_step_and_a_stroke_with_it_is_one(page: Page, tab: Tab) -> None:
    scene, before = page.context.session.scene, [swatch.name for swatch in page.context.session.scene.swatches]
    tab.choose("leather")
    assert not page.context.session.document.changed and "leather" not in before
    for _ in range(2):
        tab.point("down", TOP)
        tab.point("up", TOP)
        tab.settle()
        assert scene.swatches[-1].name == "leather" and (scene.bodies[0].face_swatch == len(before)).any()
        tab.send("undo")
        tab.settle()
        assert [swatch.name for swatch in scene.swatches] == before and not page.context.session.document.changed
    tab.send("redo")
    tab.settle()
    assert scene.swatches[-1].name == "leather" and (scene.bodies[0].face_swatch == len(before)).any()


def test_touch_before_the_hand_is_ready_is_reported(page: Page, tab: Tab) -> None:
    tab.send("tool", name="touch")
    tab.point("down", TOP)
    tab.settle()
    assert any("not ready" in said for said in tab.said)


def test_saving_during_a_stroke_includes_it(page: Page, tab: Tab) -> None:
    tab.tools.choose_swatch("wood", "wood")
    tab.point("down", TOP)
    tab.settle()
    tab.send("save")
    tab.wait(lambda: not tab.state["dirty"])
    tab.point("up", TOP)
    tab.settle()
    assert not any("already" in said for said in tab.said)


def test_a_lasso_paints_the_visible_surface_inside(page: Page, tab: Tab) -> None:
    tab.tools.choose_swatch("wood", "wood")
    corners = [TOP + d for d in np.array([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)]) * 1e-3]
    tab.send("tool", name="lasso")
    lasso = drawn(page, tab, *corners, corners[0])
    ball = page.context.session.scene.bodies[0]
    assert (lasso[0] != 0).any() and not tab.state["outline"]
    z = ball.mesh.triangles_m.mean(axis=1) @ ball.X_WB[2, :3]
    assert z[lasso[0] != 0].min() > 0.0  # not the other side
