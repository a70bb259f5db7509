"""The tab Bodies and other scenes on the same page, as a browser orders them, and as anybody might."""

import asyncio
import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest
import trimesh

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.errors import HapsceneError, SceneError
from hapscene.paint.document import autosave_folder
from hapscene.paint.recent import note_scene, recent_file, recent_scenes
from hapscene.paint.session import Session
from hapscene.paint.web.body_panel import BodyPanel
from hapscene.paint.web.page import Page
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene, load_scene

from ..tab import Tab

pytestmark = pytest.mark.nightly


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
    assert 'aria-selected="true"' in html_of(tab, 'role="tree"') and 'value="ball"' in html_of(tab, "Hangs on")
    act(tab, "place x", "ball", "123,5")
    assert session.scene.body("ball").X_WB[0, 3] == pytest.approx(0.1235)
    act(tab, "turn z", "plate", "30")
    act(tab, "turn z", "plate", "90")
    act(tab, "size x", "plate", "80")
    assert np.ptp(session.scene.body("plate").mesh.bounds_m, axis=0)[0] == pytest.approx(0.08)
    act(tab, "scale", "plate", "1")
    assert np.ptp(session.scene.body("plate").mesh.bounds_m, axis=0)[0] == pytest.approx(0.04)
    act(tab, "parent", "plate", "ball")
    act(tab, "name", "plate", "lid")
    act(tab, "shape", "", "cylinder")
    assert [(b.name, b.parent) for b in session.scene.bodies] == [("ball", None), ("lid", "ball"), ("cylinder", None)]
    frames = [name for name in tab.nodes if name.startswith("/body/") and name.count("/") == 2]
    assert len(frames) == 3 and "/handles" in tab.nodes
    act(tab, "isolate", "cylinder")
    assert session.painting.hidden == {"ball", "lid"}
    act(tab, "delete", "cylinder")
    act(tab, "isolate", "lid")
    assert not session.painting.hidden
    while session.painting.undo_text:
        session.undo()
    tab.send("hover")
    tab.settle()
    assert [b.name for b in session.scene.bodies] == ["ball", "plate"]


@pytest.mark.parametrize(
    ("what", "body", "value", "said"),
    [
        ("place x", "ball", "1e999", "is no number"),
        ("place x", "ball", "1_0", "is no number"),
        ("place x", "ball", "", "is no number"),
        ("place x", "bal", "1", "no body 'bal'"),
        ("scale", "ball", "0", "a scale is above 0"),
        ("size z", "ball", "-3", "a scale is above 0"),
        ("scale", "ball", "1e8", "a scale is above 0"),
        ("parent", "ball", "ball", "cannot hang on"),
        ("parent", "ball", "x", "no body 'x'"),
        ("name", "ball", "plate", "names are unique"),
        ("name", "ball", "", "printable"),
        ("up", "ball", "x", "up is y or z"),
        ("shape", "", "torus", "no shape 'torus'"),
        ("copy", "", "", "no body ''"),
    ],
)
def test_what_a_field_cannot_be_is_one_sentence(
    page: Page, tab: Tab, what: str, body: str, value: str, said: str
) -> None:
    before = page.context.session.painting.state
    act(tab, what, body, value)
    told = [text for text in tab.said if said in text]
    assert len(told) == 1 and "\n" not in told[0] and page.context.session.painting.state == before


def test_what_is_no_act_does_nothing(page: Page, tab: Tab) -> None:
    before = page.context.session.painting.state
    for message in ({"act": "_tree_html"}, {"act": {}}, {"act": "choose", "body": ["ball"]}, {"act": None}):
        tab.send("body", **message)
    tab.settle()
    assert page.context.session.painting.state == before


def test_a_name_is_no_html(page: Page, tab: Tab) -> None:
    act(tab, "name", "ball", '"><img src=x onerror=alert(1)>')
    act(tab, "choose", '"><img src=x onerror=alert(1)>')
    content = html_of(tab, "Hangs on") + html_of(tab, 'role="tree"')
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
    with pytest.raises(HapsceneError, match="goes with a mesh"):
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
    assert body.name == "part" and body.mesh.path == tmp_path / "part" / "part.gltf"
    page.context.session.save()
    assert load_scene(page.context.session.path).body("part").mesh.digest == body.mesh.digest


