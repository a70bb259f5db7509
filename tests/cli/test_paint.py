"""`hapscene paint`."""

import json
import stat
import sys
from contextlib import ExitStack, nullcontext
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import pytest
import trimesh

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.cli import main
from hapscene.cli.paint import _paint_until_ended, lead_browser
from hapscene.errors import SceneError
from hapscene.paint.model.document import describe_scene_file
from hapscene.paint.opening import DEMO, _copy_demo, earlier_scenes, open_session
from hapscene.scene.mesh import MeshWarning
from hapscene.scene.scene_bundle import save_bundle


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "cube.ply")
    return tmp_path


def test_a_mesh_becomes_a_new_scene(folder: Path) -> None:
    session = open_session("cube.ply", unit="m", swatch="wood")
    assert session.path == Path("cube.scene.json")
    assert session.scene.swatches[1].name == "wood" and (session.scene.bodies[0].face_swatch == 1).all()
    session.save()
    assert open_session("cube.ply", unit="m").path == Path("cube_2.scene.json")
    again = open_session("cube.scene.json")
    assert again.scene.swatches[1].name == "wood"


def test_the_browser_is_opened_with_a_private_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command line of the browser does not contain the token."""
    led: SimpleQueue[str] = SimpleQueue()
    monkeypatch.setattr("webbrowser.open", led.put)
    url = "http://127.0.0.1:1/secret/"
    with ExitStack() as ends:
        opener = lead_browser(url, Path(), ends)
        assert opener is not None and url in opener.read_text()
        output = led.get(timeout=60.0)
        assert output == opener.absolute().as_uri() and "secret" not in output
        assert sys.platform == "win32" or stat.S_IMODE(opener.parent.stat().st_mode) == 0o700
        assert lead_browser(url, folder / "cube.ply", ends) is None  # where nothing can be written
    assert not opener.parent.exists() and led.empty()


def test_at_the_end_the_state_of_unsaved_changes_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    touch, page = SimpleNamespace(problem=""), nullcontext[None]()
    for kept, changed, dirty, said in (
        (True, True, True, "kept beside a.scene.json"),
        (False, True, True, "lost: full disk"),
        (False, False, True, "was not written"),
        (False, False, False, "no hand"),
    ):
        session = SimpleNamespace(document=SimpleNamespace(changed=changed, problem="full disk"), dirty=dirty)
        session.path, context = "a.scene.json", SimpleNamespace(session=session, touch=touch)
        vars(page).update(
            url="http://here", network_url="http://10.0.0.1" if kept else None, kept=kept, context=context
        )
        problems = iter(["", "no hand", "no hand", KeyboardInterrupt])

        def sleep(span_s: float, problems: Any = problems) -> None:
            if (problem := next(problems)) is KeyboardInterrupt:
                raise problem
            touch.problem = problem

        monkeypatch.setattr("hapscene.cli.paint.time.sleep", sleep)
        _paint_until_ended(page)  # type: ignore[arg-type]
        address, *lines = capsys.readouterr().out.splitlines()
        assert address.startswith("http://here ") and lines[0] == "full disk" and lines.count("no hand") == 1
        assert len(lines) == 2 + dirty + kept and ("open to the network" in lines[1]) == kept and said in lines[-1]


def test_default_is_a_copy_of_the_demo(folder: Path) -> None:
    session = open_session(None)
    assert session.path == Path("hapscene-demo/demo.scene.json")
    session.path.write_text(session.path.read_text(encoding="utf-8") + " ", encoding="utf-8")
    before = session.path.read_bytes()
    assert _copy_demo(DEMO) == session.path and session.path.read_bytes() == before  # not copied over
    meshes = json.loads(session.path.read_text(encoding="utf-8"))["meshes"]
    assert all(mesh["path"].startswith("meshes/") for mesh in meshes)


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (["none.scene.json"], "none.scene.json"),
        (["cube.ply"], "unit"),
        (["made.scene.json", "--unit", "m"], "--unit"),
    ],
)
def test_invalid_input_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], output: str
) -> None:
    open_session("cube.ply", unit="m").save(folder / "made.scene.json")
    assert main(["paint", *arguments, "--no-browser"]) == 2
    error = capsys.readouterr().err
    assert output in error and error.count("\n") == 1


def test_accept_changed(folder: Path) -> None:
    open_session("cube.ply", unit="m", swatch="wood").save()
    trimesh.creation.box((0.02, 0.02, 0.03)).export("cube.ply")
    with pytest.raises(SceneError, match="--accept-changed"):
        open_session("cube.scene.json")
    with pytest.warns(MeshWarning, match="the paint is kept"):
        session = open_session("cube.scene.json", accept_changed=True)
    assert (session.scene.bodies[0].face_swatch == 1).all()


def test_several_meshes(folder: Path) -> None:
    trimesh.creation.icosphere(radius=0.01).export(folder / "ball.stl")
    session = open_session("cube.ply", unit="m", more=["ball.stl", "cube.ply"])
    assert session.path == Path("cube.scene.json") and session.painting.undo_text is None
    bodies = session.scene.bodies
    assert [body.name for body in bodies] == ["cube", "ball", "cube 2"]
    left_m = [float((b.mesh.vertices_m[:, 0] + b.X_WB[0, 3]).min()) for b in bodies]
    assert left_m[0] < left_m[1] - 0.02 < left_m[2] - 0.04
    session.save()
    assert open_session("cube.scene.json").scene.body("ball").mesh.path == Path("ball.stl")
    again = open_session("cube.scene.json", unit="m", more=["ball.stl"])
    assert again.path == Path("cube.scene.json") and again.dirty
    assert again.scene.bodies[-1].name == "ball 2" and again.undo() == "add 'ball 2'"


def test_earlier_painting_is_offered(folder: Path) -> None:
    assert earlier_scenes(None) == earlier_scenes(Path("cube.scene.json")) == []
    for expected in ("cube", "cube_2", "cube_3"):
        session = open_session("cube.ply", unit="m")
        assert session.path == Path(f"{expected}.scene.json")
        session.save()
    assert earlier_scenes(Path("cube_4.scene.json")) == [Path(f"cube{n}.scene.json") for n in ("", "_2", "_3")]
    assert earlier_scenes(Path("cube_2.scene.json")) == []  # it is there, and opened itself
    assert "cube.scene.json was saved at" in describe_scene_file(Path("cube.scene.json"))
    save_bundle(session.scene, Path("all.scene.zip"))
    for expected, before in (("all", []), ("all_2", ["all"]), ("all_3", ["all", "all_2"])):
        path = open_session("all.scene.zip").path
        assert path == Path(expected, "all.scene.json")
        assert earlier_scenes(path, unpacked=True) == [Path(folder, "all.scene.json") for folder in before]
