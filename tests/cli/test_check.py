"""`hapscene check`: reports and exit codes. Pipes are refused."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh

from hapscene.cli import main
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


def test_exit_code(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "meshes/a.ply", "meshes/b.glb", "--unit", "mm"]) == 0
    assert capsys.readouterr().out.count("no defects found") == 2
    turned = trimesh.creation.box((20, 20, 20))
    turned.invert()
    turned.export("meshes/c.ply")
    assert main(["check", "meshes/a.ply", "meshes/c.ply", "--unit", "mm"]) == 1
    assert "FAULT: 12 faces in closed shells" in capsys.readouterr().out
    (folder / "meshes" / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    assert main(["check", "meshes/flat.obj", "--unit", "mm"]) == 1
    assert "cannot be touched" in capsys.readouterr().out
    assert main(["check", "meshes/a.ply", "meshes/c.ply", "--unit", "mm", "--fix", "mended.ply"]) == 2
    assert main(["check", "meshes/c.ply", "--unit", "mm", "--fix", "mended.ply"]) == 0
    assert main(["check", "mended.ply", "--unit", "m"]) == 0


def test_meshes_of_a_scene(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = Scene()
    for name in ("left", "right"):
        scene.add("meshes/a.ply", name=name, unit="mm")
    scene.save("x.scene.json")
    assert main(["check", "x.scene.json"]) == 0
    assert capsys.readouterr().out.count("no defects found") == 1


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
