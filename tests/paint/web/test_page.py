"""The page through its real protocol: what a browser would send and see."""

import asyncio
import contextlib
import html
import json
import random
import re
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trimesh.creation import box

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import hapscene
from hapscene.errors import ViewError
from hapscene.paint.model.document import autosave_folder
from hapscene.paint.model.session import Session
from hapscene.paint.web.hand import HandConfig
from hapscene.paint.web.page import Page
from hapscene.paint.web.socket import UPLOAD_PATH
from hapscene.scene.scene import load_scene

from ..conftest import make_scene
from ..tab import Tab

TOP = (0.01, 0.0, 0.02)
"""On top of the ball."""


def painted(page: Page, body: int, name: str) -> int:
    """How many faces of a body wear a swatch."""
    names = [swatch.name for swatch in page.context.session.scene.swatches]
    return int((page.context.session.scene.bodies[body].face_swatch == names.index(name)).sum()) if name in names else 0


def stroke(tab: Tab) -> None:
    tab.point("down", TOP)
    for i in range(5):
        tab.point("move", np.add(TOP, (0.002 * i, 0.0, 0.0)))
    tab.point("up", TOP)
    tab.settle()


def test_view_fits_the_scene_or_the_body_under_the_pointer(page: Page, tab: Tab) -> None:
    camera = page.server.get_clients()[tab.client].camera
    for bad in ({"client": 99}, {"w": 0}, {"x": "x"}, {"name": None, "x": None}, {"h": -1.0}):
        tab.send("view", **{"client": tab.client, "w": 800, "h": 600, "x": 0.5, "y": 0.5, "name": "top", **bad})
    tab.settle()
    assert np.linalg.norm(camera.position) == pytest.approx(6.0)
    ball, view = page.context.session.scene.bodies[0], page.context.view
    place = page.context.view.to_view(TOP)
    across = 2 * (6.0 - place[2]) * np.tan(0.4)
    x, y = 0.5 + place[0] / across * 600 / 800, 0.5 - place[1] / across
    tab.send("view", client=tab.client, w=800, h=600, x=x, y=y, name="")
    tab.wait(lambda: np.allclose(camera.look_at, view.to_view(ball.X_WB[:3, 3]), atol=1e-3))
    ball_radius = 0.02 * 3.0 / view.diagonal_m
    assert 2 * ball_radius < np.linalg.norm(camera.position - camera.look_at) < 6.0
    tab.send("view", client=tab.client, w=800, h=600, x=-1, y=0, name=["top"])
    tab.wait(lambda: np.allclose(camera.look_at, 0.0))


def test_only_the_body_that_changed_is_sent_again(page: Page, tab: Tab) -> None:
    tab.choose("wood")
    tab.nodes.clear()
    stroke(tab)
    tab.wait(lambda: any(n.startswith("/body/0/") for n in tab.nodes))
    assert not any(n.startswith("/body/1/") for n in tab.nodes)


def test_each_tool_paints_where_it_says(page: Page, tab: Tab) -> None:
    tab.choose("leather")
    tab.send("tool", name="sphere")
    tab.point("down", TOP)
    tab.point("move", np.add(TOP, (0.008, 0.0, 0.0)))
    tab.point("up", TOP)
    tab.settle()
    ball = page.context.session.scene.bodies[0]
    inside = painted(page, 0, "leather")
    assert 0 < inside < len(ball.mesh.faces)
    tab.send("tool", name="eraser")
    stroke(tab)
    assert painted(page, 0, "leather") < inside
    tab.send("tool", name="fill")
    tab.settle()
    tab.set("Fill", "whole body")
    tab.settle()
    tab.point("down", TOP)
    tab.point("up", TOP)
    tab.settle()
    assert painted(page, 0, "leather") == len(ball.mesh.faces)
    tab.choose("wood")
    tab.send("tool", name="pick")
    tab.point("down", TOP)
    tab.point("up", TOP)
    tab.settle()
    assert tab.state["swatch"] in ("leather",)


