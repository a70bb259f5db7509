"""A scene in one file: whole, from any computer, and safe from strangers."""

import json
import stat
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import icosphere

import hapscene
from hapscene.errors import HapsceneError, SceneError
from hapscene.scene import scene_bundle
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_bundle import save_bundle, unpack_bundle, unpacked_beside

FOREIGN = Path(__file__).parents[3] / "shared/data/meshes"


def make_scene(folder: Path) -> Scene:
    """A textured mesh of three files, a mesh in memory, and a swatch without a file."""
    home = folder / "somewhere else"
    home.mkdir()
    with zipfile.ZipFile(FOREIGN / "fuze.zip") as archive:
        archive.extractall(home)
    scene = Scene()
    scene.add(home / "fuze.obj", name="fuze", unit="cm", swatch="wood")
    scene.add(scene.bodies[0].mesh, name="twin")
    scene.add(Mesh.from_trimesh(icosphere(subdivisions=2, radius=0.02), "m"), name="ball")
    own = replace(hapscene.load_swatch("wood"), name="mine", stiffness_N_m=123.0)
    scene.paint("ball", own, Sphere((0.02, 0.0, 0.0), 0.01))
    return scene


needs_foreign = pytest.mark.skipif(not (FOREIGN / "fuze.zip").exists(), reason="the foreign meshes are not here")


@needs_foreign
def test_roundtrip(tmp_path: Path) -> None:
    scene = make_scene(tmp_path)
    save_bundle(scene, tmp_path / "all.scene.zip")
    for file in (tmp_path / "somewhere else").iterdir():
        file.unlink()  # the bundle needs no other files
    unpacked = unpack_bundle(tmp_path / "all.scene.zip", tmp_path / "there")
    assert unpacked == tmp_path / "there" / "all.scene.json"
    for loaded in (load_scene(tmp_path / "all.scene.zip"), load_scene(unpacked)):
        for body, again in zip(scene.bodies, loaded.bodies, strict=True):
            assert again.mesh.digest == body.mesh.digest and np.array_equal(again.face_swatch, body.face_swatch)
            assert (again.fine is None) == (body.fine is None)
        assert loaded.bodies[0].mesh is loaded.bodies[1].mesh
        assert loaded.swatches[-1].stiffness_N_m == 123.0
        assert loaded.bodies[0].mesh.uv is not None and loaded.bodies[0].mesh.colour_rgb is not None
        assert len(np.unique(loaded.bodies[0].mesh.colour_rgb, axis=0)) > 50  # with its texture
    load_scene(tmp_path / "all.scene.zip").save(tmp_path / "anew.scene.json")
    assert load_scene(tmp_path / "anew.scene.json").bodies[2].fine is not None


def packed(path: Path, **members: str) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def scene_text(mesh: str = "ball.stl", swatch: str = "plain") -> str:
    return json.dumps({"format": "hapscene scene", "version": 1, "swatches": [swatch], "meshes": [{"path": mesh}]})


@pytest.mark.parametrize(
    "members",
    [
        {"../evil.scene.json": "{}"},
        {".ssh/config": "x", "a.scene.json": scene_text()},
        {"a.scene.json": scene_text(), "A.SCENE.json": scene_text()},
        {"a.scene.json": scene_text(), "b.scene.json": scene_text()},
        {"a.scene.json": "{"},
        {"a.scene.json": scene_text(), "ball.stl": "", "Ball.STL": ""},
        {"a.scene.json": scene_text("/etc/passwd"), "ball.stl": ""},
        {"a.scene.json": scene_text(swatch="../x.swatch"), "ball.stl": ""},
    ],
)
def test_invalid_bundle_raises_and_writes_nothing(members: dict[str, str], tmp_path: Path) -> None:
    file = packed(tmp_path / "evil.scene.zip", **members)
    before = sorted(tmp_path.rglob("*"))
    for read in (lambda: unpack_bundle(file, tmp_path / "there"), lambda: load_scene(file)):
        with pytest.raises(SceneError) as caught:
            read()
        assert str(caught.value).startswith(str(file)) and "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


def test_link_bomb_and_other_files_raise(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("ball.stl")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "link.scene.zip", "w") as archive:
        archive.writestr("a.scene.json", scene_text())
        archive.writestr(link, "/etc/passwd")
    with zipfile.ZipFile(tmp_path / "bomb.scene.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.scene.json", scene_text())
        archive.writestr("ball.stl", bytes(50_000_000))
    (tmp_path / "text.scene.zip").write_text("no archive")
    whole = packed(tmp_path / "whole.scene.zip", **{"a.scene.json": scene_text(), "ball.stl": "x" * 1000}).read_bytes()
    (tmp_path / "damaged.scene.zip").write_bytes(whole.replace(b"x" * 1000, b"x" * 999 + b"y"))
    for name in ("link", "bomb", "text", "damaged", "gone"):
        with pytest.raises(HapsceneError, match=name):
            unpack_bundle(tmp_path / f"{name}.scene.zip", tmp_path / "there")
        assert not (tmp_path / "there").exists()


def test_scene_file_that_needs_too_much_memory_is_not_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "big.scene.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("big.scene.json", '{"meshes": [], "swatches": [' + "[]," * 4_000_000 + "[]]}")
        archive.writestr("pad.bin", np.random.default_rng(1).bytes(200_000))
    monkeypatch.setattr(json, "loads", lambda text: pytest.fail("it was parsed"))
    with pytest.raises(SceneError):
        load_scene(tmp_path / "big.scene.zip")


def test_existing_folder_and_other_suffix_raise(tmp_path: Path) -> None:
    scene = Scene()
    scene.add(Mesh.from_trimesh(icosphere(subdivisions=1), "m"))
    with pytest.raises(SceneError):
        save_bundle(scene, tmp_path / "all.zip")
    save_bundle(scene, tmp_path / "all.scene.zip")
    (tmp_path / "there").mkdir()
    with pytest.raises(SceneError):
        unpack_bundle(tmp_path / "all.scene.zip", tmp_path / "there")
    assert not list((tmp_path / "there").iterdir())


def test_a_bundle_is_unpacked_beside_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene()
    scene.add(Mesh.from_trimesh(icosphere(subdivisions=1), "m"), swatch="wood")
    save_bundle(scene, tmp_path / "all.scene.zip")
    monkeypatch.chdir(tmp_path)
    for folder in ("all", "all_2", "all_3"):
        assert unpacked_beside(Path("all.scene.zip")) == Path(folder, "all.scene.json")
        assert [file.name for file in (tmp_path / folder).glob("*.swatch")] == []  # one that is shipped needs no file
        assert load_scene(Path(folder, "all.scene.json")).swatches[1].name == "wood"


def test_too_large_scene_file_raises(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_bundle, "BYTES_MAX", 1000)
    file = packed(tmp_path / "large.scene.zip", **{"a.scene.json": scene_text() + " " * 1000, "ball.stl": "x"})
    with pytest.raises(SceneError):
        unpack_bundle(file, tmp_path / "there")
