"""Faces that no swatch is painted on look in glTF as in the mesh's own file, to other programs."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.exchange import export_scene
from hapscene.scene.mesh import Mesh, face_colours
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A quad with a picture of four colours, one a corner, hung mirrored; and a red box, hung deeper."""
    picture = Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [9, 9, 9]]], np.uint8))
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float) / 20
    uv = np.array([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]])
    look = trimesh.visual.TextureVisuals(uv, material=trimesh.visual.material.PBRMaterial(baseColorTexture=picture))
    quad = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=look, process=False)
    red = trimesh.creation.box((0.01, 0.02, 0.03))
    red.visual.face_colors = [255, 0, 0, 255]
    scene = trimesh.Scene()
    scene.add_geometry(quad, node_name="quad", transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    scene.add_geometry(red, node_name="red", parent_node_name="quad")
    scene.export(tmp_path / "foreign.glb")
    return tmp_path / "foreign.glb"


def seen(shape: trimesh.Trimesh) -> list[list[int]]:
    colours = face_colours(shape)
    assert colours is not None
    return colours.tolist()


def test_pictures_and_colours_go_along_where_nothing_is_painted(foreign: Path, tmp_path: Path) -> None:
    scene = Scene()
    scene.add(foreign, up="z", scale=2.0, two_sided=True)
    scene.paint("foreign", "wood", [3, 5])
    export_scene(scene, tmp_path / "out.glb")
    loaded = trimesh.load_scene(tmp_path / "out.glb", process=False)
    assert len(loaded.geometry) == 3
    plain = [shape for shape in loaded.geometry.values() if shape.visual.kind == "texture"]
    (quad,) = [shape for shape in plain if getattr(shape.visual.material, "baseColorTexture", None) is not None]
    was = trimesh.load_scene(foreign, process=False).geometry
    before = next(shape for shape in was.values() if len(shape.faces) == 2)
    np.testing.assert_allclose(quad.visual.uv, before.visual.uv)
    picture = np.asarray(quad.visual.material.baseColorTexture.convert("RGB"))
    assert picture.tolist() == [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [9, 9, 9]]]
    (red,) = [shape for shape in plain if "color" in shape.visual.vertex_attributes]
    assert len(red.faces) == 10 and seen(red) == [[255, 0, 0]] * 10
    (wood,) = [shape for shape in plain if shape.visual.material.name == "wood"]
    assert len(wood.faces) == 2


def test_a_file_that_has_changed_leaves_its_colours(foreign: Path, tmp_path: Path) -> None:
    scene = Scene()
    scene.add(foreign)
    trimesh.creation.box().export(foreign)
    for name in ("changed", "gone"):
        export_scene(scene, tmp_path / f"{name}.glb")
        loaded = trimesh.load_scene(tmp_path / f"{name}.glb", process=False)
        assert all("color" in shape.visual.vertex_attributes for shape in loaded.geometry.values())
        foreign.unlink(missing_ok=True)


def test_colours_are_exact(tmp_path: Path) -> None:
    colours = np.random.default_rng(0).integers(0, 256, (12, 3)).astype(np.uint8)
    box = trimesh.creation.box((0.01, 0.02, 0.03))
    scene = Scene()
    scene.add(Mesh(box.vertices, box.faces, colour_rgb=colours))
    export_scene(scene, tmp_path / "a.glb")
    mesh = load_mesh(tmp_path / "a.glb")

    def by_place(shape: Mesh) -> list[list[float]]:
        assert shape.colour_rgb is not None
        return sorted(np.hstack([shape.triangles_m.mean(axis=1).round(6), shape.colour_rgb]).tolist())

    assert by_place(mesh) == by_place(scene.bodies[0].mesh)
