"""Vertical axis and scale of mesh files."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.cli.inputs import load_input
from hapscene.cli.options import MeshOptions
from hapscene.errors import HapsceneError, MeshError, SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene, load_scene

TALL = trimesh.creation.box((0.02, 0.05, 0.03))  # its height is along y in the file
STANDING = [0.02, 0.03, 0.05]


def size_of(mesh: Mesh) -> list[float]:
    return np.round(mesh.bounds_m[1] - mesh.bounds_m[0], 7).tolist()


@pytest.mark.parametrize("suffix", ["glb", "stl"])
def test_y_up_is_rotated(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"tall.{suffix}"
    marked = TALL.copy()
    marked.apply_translation((0.0, 0.1, 0.0))  # above the origin
    marked.export(file)
    by_format, standing, lying = (load_mesh(file, "m", up=up) for up in (None, "y", "z"))
    assert size_of(standing) == STANDING
    assert standing.bounds_m[0, 2] == pytest.approx(0.075) and standing.bounds_m[0, 1] == pytest.approx(-0.015)
    assert size_of(lying) == [0.02, 0.05, 0.03]
    assert by_format.up == ("y" if suffix in ("glb", "gltf") else "z")
    assert by_format.digest == (standing if by_format.up == "y" else lying).digest
    assert edges_outward(standing)


def edges_outward(mesh: Mesh) -> bool:
    middle = mesh.bounds_m.mean(axis=0)
    return bool((np.einsum("ij,ij->i", mesh.normals, mesh.triangles_m.mean(axis=1) - middle) > 0.0).all())


def test_scale_is_applied_after_the_unit(tmp_path: Path) -> None:
    TALL.export(tmp_path / "tall.stl")
    assert size_of(load_mesh(tmp_path / "tall.stl", "cm", scale=50.0)) == [0.01, 0.025, 0.015]
    assert size_of(Mesh.from_trimesh(TALL, "m", up="y", scale=2.0)) == [0.04, 0.06, 0.1]


def test_scene_file_stores_up_and_scale(tmp_path: Path) -> None:
    TALL.export(tmp_path / "tall.glb")
    scene = Scene()
    scene.add(tmp_path / "tall.glb", name="as it is")
    scene.add(tmp_path / "tall.glb", name="lying, half", up="z", scale=0.5)
    scene.save(tmp_path / "two.scene.json")
    content = json.loads((tmp_path / "two.scene.json").read_text())
    assert content["version"] == 3 and content["meshes"][1]["scale"] == 0.5
    back = load_scene(tmp_path / "two.scene.json")
    assert [size_of(body.mesh) for body in back.bodies] == [STANDING, [0.01, 0.025, 0.015]]


def test_old_scene_files_do_not_rotate_gltf(tmp_path: Path) -> None:
    TALL.export(tmp_path / "tall.glb")
    scene = Scene()
    scene.add(tmp_path / "tall.glb", up="z")  # as before version 3
    scene.save(tmp_path / "old.scene.json")
    content = json.loads((tmp_path / "old.scene.json").read_text())
    assert content["version"] == 1 and set(content["meshes"][0]) == {"path", "unit", "sha256", "face_count"}
    assert size_of(load_scene(tmp_path / "old.scene.json").bodies[0].mesh) == [0.02, 0.05, 0.03]


@pytest.mark.parametrize("given", [{"up": "x"}, *({"scale": bad} for bad in (0.0, np.nan, np.inf, True, 10**400, "2"))])
def test_invalid_up_or_scale_raises(given: dict, tmp_path: Path) -> None:
    TALL.export(tmp_path / "tall.stl")
    with pytest.raises(MeshError):
        load_mesh(tmp_path / "tall.stl", "m", **given)
    scene = Scene()
    scene.add(tmp_path / "tall.stl", unit="m")
    scene.save(tmp_path / "a.scene.json")
    content = json.loads((tmp_path / "a.scene.json").read_text())
    content["meshes"][0] |= {"up": ["y"]} if "up" in given else given
    (tmp_path / "a.scene.json").write_text(json.dumps(content))
    with pytest.raises(SceneError, match=r"meshes\[0\]"):
        load_scene(tmp_path / "a.scene.json")


def test_up_and_scale_are_rejected_for_scenes(tmp_path: Path) -> None:
    scene = Scene()
    scene.add(TALL, unit="m")
    scene.save(tmp_path / "a.scene.json")
    with pytest.raises(MeshError, match="up="):
        scene.add(scene.bodies[0].mesh, up="y")
    with pytest.raises(HapsceneError, match=r"a\.scene\.json"):
        load_input(str(tmp_path / "a.scene.json"), MeshOptions(up="y"))
