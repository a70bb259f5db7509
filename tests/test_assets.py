"""What comes with hapscene is found by name, from any folder."""

from pathlib import Path

import pytest

import hapscene
from hapscene import assets
from hapscene.cli import main
from hapscene.cli.inputs import find_asset
from hapscene.cli.options import MeshOptions
from hapscene.errors import SceneError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the working one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", ["bracket", "demo", "plate", "toad"])
def test_each_is_a_file_that_loads(folder: Path, name: str) -> None:
    assert name in assets.names()
    path, unit = assets.path(name), assets.unit(name)
    assert path.is_absolute()
    bodies = hapscene.load_scene(path).bodies if unit is None else [hapscene.Scene().add(path, unit=unit)]
    assert all(0.03 < body.mesh.diagonal_m < 0.3 for body in bodies)
    assert len(bodies) == (3 if name == "demo" else 1)


@pytest.mark.parametrize("ask", [assets.path, assets.unit])
def test_an_unknown_name_is_refused(ask) -> None:
    with pytest.raises(SceneError, match="taod"):
        ask("taod")


def test_a_file_of_that_name_comes_first_and_a_unit_that_is_given_stays(folder: Path) -> None:
    assert find_asset("toad", MeshOptions()) == (str(assets.path("toad")), MeshOptions(unit="m"))
    assert find_asset("toad", MeshOptions(unit="mm")) == (str(assets.path("toad")), MeshOptions(unit="mm"))
    assert find_asset("demo", MeshOptions()) == (str(assets.path("demo")), MeshOptions())
    for name in ("toad.ply", "meshes/toad"):
        assert find_asset(name, MeshOptions()) == (name, MeshOptions())
    (folder / "toad").touch()
    assert find_asset("toad", MeshOptions()) == ("toad", MeshOptions())


def test_the_demo_is_touched_and_checked_by_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["touch", "demo", "--no-picture", "--effects", "wall"]) == 0
    assert (folder / "out" / "demo" / "touch.npz").exists()
    assert main(["check", "demo"]) == 0
    assert capsys.readouterr().out.count("no defects found") == 3