def test_a_slider_tunes_the_swatch_and_undo_moves_it_back(page: Page, tab: Tab) -> None:
    tab.choose("paper")
    index = page.context.session.painting.swatch_named("paper")
    before = page.context.session.scene.swatches[index].stiffness_N_m
    tab.set("Stiffness [N/m]", 321.0)
    tab.wait(lambda: page.context.session.scene.swatches[index].stiffness_N_m == 321.0)
    tab.send("undo")
    tab.wait(lambda: tab.control("Stiffness [N/m]")["value"] == before)
    tab.set("Stiffness [N/m]", 1e9)
    tab.settle()
    assert page.context.session.scene.swatches[index].stiffness_N_m <= page.context.session.tuning.limits.stiffness_N_m


def test_friction_keeps_the_ratio_of_its_coefficients(page: Page, tab: Tab) -> None:
    tab.choose("epoxy")
    stroke(tab)
    tab.settle()
    swatches = page.context.session.scene.swatches
    index = page.context.session.painting.swatch_named("epoxy")
    ratio = swatches[index].friction_static / swatches[index].friction_dynamic
    tab.set("Friction", 0.1)
    tab.wait(lambda: swatches[index].friction_dynamic == 0.1)
    assert ratio > 1.0 and swatches[index].friction_static == pytest.approx(0.1 * ratio)


def test_messages_that_take_long_are_answered_on_the_page_that_sent_them(page: Page, tab: Tab) -> None:
    other = Tab(page)
    tab.send("undo", n=0.25)
    tab.wait(lambda: tab.done == [0.25])
    other.settle()
    assert not other.done
    other.close()


def test_tuned_swatch_is_saved_under_a_new_name_and_listed(page: Page, tab: Tab, library: Path) -> None:
    tab.choose("paper")
    tab.set("Stiffness [N/m]", 123.0)
    tab.set("New name", "card <b>board")
    tab.settle()
    tab.set("Save as new", True)
    tab.wait(lambda: any("to your library" in said for said in tab.said))
    assert list(library.glob("*.swatch"))

    def cards() -> str:
        return "".join(c["props"].get("content", "") for c in list(tab.controls.values()))

    tab.wait(lambda: "card &lt;b&gt;board" in cards())
    assert "card <b>board" not in cards()
    assert tab.tools.chosen == "card <b>board"


def test_previews_of_an_earlier_search_do_not_bring_its_cards_back(page: Page, tab: Tab) -> None:
    panel, loop = page.clients[tab.client].swatches, page.server.get_event_loop()
    earlier = panel._cards[:3]
    tab.set("Search", "no such swatch")
    tab.wait(lambda: not card_names(tab))
    asyncio.run_coroutine_threadsafe(panel._draw([], earlier), loop).result()
    tab.settle()
    assert not card_names(tab)


def card_names(tab: Tab) -> list[str]:
    """Return the names on the cards in display order."""
    content = "".join(c["props"].get("content") or "" for c in list(tab.controls.values()))
    return [html.unescape(name) for name in re.findall(r'data-library="use" data-name="([^"]*)"', content)]


def test_files_that_are_dropped_become_bodies(page: Page, tab: Tab, tmp_path: Path) -> None:
    drop(tab, {"C:\\fun\\gift.glb": box((0.02, 0.02, 0.02)).export(file_type="glb"), "notes.exe": b"no"})
    tab.wait(lambda: page.context.session.scene.bodies[-1].name == "gift")
    assert (tmp_path / "gift.glb").is_file() and not (tmp_path / "gift").exists()
    for files, pattern in (
        ({"bad.glb": b"no"}, "bad.glb"),
        ({"a.exe": b"no"}, r"a\.exe.*\.glb"),
        ({f"{i}.glb": b"" for i in range(201)}, "1 to 200 files"),
        ({"huge.glb": 1 << 40}, "512 MiB"),
        ({"short.glb": 10}, "interrupted"),
    ):
        drop(tab, files)
        tab.wait(lambda pattern=pattern: any(re.search(pattern, said) for said in list(tab.said)))
    assert not list(Path(tempfile.gettempdir()).glob("hapscene-*/bad.glb"))


