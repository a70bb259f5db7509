"""`hapscene convert`."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from hapscene.cli import main
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene, load_scene


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))
    scene = Scene()
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) / 10
    scene.add(Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)), name="tetra")
    scene.paint("tetra", "wood", [1, 2])
    scene.save(tmp_path / "desk.scene.json")
    return tmp_path / "desk.scene.json"


def test_round_trip(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, back = desk.with_name("desk.glb"), desk.with_name("back.scene.json")
    assert main(["convert", str(desk), str(file)]) == 0
    output = capsys.readouterr().out
    assert str(file) in output and "not read again from this format" in output
    assert main(["convert", str(file), str(back)]) == 0
    (was,), (now,) = load_scene(desk).bodies, load_scene(back).bodies
    assert now.name == "tetra" and now.face_swatch.sum() == was.face_swatch.sum() == 2
    assert json.loads(back.read_text())["swatches"] == ["plain", "wood"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["SCENE", "desk.fbx"], "'.fbx'"),
        (["SCENE", "desk.glb", "--unit", "mm"], "--unit"),
        (["none.scene.json", "desk.glb"], "none.scene.json"),
        (["none.glb", "desk.scene.json"], "no such file"),
        (["SCENE", "other.scene.json"], "already a scene"),
    ],
)
def test_errors_are_one_line(
    arguments: list[str], message: str, desk: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(desk.parent)
    before = sorted(desk.parent.iterdir())
    assert main(["convert", *(str(desk) if word == "SCENE" else word for word in arguments)]) == 2
    output = capsys.readouterr().err
    assert message in output and output.count("\n") == 1
    assert sorted(desk.parent.iterdir()) == before


def test_replace(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (desk.with_name("desk.mtl")).write_text("theirs")
    glb = desk.with_name("desk.glb")
    for words in ([str(desk), str(desk.with_name("desk.obj"))], [str(glb), str(desk)]):
        if words[0] == str(glb):
            assert main(["convert", str(desk), str(glb)]) == 0
            capsys.readouterr()
        before = {file: file.read_bytes() for file in desk.parent.iterdir() if file.is_file()}
        assert main(["convert", *words]) == 2
        output = capsys.readouterr().err
        assert "desk." in output and output.count("\n") == 1
        assert {file: file.read_bytes() for file in desk.parent.iterdir() if file.is_file()} == before
        assert main(["convert", *words, "--replace"]) == 0
    assert desk.with_name("desk.mtl").read_text().startswith("newmtl")


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply"])
def test_interrupted_export_leaves_no_file(
    suffix: str, desk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(path: Path, mode: int) -> None:  # of the complete temporary file
        os.kill(os.getpid(), signal.SIGINT)

    before = sorted(desk.parent.iterdir())
    monkeypatch.setattr(Path, "chmod", interrupt)
    assert main(["convert", str(desk), str(desk.with_name(f"desk.{suffix}"))]) == 130
    assert capsys.readouterr().err.count("\n") == 1 and sorted(desk.parent.iterdir()) == before


@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_exported_file_states_its_unit(suffix: str, desk: Path) -> None:
    file, back = desk.with_name(f"desk.{suffix}"), desk.with_name("back.scene.json")
    assert main(["convert", str(desk), str(file)]) == 0
    assert main(["convert", str(file), str(back)]) == 0
    (was,), (now,) = load_scene(desk).bodies, load_scene(back).bodies
    np.testing.assert_array_equal(now.mesh.bounds_m, was.mesh.bounds_m)
