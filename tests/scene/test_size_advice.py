"""Advice on the size of meshes and scenes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.cli.inputs import load_input, print_size_advice
from hapscene.cli.options import MeshOptions
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene
from hapscene.scene.size_advice import dimensions, size_advice

WIDE = trimesh.creation.box((0.16, 0.15, 0.12))


@pytest.fixture
def wide(tmp_path: Path) -> Path:
    WIDE.export(tmp_path / "wide.stl")
    return tmp_path / "wide.stl"


@pytest.mark.parametrize(
    ("unit", "scale", "option"),
    [("mm", 1000.0, "--unit m"), ("ft", None, ""), ("m", None, ""), ("cm", 100.0, "--unit m")],
)
def test_wrong_unit(wide: Path, unit: str, scale: float | None, option: str) -> None:
    found = size_advice(load_mesh(wide, unit))
    assert found.scale == pytest.approx(scale) and option in found.words
    if option:
        assert size_advice(load_mesh(wide, option.split()[1])).words == ""


def test_scene_larger_than_the_workspace() -> None:
    scene = Scene()
    assert size_advice(scene).words == ""
    for x in (0.0, 0.7):
        scene.add(WIDE, unit="m", pose=[[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    found = size_advice(scene)
    assert "860 × 150 × 120 mm" in found.words and "omni" in found.words
    assert found.scale == 0.1 and "--" not in found.words
    assert size_advice(scene, "premium-1.5").words == size_advice(scene, "another device").words == ""


def test_dimensions_have_the_unit_of_the_largest() -> None:
    sizes_m = (2.0, 0.5, 0.01234), (0.0, 1e-3, 5e-4), (9e-4, 1e-5, 0.0)
    found = [dimensions(np.array(size_m)) for size_m in sizes_m]
    assert found == ["2 × 0.5 × 0.0123 m", "0 × 1 × 0.5 mm", "900 × 10 × 0 µm"]


def test_commands_print_advice_once(wide: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    load_input(str(wide), MeshOptions(unit="m"))
    assert len(capsys.readouterr().out.splitlines()) == 1  # the progress message
    scene = load_input(str(wide), MeshOptions(unit="mm"))
    assert capsys.readouterr().out.count("with --unit m it is") == 1
    scene.save(tmp_path / "wide.scene.json")
    load_input(str(tmp_path / "wide.scene.json"), MeshOptions())
    printed = capsys.readouterr().out
    assert "the scene is 160 × 150 × 120 µm" in printed and "--" not in printed  # options that scene files do not have
    (tmp_path / "speck.stl").write_bytes(wide.read_bytes())
    both = Scene()
    both.add(wide, unit="m")
    both.add(tmp_path / "speck.stl", unit="mm")
    print_size_advice(both, str(wide))
    assert capsys.readouterr().out.startswith("speck.stl is 160 × 150 × 120 µm")