def drop(tab: Tab, files: Mapping[str, bytes | int]) -> None:
    """Drop files on the page, as upload.js does. An integer in place of content sends the size but no data."""
    host = tab.page.url.removeprefix("http://").rstrip("/")
    origin: Any = f"http://{host.partition('/')[0]}"
    with connect(f"ws://{host}{UPLOAD_PATH}", origin=origin) as wire:
        sizes = {name: content if isinstance(content, int) else len(content) for name, content in files.items()}
        listed = [{"name": name, "size": size} for name, size in sizes.items()]
        wire.send(json.dumps({"files": listed}))
        with contextlib.suppress(ConnectionClosed):
            for content in files.values():
                if isinstance(content, bytes) and content:
                    wire.send(content)
        if not any(isinstance(content, int) for content in files.values()):
            with contextlib.suppress(ConnectionClosed):
                wire.recv(30.0)


def test_second_tab_shows_the_same_state_and_closing_one_loses_nothing(page: Page, tab: Tab) -> None:
    other, tools = Tab(page), tab.tools
    tab.choose("wood")
    tab.point("down", TOP)
    tab.point("move", np.add(TOP, (0.004, 0.0, 0.0)))
    tab.settle()
    tab.close()  # with the button held
    other.wait(lambda: "brush" in (other.state.get("undo") or ""))  # the stroke is ended
    assert painted(page, 0, "wood") > 0 and not tools.pressed
    third = Tab(page)
    assert third.state["undo"] == other.state["undo"]
    assert {n for n in third.nodes if n.startswith("/body")} or third.wait(lambda: third.nodes)
    other.close()
    third.close()


def test_failed_page_releases_its_resources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: Any) -> Any:
        raise ViewError("no picture")

    make_scene(tmp_path).save(tmp_path / "made.scene.json")
    before = set(threading.enumerate())
    for place in ("PageServer", "SceneView"):  # before there is a server, and after
        with monkeypatch.context() as broken:
            broken.setattr(f"hapscene.paint.web.page.{place}", fail)
            with pytest.raises(ViewError):
                Page(Session.open(tmp_path / "made.scene.json"), port=0, with_hand=False)
        assert not autosave_folder(tmp_path / "made.scene.json").exists()
    for _ in range(2):
        with Page(Session.open(tmp_path / "made.scene.json"), port=0, with_hand=False) as page:
            page.context.session.fill_body(0, 1)
        assert page.kept and page.network_url is None
    for thread in set(threading.enumerate()) - before:
        if not thread.name.startswith(("asyncio", "ThreadPool")):  # a thread that the loop lends stays
            thread.join()


def test_invalid_messages_change_nothing(page: Page, tab: Tab) -> None:
    before = page.context.session.painting.state
    for raw in ("", "[]", "{", "null", '{"do": 1}', '{"do": {}}', "[" * 9000, "x" * 100_000):
        tab.ours.send(raw)
    tab.ours.send(b"\x00\x01")
    tab.send("down", x="a", y=None, w=-1, h=0, client=True)
    tab.send("down", x=float("nan"), y=0.5, w=1e300, h=1, client=0)
    tab.send("tool", name="hammer")
    tab.send("size", factor="big")
    tab.send("rm -rf")
    tab.settle()
    assert page.context.session.painting.state == before and tab.state["tool"] == "brush"
    tab.set("Size [mm]", 9.0)
    tab.wait(lambda: abs(tab.tools.radius_m - 0.0045) < 1e-9)


