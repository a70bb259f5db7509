"""Export and import of paint on subdivided faces."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.errors import SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.exchange.cut_faces import cut_faces
from hapscene.exchange.swatch_payload import ExchangeWarning, fine_to_json, restore_fine
from hapscene.scene.fine_paint import parts
from hapscene.scene.gltf_check import parse_gltf
from hapscene.scene.region import Box, Sphere
from hapscene.scene.scene import SWATCH_MAX, Scene
from tests.subface_areas import areas_m2


def rotated(x_m: float) -> np.ndarray:
    X = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3))
    X[0, 3] = x_m
    return X


@pytest.fixture
def fine() -> Scene:
    """A box of 12 faces with a spot, a spot with falloff and a strip across an edge; and an instance of the mesh."""
    scene = Scene()
    box = scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), name="box", unit="m", pose=rotated(0.1), swatch="leather")
    twin = scene.add(box.mesh, name="twin")
    scene.paint("box", "wood", Sphere((0.0, 0.0, 0.01), 0.004), resolution_m=1e-3)
    scene.paint("box", "paper", Sphere((0.02, 0.0, 0.0), 0.004), falloff_m=0.004, resolution_m=1e-3)
    scene.paint("twin", "paper", Box((-0.03, -0.03, 0.0), (0.0, 0.03, 0.03)), resolution_m=1e-3)
    assert box.fine is not None and twin.fine is not None and parts(box.fine.paint)[2].any()
    return scene


def paint_names(scene: Scene, body: int, points: np.ndarray) -> list[tuple]:
    """Names and weight of the paint at points (n, 3) on the surface, in the body's frame."""
    known = scene.bodies[body]
    triangles = known.mesh.triangles_m
    found = []
    for point in points:
        near = trimesh.triangles.closest_point(triangles, np.tile(point, (len(triangles), 1)))
        face = int(np.argmin(np.linalg.norm(near - point, axis=1)))
        bary = trimesh.triangles.points_to_barycentric(triangles[face][None], point[None])[0]
        paint = None if known.fine is None else known.fine.at(face, bary)
        a, b, weight = (x.item() for x in parts(known.face_swatch[face] if paint is None else paint))
        names = [swatch.name for swatch in scene.swatches]
        found.append((names[a], names[b] if weight else None, weight))
    return found


def surface_points(scene: Scene) -> np.ndarray:
    """Points (n, 3) on the first body, in its frame, not on a border."""
    mesh = scene.bodies[0].mesh
    return trimesh.sample.sample_surface(trimesh.Trimesh(mesh.vertices_m, mesh.faces), 300, seed=1)[0]


def test_gltf_roundtrip(fine: Scene, tmp_path: Path) -> None:
    file = export_scene(fine, tmp_path / "a.glb")[0]
    back = import_scene(file)
    assert all(body.mesh.uv is None and body.mesh.colour_rgb is None for body in back.bodies)
    tree = parse_gltf(file.read_bytes(), True, "a.glb")[0]
    shown = [(tree["materials"][one["material"]], one) for mesh in tree["meshes"] for one in mesh["primitives"]]
    assert {m["name"] for m, _ in shown if m.get("alphaMode") == "BLEND"} == {"feel: paper"}  # of the spot with falloff
    assert all(("COLOR_0" in one["attributes"]) == (m.get("alphaMode") == "BLEND") for m, one in shown)
    assert {m["pbrMetallicRoughness"]["baseColorFactor"][3] for m, _ in shown} == {1.0}
    for was, now in zip(fine.bodies, back.bodies, strict=True):
        assert len(now.fine) == len(was.fine)
    points = surface_points(fine)
    for body in range(2):
        assert paint_names(back, body, points) == paint_names(fine, body, points)
    assert len({name for name, *_ in paint_names(back, 0, points)}) == 3


