"""Exported PLY files, read by trimesh, and invalid files."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError, SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.exchange.swatch_payload.ExchangeWarning")


def test_trimesh_reads_all_properties(scene: Scene, tmp_path: Path) -> None:
    import trimesh

    file = export_scene(scene, tmp_path / "desk.ply")[0]
    loaded = trimesh.load(file, process=False)
    at = 0
    for i, body in enumerate(scene.bodies):
        count = len(body.mesh.faces)
        raw = loaded.metadata["_ply_raw"]["face"]["data"][at : at + count]
        assert (raw["body"] == i).all() and np.array_equal(raw["swatch"].ravel(), body.face_swatch)
        p_W = body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]
        assert np.array_equal(loaded.vertices[loaded.faces[at : at + count]], p_W[body.mesh.faces])
        albedo = np.array([swatch.albedo_rgb for swatch in scene.swatches])[body.face_swatch]
        assert np.abs(loaded.visual.face_colors[at : at + count, :3] / 255 - albedo).max() <= 0.5 / 255 + 1e-9
        at += count
    assert len(load_mesh(file, "m").faces) == at


def test_other_ply_is_a_mesh(scene: Scene, tmp_path: Path) -> None:
    from hapscene.scene.ply import save_mesh

    save_mesh(scene.bodies[0].mesh, tmp_path / "ball.ply")
    back = import_scene(tmp_path / "ball.ply", "m")
    assert [body.name for body in back.bodies] == ["ball"] and not back.bodies[0].face_swatch.any()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"hapscene scene 1", b"hapscene scene 9"),
        (b" nut\n", b"\n"),
        (b"hapscene body 1 0 ", b"hapscene body 1 nan "),
        (b"hapscene body 1 0 1.0 ", b"hapscene body 1 0 3.0 "),
        (b"hapscene swatch 2 ", b"hapscene other 2 "),
        (b"property short swatch", b"property short smatch"),
        (b"element face ", b"element face 9999999999"),
    ],
)
def test_invalid_header_raises(old: bytes, new: bytes, make_scene: Callable[[int], Scene], tmp_path: Path) -> None:
    scene = make_scene(0)
    scene.bodies[1].two_sided = False
    file = export_scene(scene, tmp_path / "desk.ply")[0]
    content = file.read_bytes()
    assert old in content
    file.write_bytes(content.replace(old, new, 1))
    with pytest.raises(HapsceneError, match="desk"):
        import_scene(file)


@pytest.mark.parametrize("name", ["my end_header x", "TextureFile a.png"])
@pytest.mark.parametrize("what", ["body", "swatch"])
def test_name_with_end_of_header_raises(
    what: str, name: str, make_scene: Callable[[int], Scene], tmp_path: Path
) -> None:
    """Names that cannot be read again are rejected."""
    scene, file = make_scene(0), tmp_path / "desk.ply"
    if what == "body":
        scene.bodies[1].name = name
    else:
        scene.swatches[2] = replace(scene.swatches[2], name=name)
    if "end_header" in name:
        with pytest.raises(SceneError, match=f"{what} '{name}'"):
            export_scene(scene, file)
        assert not file.exists()
        return
    export_scene(scene, file)
    back = import_scene(file)
    assert name in [body.name for body in back.bodies] + [swatch.name for swatch in back.swatches]


def test_body_without_faces_raises(make_scene: Callable[[int], Scene], tmp_path: Path) -> None:
    file = export_scene(make_scene(0), tmp_path / "desk.ply")[0]
    line = next(x for x in file.read_bytes().split(b"\n") if b"hapscene body 1" in x)
    file.write_bytes(file.read_bytes().replace(line, line + b"\n" + line.replace(b"nut", b"ghost")))
    with pytest.raises(SceneError):
        import_scene(file)


def test_too_many_swatches_raise(scene: Scene, tmp_path: Path) -> None:
    scene.swatches += [replace(scene.swatches[2], name=f"swatch {i}") for i in range(4094)]
    with pytest.raises(SceneError, match="4,097"):
        export_scene(scene, tmp_path / "desk.ply")
    assert list(tmp_path.iterdir()) == []
