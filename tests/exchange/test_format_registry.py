"""Export formats by name and suffix, and invalid targets."""

from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.errors import SaveConflict, SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.exchange.format_registry import EXPORTS, _in_library, is_mesh_of
from hapscene.scene.ply import save_mesh
from hapscene.scene.scene import Scene
from hapscene.swatches.library import load_swatch


@pytest.mark.parametrize("name", EXPORTS)
def test_suffix_chooses_the_format(name: str, scene: Scene, tmp_path: Path) -> None:
    file = tmp_path / f"desk.{name.upper()}"
    made = export_scene(scene, file)
    assert made[0] == file and all(f.stat().st_size for f in made)
    assert sorted(tmp_path.iterdir()) == sorted(made)  # nothing else stays


@pytest.mark.parametrize(
    ("path", "says"), [("desk.fbx", "'.fbx'"), ("desk", "''"), ("nowhere/desk.glb", "nowhere does not exist")]
)
def test_invalid_path_raises(path: str, says: str, scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=says):
        export_scene(scene, tmp_path / path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "there"), [(name, f"desk.{name}") for name in EXPORTS] + [("obj", "desk.mtl")])
def test_existing_file_is_replaced_on_request(name: str, there: str, scene: Scene, tmp_path: Path) -> None:
    file = tmp_path / f"desk.{name}"
    (tmp_path / there).write_text("theirs")
    with pytest.raises(SaveConflict, match=there):
        export_scene(scene, file)
    assert (tmp_path / there).read_text() == "theirs" and len(list(tmp_path.iterdir())) == 1
    assert tmp_path / there in export_scene(scene, file, replace=True)
    assert (tmp_path / there).read_bytes() != b"theirs"


def test_mesh_of_the_scene_is_not_replaced(scene: Scene, tmp_path: Path) -> None:
    mesh, same = tmp_path / "ball.ply", tmp_path / "link.ply"
    save_mesh(scene.bodies[0].mesh, mesh)
    same.symlink_to(mesh)
    before = mesh.read_bytes()
    made = Scene()
    made.add(mesh, unit="m")
    for file in (mesh, same, tmp_path / "cup.body.0123abcd.ply"):
        assert is_mesh_of(made, file)
        with pytest.raises(SceneError, match="mesh"):
            export_scene(made, file, replace=True)
    assert mesh.read_bytes() == before and len(list(tmp_path.iterdir())) == 2
    assert not is_mesh_of(made, tmp_path / "other.ply")
    mesh.unlink()
    (tmp_path / "other.ply").touch()
    assert not is_mesh_of(made, mesh) and not is_mesh_of(made, tmp_path / "other.ply")


def test_a_swatch_of_the_library_is_known_by_all_its_numbers() -> None:
    wood = load_swatch("wood")
    swatches = (wood, replace(wood, stiffness_N_m=1.0), replace(wood, name="unknown"))
    assert [_in_library(swatch) for swatch in swatches] == [True, False, False]


@pytest.mark.parametrize("content", [None, b""])
def test_missing_and_empty_files_raise(content: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "desk.glb"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SceneError, match=file.name):
        import_scene(file)


def test_empty_scene_raises(tmp_path: Path) -> None:
    with pytest.raises(SceneError):
        export_scene(Scene(), tmp_path / "desk.glb")
