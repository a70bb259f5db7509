"""Look and feel in exported glTF files: materials and texture coordinates of the mesh file, paint cut at its border.

trimesh reads the files, and areas and distances are those of circles.
"""

import base64
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.errors import SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.exchange.gltf import glb_of
from hapscene.exchange.html_page import html_page
from hapscene.scene.gltf_check import parse_gltf
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene, load_scene
from hapscene.view.feel_layer import OPACITY
from tests.exchange.test_html_page import content_of

RADIUS_M = 0.025
RESOLUTION_M = 5e-4


@pytest.fixture(scope="module")
def textured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A box of two triangles a side, with a texture, as another program writes it."""
    box = trimesh.creation.box((0.12, 0.08, 0.06))
    corners, side = box.triangles.reshape(-1, 3), np.repeat(np.abs(box.face_normals).argmax(axis=1), 3)
    uv = np.array([np.delete(p, a) for p, a in zip(corners, side, strict=True)]) / 0.12 + 0.5
    pixels = np.random.default_rng(0).integers(0, 256, (16, 16, 3)).astype(np.uint8)
    material: Any = trimesh.visual.material.PBRMaterial(
        name="Truck paint",
        baseColorTexture=Image.fromarray(pixels),
        baseColorFactor=[204, 255, 255, 255],
        metallicFactor=0.25,
        roughnessFactor=0.5,
        doubleSided=True,
    )
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    file = tmp_path_factory.mktemp("foreign") / "box.glb"
    mesh.export(file)
    return file


@pytest.fixture
def disc(textured: Path) -> Scene:
    """The box with a disc of leather inside a side: y is up in the file."""
    scene = Scene()
    scene.add(textured, name="truck")
    assert scene.paint("truck", "leather", Sphere((0.0, -0.03, 0.0), RADIUS_M), resolution_m=RESOLUTION_M) > 0
    return scene


def _read(file: Path) -> dict[str, trimesh.Trimesh]:
    """The meshes of a file by name."""
    loaded = trimesh.load_scene(file, process=False)
    return {node.partition("/")[2]: loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry}


@pytest.mark.parametrize("show", ["both", "look"])
def test_materials_and_texture_coordinates_survive(show: Any, disc: Scene, textured: Path, tmp_path: Path) -> None:
    (was,) = trimesh.load_scene(textured, process=False).geometry.values()
    parts = _read(export_scene(disc, tmp_path / "truck.glb", show=show)[0])
    assert [name for name in parts if name.startswith("feel")] == (["feel: leather"] if show == "both" else [])
    surface = [part for name, part in parts.items() if not name.startswith("feel")]
    assert sum(len(part.faces) for part in surface) == len(was.faces)
    found = [np.concatenate(x) for x in ([p.triangles for p in surface], [p.visual.uv[p.faces] for p in surface])]
    turned = disc.bodies[0].mesh.triangles_m.astype(np.float32)  # as the file, with z up
    for corners, uv in zip(turned, was.visual.uv[was.faces], strict=True):
        (row,) = np.flatnonzero((found[0] == corners).all(axis=(1, 2)))
        np.testing.assert_allclose(found[1][row], uv, atol=1e-6)
    for part in surface:
        one, other = part.visual.material, was.visual.material
        assert one.name.startswith("Truck paint/") and one.doubleSided
        assert np.array_equal(one.baseColorFactor, other.baseColorFactor)
        assert (one.metallicFactor, one.roughnessFactor) == (0.25, 0.5)
        assert np.array_equal(np.asarray(one.baseColorTexture), np.asarray(other.baseColorTexture))


@pytest.mark.parametrize("show", ["both", "feel"])
def test_border_is_where_it_was_painted(show: Any, disc: Scene, tmp_path: Path) -> None:
    file = export_scene(disc, tmp_path / "truck.glb", show=show)[0]
    part = _read(file)["feel: leather"]
    tree = parse_gltf(file.read_bytes(), True, file.name)[0]
    made = next(m for m in tree["materials"] if m["name"] == "feel: leather")
    opacity, mode = (OPACITY, "BLEND") if show == "both" else (1.0, None)
    assert (made["pbrMetallicRoughness"]["baseColorFactor"][3], made.get("alphaMode")) == (opacity, mode)
    assert part.area == pytest.approx(np.pi * RADIUS_M**2, rel=2 * RESOLUTION_M / RADIUS_M)
    edges = np.sort(part.edges, axis=1)
    rows, count = np.unique(edges, axis=0, return_counts=True)
    border = part.vertices[np.unique(rows[count == 1])]
    away_m = np.linalg.norm(np.delete(border, 1, axis=1), axis=1)
    assert np.abs(away_m - RADIUS_M).max() < RESOLUTION_M


@pytest.mark.parametrize("show", ["both", "look", "feel"])
def test_import_is_exact_for_all_layers(show: Any, disc: Scene, tmp_path: Path) -> None:
    file = export_scene(disc, tmp_path / "truck.glb", show=show)[0]
    back, (body,) = import_scene(file), disc.bodies
    (again,) = back.bodies
    order = np.argsort(body.face_swatch, kind="stable")
    assert np.array_equal(again.mesh.triangles_m, body.mesh.triangles_m[order].astype(np.float32))
    assert np.array_equal(again.face_swatch, body.face_swatch[order])
    assert again.fine is not None and body.fine is not None and len(again.fine) == len(body.fine)
    place = np.argsort(order)[body.fine.face]
    mine = np.lexsort((body.fine.path, place))
    assert np.array_equal(again.fine.face, place[mine])
    assert np.array_equal(again.fine.path, body.fine.path[mine])
    assert np.array_equal(again.fine.paint, body.fine.paint[mine])
    assert len(load_mesh(file).faces) == len(body.mesh.faces)  # a mesh for contact is without the feel over it


def test_cut_faces_have_paint_and_look(disc: Scene, tmp_path: Path) -> None:
    """Each face has one swatch; its part of the texture is as large as on the box, where 120 mm are one tile."""
    file = export_scene(disc, tmp_path / "truck.glb", cut=True)[0]
    assert not any(name.startswith("feel") for name in _read(file))
    (body,) = import_scene(file).bodies
    area_m2 = trimesh.triangles.area(body.mesh.triangles_m)
    leather = body.face_swatch == 1
    assert body.fine is None and len(leather) > 12
    assert area_m2[leather].sum() == pytest.approx(np.pi * RADIUS_M**2, rel=2 * RESOLUTION_M / RADIUS_M)
    assert body.mesh.uv is not None and body.mesh.material is not None and not body.mesh.material.any()
    u, v = np.moveaxis(np.diff(body.mesh.uv.astype(float), axis=1), 2, 0)
    np.testing.assert_allclose(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2 * 0.12**2, area_m2, atol=1e-9)
    for layer in ({"cut": True}, {"show": "look"}):
        with pytest.raises(SceneError, match="truck"):
            export_scene(disc, tmp_path / "truck.ply", **layer)


def test_look_is_in_saved_scenes(disc: Scene, tmp_path: Path) -> None:
    """A scene from a GLB is saved with meshes beside it, which have the look, too."""
    scene = import_scene(export_scene(disc, tmp_path / "truck.glb")[0])
    scene.save(tmp_path / "truck.scene.json")
    files = sorted(tmp_path.iterdir())
    back = load_scene(tmp_path / "truck.scene.json")
    was, now = scene.bodies[0].mesh, back.bodies[0].mesh
    assert was.uv is not None and now.uv is not None and np.array_equal(now.uv, was.uv)
    assert was.material is not None and now.material is not None and np.array_equal(now.material, was.material)
    (one,), (other,) = now.materials, was.materials
    assert one.numbers == other.numbers
    for name, picture in other.textures.items():
        assert np.array_equal(np.asarray(one.textures[name]), np.asarray(picture))
    now = replace(now, path=None)
    back.bodies[0].mesh = now
    back.save(tmp_path / "truck.scene.json")
    assert sorted(tmp_path.iterdir()) == files  # the same content: pictures are not compressed again


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("materials.0.pbrMetallicRoughness.metallicFactor", [1]),
        ("materials.0.pbrMetallicRoughness.baseColorTexture", {"index": 99}),
        ("materials.0.pbrMetallicRoughness", 7),
        ("images.0", {"uri": "../secret.png"}),
        ("meshes.0.primitives.0.attributes.TEXCOORD_0", -1),
    ],
)
def test_damaged_look_is_left_out(path: str, value: Any, disc: Scene, tmp_path: Path) -> None:
    file = export_scene(disc, tmp_path / "truck.glb")[0]
    tree, chunk = parse_gltf(file.read_bytes(), True, "truck.glb")
    item, (*way, last) = tree, path.split(".")
    for step in way:
        item = item[int(step) if step.isdigit() else step]
    item[int(last) if last.isdigit() else last] = value
    file.write_bytes(glb_of(tree, chunk, file))
    (again,) = import_scene(file).bodies
    assert again.fine is not None and len(again.mesh.faces) == 12


def test_page_has_the_texture(disc: Scene, textured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = content_of(html_page(disc, "truck"))
    (picture,) = content["pictures"]
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2]))))
    own = np.asarray(disc.bodies[0].mesh.materials[0].textures["baseColorTexture"])
    np.testing.assert_allclose(pixels.mean(axis=(0, 1)), own.mean(axis=(0, 1)) * (0.8 ** (1 / 2.2), 1, 1), atol=4)
    assert (content["picture"] == 0).all()
    corners = content["uv"].reshape(-1, 2)[content["faces"].reshape(-1, 3)].astype(np.float64)
    ahead, back = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0]).sum() / 2
    assert area == pytest.approx(2 * (12 * 8 + 8 * 6 + 12 * 6) / 12**2, rel=1e-4)  # of the sides of the box
    mesh = disc.bodies[0].mesh
    assert mesh.uv is not None
    disc.bodies[0].mesh = replace(mesh, uv=mesh.uv + np.float32([5, -7]))  # the picture repeats
    np.testing.assert_allclose(content_of(html_page(disc, "truck"))["uv"], content["uv"], atol=1e-5)
    disc.bodies[0].mesh = replace(mesh, uv=None)
    assert not content_of(html_page(disc, "truck"))["pictures"]
    monkeypatch.setattr("hapscene.exchange.html_page.PICTURES_MAX", 1)
    scene = Scene()
    for name in ("one", "two"):
        mesh = scene.add(textured, name=name).mesh
        scene.bodies[-1].mesh = replace(mesh, materials=(replace(mesh.materials[0], name=name),))
    content = content_of(html_page(scene, "two"))
    corners = content["uv"].reshape(-1, 2)[content["faces"][:36].reshape(-1, 3)]
    np.testing.assert_allclose(corners, scene.bodies[0].mesh.uv * (1, -1) + (0, 1), atol=1e-6)
    assert len(content["pictures"]) == 1 and {*content["picture"].tolist()} == {0, 255}


def test_damaged_texture_is_left_out(disc: Scene, tmp_path: Path) -> None:
    (material,) = disc.bodies[0].mesh.materials
    content = io.BytesIO()
    Image.new("RGB", (64, 64)).save(content, "PNG")
    cut = io.BytesIO(content.getvalue()[:60])
    textures = {"normalTexture": Image.open(cut), **material.textures}
    disc.bodies[0].mesh = replace(disc.bodies[0].mesh, materials=(replace(material, textures=textures),))
    (made, *_) = _read(export_scene(disc, tmp_path / "truck.glb", show="look")[0]).values()
    assert made.visual.material.normalTexture is None and made.visual.material.baseColorTexture is not None