def test_another_scene_comes_in_the_place_of_this_one_whose_work_is_kept(page: Page, tab: Tab, tmp_path: Path) -> None:
    first = page.context.session
    first.fill_body("plate", 0)
    tab.set("New scene", True)
    tab.wait(lambda: page.context.session is not first)
    second = page.context.session
    assert second.path == tmp_path / "untitled.scene.json" and [b.name for b in second.scene.bodies] == ["plate"]
    tab.wait(lambda: any("made.scene.json is kept" in said for said in tab.said))
    tab.settle()
    assert tab.state["title"] == "untitled.scene.json"
    assert sum(name.startswith("/body/") and name.count("/") == 2 for name in tab.nodes) == 1
    tab.send("save")
    tab.wait(lambda: not second.dirty)

    tab.set("Other file", str(tmp_path / "made"))
    tab.set("Open", True)
    tab.wait(lambda: page.context.session.path == tmp_path / "made.scene.json")
    tab.control("Recover it")
    assert recent_scenes() == [tmp_path / "made.scene.json", tmp_path / "untitled.scene.json"]
    tab.set("Recover it", True)
    tab.wait(lambda: (page.context.session.scene.body("plate").face_swatch == 0).all())
    here = page.context.session
    tab.set("Other file", "nowhere")
    tab.set("Open", True)
    tab.wait(lambda: any("nowhere.scene.json" in said for said in tab.said))
    assert page.context.session is here


def test_a_scene_that_another_painter_has_stays_there(page: Page, tab: Tab, tmp_path: Path) -> None:
    other = Session.open(tmp_path / "made.scene.json")
    other.save(tmp_path / "other.scene.json")
    other.document.start_autosave(60.0)
    here = page.context.session
    tab.set("Other file", str(tmp_path / "other.scene.json"))
    tab.set("Open", True)
    tab.wait(lambda: any("is open in another painter" in said for said in tab.said))
    assert page.context.session is here and here.document.autosave is not None
    other.document.close()


def test_a_scene_whose_copy_cannot_be_recovered_is_not_held(page: Page, tab: Tab, tmp_path: Path) -> None:
    killed = Session.open(tmp_path / "made.scene.json")
    path = killed.save(tmp_path / "other.scene.json")
    left = autosave_folder(path) / "left"
    left.mkdir(parents=True)
    (left / path.name).write_text("damaged")
    here = page.context.session
    opening = page.show_session(Session.open(path), recover=True)
    with pytest.raises(HapsceneError):
        asyncio.run_coroutine_threadsafe(opening, page.server.get_event_loop()).result(60.0)
    assert page.context.session is here
    again = Session.open(path)
    again.document.start_autosave()  # nobody else is at it
    assert again.document.recovery() is not None
    again.document.close()


def test_a_picture_holds_nobody_up_and_paints_over_nothing_newer(
    page: Page, tab: Tab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, scene = page.context.session, Scene()
    corners = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]])
    scene.add(Mesh(corners, np.array([[0, 1, 2]]), uv=corners[None, :, :2]), name="sheet")
    session.composing.add(scene)
    painters: list[threading.Thread] = []

    def slow(*arguments: object) -> None:
        painters.append(threading.Thread(target=session.fill_body, args=("plate", 0), daemon=True))
        painters[0].start()
        painters[0].join(120.0)
        assert not painters[0].is_alive(), "a picture holds the scene while it is read"

    monkeypatch.setattr("hapscene.paint.web.picture_panel.paint_by_picture", slow)
    taking = page._picture_panel.take([tmp_path / "sheet.png"])
    with pytest.raises(SceneError, match="changed meanwhile"):
        asyncio.run_coroutine_threadsafe(taking, page.server.get_event_loop()).result(60.0)
    assert (session.scene.body("plate").face_swatch == 0).all()


def test_recent_scenes_are_those_that_are_there(tmp_path: Path) -> None:
    paths = [tmp_path / f"{i}.scene.json" for i in range(20)]
    for path in paths:
        path.write_text("{}")
        note_scene(path)
    assert recent_scenes() == paths[:7:-1]
    paths[-1].unlink()
    assert recent_scenes()[0] == paths[-2]
    for damaged in ("", "{}", "[1, {}]", "[" * 9_999):
        recent_file().write_text(damaged)
        assert recent_scenes() == []
    note_scene(paths[3])
    assert json.loads(recent_file().read_text()) == [os.fspath(paths[3])]


def test_a_mesh_that_is_read_while_another_scene_is_opened_is_told_of(
    page: Page, tab: Tab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hapscene import touch

    begun, goes_on, read = threading.Event(), threading.Event(), touch.open_scene

    def slow(*arguments: object) -> Scene:
        begun.set()
        assert goes_on.wait(120.0)
        return read(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(touch, "open_scene", slow)
    (tmp_path / "dropped").mkdir()
    trimesh.creation.box((0.05, 0.05, 0.05)).export(tmp_path / "dropped" / "cube.glb")
    loop, old = page.server.get_event_loop(), page.context.session
    taken = asyncio.run_coroutine_threadsafe(page._take([tmp_path / "dropped" / "cube.glb"]), loop)
    assert begun.wait(120.0)
    asyncio.run_coroutine_threadsafe(page._scene_panel.new(), loop).result(120.0)
    goes_on.set()
    with pytest.raises(HapsceneError, match=r"cube\.glb: not added, as another scene was opened meanwhile"):
        taken.result(120.0)
    assert [body.name for body in page.context.session.scene.bodies] == ["plate"]
    assert len(old.scene.bodies) == 2 and not (tmp_path / "cube.glb").exists()