def test_changed_faces_lose_subfaces(fine: Scene, tmp_path: Path) -> None:
    data = fine_to_json(fine, fine.bodies[0])
    shuffled = Scene()
    body = shuffled.add(replace(fine.bodies[0].mesh, faces=fine.bodies[0].mesh.faces[::-1]), swatch="wood")
    for name in ("leather", "paper"):
        shuffled.swatch_index(name)
    with pytest.warns(ExchangeWarning):
        restore_fine(Path("a.glb"), shuffled, body, data)
    assert body.fine is None


@pytest.mark.parametrize(
    "edit",
    [
        lambda data: None,
        *(lambda data, bad=bad: data | {"swatches": bad} for bad in ("wood", ["wood", 5], ["wood"] * (SWATCH_MAX + 1))),
        lambda data: data | {"packed": "AAAA"},
    ],
)
def test_damaged_data_raises(edit: Callable[[dict], object], fine: Scene) -> None:
    data = fine_to_json(fine, fine.bodies[0])
    order = np.argsort(fine.bodies[0].face_swatch, kind="stable")
    mesh = replace(fine.bodies[0].mesh, faces=fine.bodies[0].mesh.faces[order])
    scene = Scene()
    body = scene.add(mesh)
    for name in ("leather", "wood", "paper"):
        scene.swatch_index(name)
    restore_fine(Path("a.glb"), scene, body, data)
    assert body.fine is not None
    with pytest.raises(SceneError, match="body"):
        restore_fine(Path("a.glb"), scene, body, edit(data))


@pytest.mark.parametrize("soup", [False, True])
def test_cut_faces_are_watertight(soup: bool, fine: Scene) -> None:
    body = fine.bodies[0]
    if soup:  # faces share no vertices, as in an STL file
        triangles = body.mesh.triangles_m
        mesh = replace(
            body.mesh, vertices_m=triangles.reshape(-1, 3), faces=np.arange(triangles.size // 3).reshape(-1, 3)
        )
        body = replace(body, mesh=mesh)
    vertices_m, faces, swatch, *_ = cut_faces(body)
    assert soup or len(np.unique(vertices_m.round(12), axis=0)) == len(vertices_m)
    cut = trimesh.Trimesh(vertices_m, faces, process=False)
    cut.merge_vertices(digits_vertex=15)
    assert cut.is_watertight and cut.is_winding_consistent  # each side of a part belongs to one other part
    assert cut.area == pytest.approx(trimesh.Trimesh(body.mesh.vertices_m, body.mesh.faces).area, rel=1e-12)
    area_m2, subfaces = np.bincount(swatch, cut.area_faces, 4), body.fine
    heavier = np.bincount(parts(subfaces.paint)[0], areas_m2(subfaces, body.mesh), 4)
    whole = np.setdiff1d(np.arange(12), subfaces.faces)
    heavier += np.bincount(body.face_swatch[whole], trimesh.triangles.area(body.mesh.triangles_m[whole]), 4)
    np.testing.assert_allclose(area_m2, heavier, atol=1e-15)


@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_ply_and_obj_have_cut_faces(suffix: str, fine: Scene, tmp_path: Path) -> None:
    export_scene(fine, tmp_path / f"a.{suffix}")
    back = import_scene(tmp_path / f"a.{suffix}", "m")
    X_WB = fine.bodies[0].X_WB
    points = surface_points(fine)[:100]
    moved = points @ X_WB[:3, :3].T + X_WB[:3, 3]
    same = [a[0] == b[0] for a, b in zip(paint_names(back, 0, moved), paint_names(fine, 0, points), strict=True)]
    assert all(same)


def test_invalid_parent_detaches_the_body(fine: Scene, tmp_path: Path) -> None:
    fine.attach("box", "twin")
    file = tmp_path / "a.glb"
    export_scene(fine, file)
    assert import_scene(file).bodies[0].parent == "twin"
    content = file.read_bytes()
    assert b'"parent": "twin"' in content
    file.write_bytes(content.replace(b'"parent": "twin"', b'"parent": "box" '))  # itself
    with pytest.warns(ExchangeWarning, match="box"):
        assert import_scene(file).bodies[0].parent is None
