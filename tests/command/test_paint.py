"""`hapscene paint` as a process, and what it opens."""

import argparse
import json
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
import trimesh

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.cli import main
from hapscene.command.paint import DEMO, _copy_demo, open_session
from hapscene.errors import HapsceneError


def options(scene: str | None = None, **given: object) -> argparse.Namespace:
    return argparse.Namespace(
        **{"scene": scene, "unit": None, "swatch": None, "two_sided": False, "device": "omni", **given}
    )


def quiet(text: str) -> None:
    """Says nothing."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "cube.ply")
    return tmp_path


def test_a_mesh_becomes_a_scene_beside_no_other(folder: Path) -> None:
    session = open_session(options("cube.ply", unit="m", swatch="wood", device="premium-1.5"), quiet)
    assert session.path == Path("cube.scene.json") and session.device == "premium-1.5"
    assert session.scene.swatches[1].name == "wood" and (session.scene.bodies[0].face_swatch == 1).all()
    session.save()
    assert open_session(options("cube.ply", unit="m"), quiet).path == Path("cube_2.scene.json")
    again = open_session(options("cube.scene.json"), quiet)
    assert again.scene.swatches[1].name == "wood"


def test_without_a_name_a_copy_of_the_demo_is_painted(folder: Path) -> None:
    session = open_session(options(), quiet)
    assert session.path == Path("hapscene-demo/demo.scene.json")
    session.path.write_text(session.path.read_text(encoding="utf-8") + " ", encoding="utf-8")
    before = session.path.read_bytes()
    assert _copy_demo(DEMO) == session.path and session.path.read_bytes() == before  # not copied over
    meshes = json.loads(session.path.read_text(encoding="utf-8"))["meshes"]
    assert all(mesh["path"].startswith("meshes/") for mesh in meshes)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.scene.json"], "none.scene.json"),
        (["cube.ply"], "unit"),
        (["cube.ply", "--unit", "m", "--device", "ideal"], "no mass to move"),
        (["cube.ply", "--unit", "m", "--device", "omi"], "no device 'omi'"),
        (["made.scene.json", "--unit", "m"], "leave --unit out"),
    ],
)
def test_what_cannot_be_painted_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    open_session(options("cube.ply", unit="m"), quiet).save(folder / "made.scene.json")
    assert main(["paint", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_device_that_is_none_is_refused(folder: Path) -> None:
    with pytest.raises(HapsceneError, match="no mass to move"):
        open_session(options("cube.ply", unit="m", device="ideal"), quiet)


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is no signal there")
def test_it_serves_until_ctrl_c_and_leaves_nothing_behind(folder: Path) -> None:
    command = [sys.executable, "-m", "hapscene.cli", "paint", "cube.ply", "--unit", "m", "--port", "0", "--no-browser"]
    process = subprocess.Popen([*command, "--no-hand"], stdout=subprocess.PIPE, text=True, cwd=folder)
    assert process.stdout is not None
    line = ""
    end_s = time.monotonic() + 120.0
    while "http://127.0.0.1:" not in line:
        line = process.stdout.readline()
        assert line and time.monotonic() < end_s
    with urllib.request.urlopen(line.split()[0], timeout=60.0) as answer:
        assert b"/hapscene.js" in answer.read()
    process.send_signal(signal.SIGINT)
    assert process.wait(60.0) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["cube.ply"]