def shake(page: Page, tab: Tab, count: int, seed: int) -> None:
    """Send random valid and invalid events."""
    dice = random.Random(seed)
    texts = (
        "",
        "wood",
        "friction<0.3",
        "<b>x</b>",
        "made.scene.json",
        "other.scene.json",
        "no/folder.scene.json",
        "π" * 50,
    )

    def value(control: dict[str, Any]) -> Any:
        known, props = control.get("value"), control["props"]
        if isinstance(known, bool) or known is None:
            return True
        if isinstance(known, str):
            return dice.choice([*(props.get("options") or texts), "no such"])
        return dice.choice((props.get("min", 0), props.get("max", 1), dice.uniform(-1e3, 1e3), 0))

    for i in range(count):
        kind = dice.random()
        if kind < 0.65:
            do = dice.choice(("hover", "down", "move", "move", "move", "up", "leave"))
            tab.point(do, np.add(TOP, [dice.gauss(0.0, 0.02) for _ in range(3)]))
        elif kind < 0.75:
            tab.send("tool", name=dice.choice(("brush", "fill", "sphere", "eraser", "pick", "touch", "x")))
        elif kind < 0.83:
            tab.send(
                dice.choice(("undo", "redo", "redo", "size", "save", "frame")),
                factor=dice.uniform(0.0, 3.0),
                client=tab.client,
                w=dice.uniform(-10.0, 2e3),
                h=dice.uniform(-10.0, 2e3),
            )
        elif kind < 0.86:
            tab.look([dice.gauss(0, 1) for _ in range(4)], [dice.gauss(0, 4) for _ in range(3)])
        elif tab.controls:
            control = dice.choice(list(tab.controls.values()))
            tab.post("GuiUpdateMessage", uuid=control["uuid"], updates={"value": value(control)})
        if i % 100 == 99:
            tab.look()
            tab.settle()


def check_saves_and_loads(page: Page, folder: Path) -> None:
    session = page.context.session
    tab = Tab(page)
    tab.send("leave")
    tab.settle()
    tab.close()
    session.save(folder / "shaken.scene.json", force=True)
    loaded = load_scene(folder / "shaken.scene.json")
    assert [s.name for s in loaded.swatches] == [s.name for s in session.scene.swatches]
    for a, b in zip(loaded.bodies, session.scene.bodies, strict=True):
        assert np.array_equal(a.face_swatch, b.face_swatch)
    hapscene.Renderer(loaded, effects=["wall"])


@pytest.mark.nightly
def test_random_events_leave_a_scene_that_saves_and_loads(page: Page, tab: Tab, tmp_path: Path) -> None:
    shake(page, tab, 400, seed=1)
    check_saves_and_loads(page, tmp_path)


def test_another_device_grip_and_handle_are_held_and_the_painting_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[HandConfig] = []

    async def opened(scene: Any) -> None:
        made.append(page.context.touch.config)

    monkeypatch.chdir(tmp_path)
    make_scene(tmp_path).save(tmp_path / "made.scene.json")
    session = Session.open(tmp_path / "made.scene.json")
    session.tuning.choose_device("phantom-1.0")
    page = Page(session, port=0, with_hand=False)
    monkeypatch.setattr(page.context.touch, "open", opened)
    page.context.touch.status = "ready"
    with page:
        tab = Tab(page)
        tab.choose("wood")
        stroke(tab)
        count = painted(page, 0, "wood")
        assert [tab.control(label)["value"] for label in ("Device", "Grip", "Handle")] == [
            "phantom-1.0",
            "light",
            "adaptive",
        ]
        tab.set("Handle", "no-handle")
        tab.wait(lambda: made == [HandConfig("phantom-1.0", "light", "no-handle")])
        tab.wait(lambda: any("ideal handle" in c["props"].get("content", "") for c in list(tab.controls.values())))
        tab.set("Device", "omni")
        tab.wait(lambda: made[1:] == [HandConfig("omni", "light", "no-handle")])
        assert session.tuning.device == "omni"
        tab.set("Grip", "firm")  # at once: nothing starts anew
        tab.wait(lambda: page.context.touch.config.grip == "firm")
        tab.set("Device", "hammer")
        tab.wait(lambda: any("'hammer'" in said for said in tab.said))
        assert len(made) == 2 and session.tuning.device == "omni" and painted(page, 0, "wood") == count > 0
        tab.close()
    session.document.close()
