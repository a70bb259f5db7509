"""The tab Bodies, through the real protocol, with valid and invalid messages."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
import trimesh

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.errors import HapsceneError
from hapscene.paint.web.body_panel import BodyPanel
from hapscene.paint.web.page import Page
from hapscene.scene.scene import load_scene

from ..tab import Tab


def html_of(tab: Tab, piece: str) -> str:
    texts = [c["props"].get("content") or "" for c in list(tab.controls.values())]
    return next((text for text in reversed(texts) if piece in text), "")


def act(tab: Tab, what: str, body: str = "", value: object = "") -> None:
    tab.send("body", act=what, body=body, value=value)
    tab.settle()


def take(page: Page, *files: Path) -> None:
    """Have files taken as if they were dropped."""
    panel: BodyPanel = page._body_panel
    asyncio.run_coroutine_threadsafe(panel.take(files), page.server.get_event_loop()).result(60.0)


def test_buttons_and_fields_do_what_they_say(page: Page, tab: Tab) -> None:
    session = page.context.session
    act(tab, "choose", "ball")
    assert 'aria-selected="true"' in html_of(tab, 'role="tree"') and 'value="ball"' in html_of(tab, "Parent")
    act(tab, "position x", "ball", "123,5")
    assert session.scene.body("ball").X_WB[0, 3] == pytest.approx(0.1235)
    plate = session.scene.body("plate")
    middle_m = plate.X_WB[:3, :3] @ plate.mesh.bounds_m.mean(axis=0) + plate.X_WB[:3, 3]
    act(tab, "rotation z", "plate", "30")
    act(tab, "rotation z", "plate", "90")
    np.testing.assert_allclose(plate.X_WB[:3, :3] @ plate.mesh.bounds_m.mean(axis=0) + plate.X_WB[:3, 3], middle_m)
    for after in ({"plate"}, set()):
        act(tab, "hide", "plate")
        assert session.painting.hidden == after
    act(tab, "size x", "plate", "80")
    assert np.ptp(session.scene.body("plate").mesh.bounds_m, axis=0)[0] == pytest.approx(0.08)
    act(tab, "scale", "plate", "1")
    assert np.ptp(session.scene.body("plate").mesh.bounds_m, axis=0)[0] == pytest.approx(0.04)
    act(tab, "parent", "plate", "ball")
    act(tab, "name", "plate", "lid")
    act(tab, "copy", "lid")
    assert [(b.name, b.parent) for b in session.scene.bodies] == [("ball", None), ("lid", "ball"), ("lid 2", "ball")]
    act(tab, "parent", "lid 2")
    frames = [name for name in tab.nodes if name.startswith("/body/") and name.count("/") == 2]
    assert len(frames) == 3 and "/handles" in tab.nodes
    act(tab, "delete", "lid 2")
    while session.painting.undo_text:
        session.undo()
    tab.send("hover")
    tab.settle()
    assert [b.name for b in session.scene.bodies] == ["ball", "plate"]


@pytest.mark.parametrize(
    ("what", "body", "value", "said"),
    [
        ("position x", "ball", "1e999", "is not a number"),
        ("position x", "bal", "1", "no body 'bal'"),
        ("scale", "ball", "0", "invalid scale"),
        ("parent", "ball", "ball", "cannot be attached"),
        ("name", "ball", "plate", "already has a body"),
        ("copy", "", "", "no body ''"),
    ],
)
def test_invalid_value_of_a_field_gives_one_message(
    page: Page, tab: Tab, what: str, body: str, value: str, said: str
) -> None:
    before = page.context.session.painting.state
    act(tab, what, body, value)
    matching = [text for text in tab.said if said in text]
    assert len(matching) == 1 and "\n" not in matching[0] and page.context.session.painting.state == before


def test_unknown_action_is_ignored(page: Page, tab: Tab) -> None:
    before = page.context.session.painting.state
    for message in ({"act": "_tree_html"}, {"act": {}}, {"act": "choose", "body": ["ball"]}, {"act": None}):
        tab.send("body", **message)
    tab.settle()
    assert page.context.session.painting.state == before


def test_names_are_escaped_in_html(page: Page, tab: Tab) -> None:
    act(tab, "name", "ball", '"><img src=x onerror=alert(1)>')
    act(tab, "choose", '"><img src=x onerror=alert(1)>')
    content = html_of(tab, "Parent") + html_of(tab, 'role="tree"')
    assert "&lt;img" in content and "<img" not in content


def test_handles_move_a_body_as_one_step_and_what_is_no_pose_moves_nothing(page: Page, tab: Tab) -> None:
    session = page.context.session
    act(tab, "choose", "ball")
    before = session.scene.body("ball").X_WB.copy()
    tab.wait(lambda: "/handles" in tab.nodes)
    tab.post("TransformControlsDragStartMessage", name="/handles", owner="")
    for x in (0.5, 1.0):
        tab.post(
            "TransformControlsUpdateMessage",
            name="/handles",
            owner="",
            wxyz=[1.0, 0.0, 0.0, 0.0],
            position=[x, 0.0, 0.0],
        )
    tab.post("TransformControlsUpdateMessage", name="/handles", owner="", wxyz=[0.0] * 4, position=[9.0, 0.0, 0.0])
    tab.post("TransformControlsDragEndMessage", name="/handles", owner="")
    tab.settle()
    body = session.scene.body("ball")
    middle = body.X_WB[:3, :3] @ body.mesh.bounds_m.mean(axis=0) + body.X_WB[:3, 3]
    np.testing.assert_allclose(page.context.view.to_view(middle), (1.0, 0.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(body.X_WB[:3, :3], np.eye(3), atol=1e-12)
    assert len(session.history.done) == 1
    session.undo()
    np.testing.assert_array_equal(session.scene.body("ball").X_WB, before)


def test_dropped_files_come_beside_the_scene_under_names_of_their_own(page: Page, tab: Tab, tmp_path: Path) -> None:
    session, given = page.context.session, tmp_path / "given"
    given.mkdir()
    trimesh.creation.box((0.02, 0.02, 0.02)).export(given / "ball.glb")
    trimesh.creation.box((0.03, 0.03, 0.03)).export(given / "cup.glb")
    (tmp_path / "cup.glb").write_bytes(b"another one")
    take(page, given / "ball.glb", given / "cup.glb")
    take(page, given / "ball.glb")
    names = [b.name for b in session.scene.bodies]
    assert names == ["ball", "plate", "ball 2", "cup 2", "ball 3"]
    assert (tmp_path / "cup.glb").read_bytes() == b"another one" and (tmp_path / "cup 2.glb").is_file()
    assert len(list(tmp_path.glob("ball*.glb"))) == 1  # the same content is there

    for content, why in ((b"", "is empty"), (b"glTF" + bytes(60), "broken"), (b"junk", "broken")):
        (given / "broken.glb").write_bytes(content)
        with pytest.raises(HapsceneError, match=why) as error:
            take(page, given / "broken.glb")
        assert "\n" not in str(error.value) and str(error.value).startswith("broken.glb: ")
    (given / "alone.mtl").write_text("newmtl a")
    with pytest.raises(HapsceneError, match="belongs to a mesh"):
        take(page, given / "alone.mtl")
    assert not list(tmp_path.glob("broken*")) and len(session.scene.bodies) == 5


def test_files_that_belong_together_come_into_a_folder(page: Page, tab: Tab, tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.mkdir()
    sheet = trimesh.creation.box((0.02, 0.02, 0.02))
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(sheet)).items():
        (given / name.replace("model", "part")).write_bytes(content)
    take(page, *sorted(given.iterdir()))
    body = page.context.session.scene.bodies[-1]
    assert body.name == "part" and body.mesh.path.resolve() == tmp_path / "part" / "part.gltf"
    page.context.session.save()
    assert load_scene(page.context.session.path).body("part").mesh.digest == body.mesh.digest
