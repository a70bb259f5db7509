"""Presets of hand and brush: under names, in the user's folder."""

from pathlib import Path

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.paint.preset import PRESET_MAX, PresetError, load_presets, save_preset
from hapscene.paint.web.page import Page

from ..tab import Tab


def press(tab: Tab, label: str) -> None:
    tab.post("GuiUpdateMessage", uuid=tab.control(label)["uuid"], updates={"value": True})
    tab.settle()


def test_hand_and_brush_are_kept_under_a_name_and_come_back(page: Page, tab: Tab, library: Path) -> None:
    context = page.context
    context.tools.force_N, context.tools.fill, context.tools.softness = 2.0, "material", 0.5
    radius_m = context.tools.radius_m
    tab.set("Grip", "firm")
    tab.settle()
    tab.set("Name", "hard work")
    tab.settle()
    press(tab, "Save preset")
    assert (library / "presets.json").is_file() and list(load_presets()) == ["hard work"]

    context.tools.force_N, context.tools.fill, context.tools.softness = 0.5, "facet", 0.0
    context.tools.resize(radius_m / 3)
    tab.set("Grip", "light")
    tab.set("Preset", "none")
    tab.settle()
    tab.set("Preset", "hard work")
    tab.settle()
    assert (context.tools.force_N, context.tools.fill, context.touch.config.grip) == (2.0, "material", "firm")
    assert context.tools.radius_m == pytest.approx(radius_m)
    assert [tab.control(label)["value"] for label in ("Softness [%]", "Force [N]", "Fill")] == [
        50,
        2.0,
        "material",
    ]
    press(tab, "Delete preset")
    assert load_presets() == {} and tab.control("Preset")["props"]["options"] == ["none"]


def test_a_preset_of_a_stranger_takes_no_more_than_it_may(page: Page, tab: Tab) -> None:
    save_preset(
        "odd", {"force_N": 1e9, "radius_m": -5.0, "fill": "all", "device": "ideal", "name": "x", "angle_rad": "1"}
    )
    tools, before = page.context.tools, page.context.tools.angle_rad
    page._hand_panel.show_presets("none")
    tab.set("Preset", "odd")
    tab.settle()
    assert tools.force_N == 3.0 and tools.radius_m > 0.0 and tools.fill == "facet" and tools.angle_rad == before
    assert page.context.touch.config.device == "omni"


def test_what_cannot_be_kept_is_said(library: Path) -> None:
    with pytest.raises(PresetError, match="1 to 60 printable characters"):
        save_preset("", {})
    for i in range(PRESET_MAX):
        save_preset(str(i), {})
    with pytest.raises(PresetError, match="delete one first"):
        save_preset("one more", {})
    (library / "presets.json").write_text("[1]")
    with pytest.raises(PresetError, match=r"presets.json: not a list of presets"):
        load_presets()
