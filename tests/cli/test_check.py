"""`hapscene check` of many: a line each, and an exit code that tells; nothing that not a file is waited for."""

import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh

from hapscene.cli import main
from hapscene.paint.model.document import file_hash
from hapscene.scene.scene import Scene


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((20, 20, 20)).export("meshes/a.ply")
    trimesh.creation.box((0.02, 0.02, 0.02)).export("meshes/b.glb")
    (tmp_path / "meshes" / "readme.txt").write_text("not a mesh")
    return tmp_path


@pytest.fixture
def unhung() -> Iterator[None]:
    """What waits for ever fails."""

    def fail(*of: object) -> None:
        pytest.fail("it waits")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def test_a_folder_has_a_line_for_each_mesh(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "meshes", "--unit", "mm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "meshes/a.ply: ok"
    assert lines[1] == "meshes/b.glb: ok"
    assert lines[2:] == ["2 meshes: 2 ok"]


def test_exit_code(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turned = trimesh.creation.box((20, 20, 20))
    turned.invert()
    turned.export("meshes/c.ply")
    assert main(["check", "meshes/a.ply", "meshes/c.ply", "--unit", "mm"]) == 1
    assert "c.ply: has faults: 12 faces in closed shells" in capsys.readouterr().out
    assert main(["check", "meshes/c.ply", "--unit", "mm"]) == 1
    (folder / "meshes" / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    (folder / "meshes" / "d\x1b[31m.stl").write_bytes(b"solid")
    assert main(["check", "meshes", "--unit", "mm"]) == 2
    output = capsys.readouterr().out
    assert "flat.obj: cannot be touched: " in output and "d\\x1b[31m.stl: cannot be loaded: truncated" in output
    assert "\x1b" not in output
    assert output.splitlines()[-1].endswith("1 has faults, 1 cannot be touched, 1 cannot be loaded")


def test_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "meshes", "--json"]) == 2
    ply, glb = json.loads(capsys.readouterr().out)
    assert ply["verdict"] == "cannot be loaded" and "unit" in ply["error"]
    assert glb["verdict"] == "ok" and glb["face_count"] == 12


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("name", ["x.stl", "x.scene.json"])
@pytest.mark.parametrize("words", [["check"], ["touch"]])
def test_pipes_are_refused(
    folder: Path, name: str, words: list[str], unhung: None, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(name)
    assert main([*words, name]) == 2
    assert capsys.readouterr().err.startswith(f"hapscene: {name}: ")
    assert main(["check", "meshes/a.ply", name, "--unit", "mm"]) == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_pipes_beside_a_scene_are_ignored(folder: Path, unhung: None) -> None:
    scene = Scene()
    scene.add("meshes/a.ply", unit="mm")
    os.mkfifo("other.scene.json")
    os.mkfifo("x.a.0123abcd.ply")
    (folder / "x.scene.json").write_text("x.a.0123abcd.ply")
    scene.save("x.scene.json")
    os.mkfifo("y.scene.json")
    scene.save("y.scene.json")
    with pytest.raises(Exception, match=r"other\.scene\.json: cannot be read"):
        file_hash(Path("other.scene.json"))


def test_a_broken_link(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("meshes/gone.glb").symlink_to("nowhere")
    assert main(["check", "meshes/gone.glb"]) == 2
    assert capsys.readouterr().err == "hapscene: meshes/gone.glb: no such file\n"


def test_a_missing_file_among_others(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["meshes/b.glb", "meshes/none.glb", "nowhere/none.stl", "meshes/a.ply"]
    assert main(["check", *words, "--unit", "mm"]) == 2
    assert capsys.readouterr().out.splitlines() == [
        "meshes/b.glb: ok",
        "meshes/none.glb: cannot be loaded: no such file",
        "nowhere/none.stl: cannot be loaded: no such file",
        "meshes/a.ply: ok",
        "4 meshes: 2 ok, 2 cannot be loaded",
    ]


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_an_undecodable_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("meshes/c\udcff.stl").write_bytes(b"solid")
    assert main(["check", "meshes", "--unit", "mm"]) == 2
    assert capsys.readouterr().out.count("c\\udcff.stl: ") == 1
