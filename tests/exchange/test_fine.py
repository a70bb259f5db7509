"""What is painted finer than faces, there and back: whole where a format has a place, else as faces cut along it."""

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
from hapscene.scene.region import Box, Sphere
from hapscene.scene.scene import Scene


def turned(x_m: float) -> np.ndarray:
    X = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3))
    X[0, 3] = x_m
    return X


@pytest.fixture
def fine() -> Scene:
    """A box of 12 faces with a spot, a soft spot and a strip over an edge; and a second one of the same mesh."""
    scene = Scene()
    box = scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), name="box", unit="m", pose=turned(0.1), swatch="leather")
    twin = scene.add(box.mesh, name="twin")
    scene.paint("box", "wood", Sphere((0.0, 0.0, 0.01), 0.004), resolution_m=1e-3)
    scene.paint("box", "paper", Sphere((0.02, 0.0, 0.0), 0.004), falloff_m=0.004, resolution_m=1e-3)
    scene.paint("twin", "paper", Box((-0.03, -0.03, 0.0), (0.0, 0.03, 0.03)), resolution_m=1e-3)
    assert box.fine is not None and twin.fine is not None and parts(box.fine.paint)[2].any()
    return scene


def felt(scene: Scene, body: int, points: np.ndarray) -> list[tuple]:
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


def places(scene: Scene) -> np.ndarray:
    """Points (n, 3) on the first body, in its frame, none on a border."""
    mesh = scene.bodies[0].mesh
    return trimesh.sample.sample_surface(trimesh.Trimesh(mesh.vertices_m, mesh.faces), 300, seed=1)[0]


def test_comes_back_whole(fine: Scene, tmp_path: Path) -> None:
    export_scene(fine, tmp_path / "a.glb")
    back = import_scene(tmp_path / "a.glb")
    for was, now in zip(fine.bodies, back.bodies, strict=True):
        assert len(now.fine) == len(was.fine)
    points = places(fine)
    for body in range(2):
        assert felt(back, body, points) == felt(fine, body, points)
    assert len({name for name, *_ in felt(back, 0, points)}) == 3


def test_of_changed_faces_stays_out(fine: Scene, tmp_path: Path) -> None:
    told = fine_to_json(fine, fine.bodies[0])
    shuffled = Scene()
    body = shuffled.add(replace(fine.bodies[0].mesh, faces=fine.bodies[0].mesh.faces[::-1]), swatch="wood")
    for name in ("leather", "paper"):
        shuffled.swatch_index(name)
    with pytest.warns(ExchangeWarning):
        restore_fine(Path("a.glb"), shuffled, body, told)
    assert body.fine is None


@pytest.mark.parametrize(
    "edit",
    [
        lambda told: None,
        lambda told: told | {"swatches": "wood"},
        lambda told: told | {"packed": "AAAA"},
    ],
)
def test_damaged_is_refused(edit: Callable[[dict], object], fine: Scene) -> None:
    told = fine_to_json(fine, fine.bodies[0])
    order = np.argsort(fine.bodies[0].face_swatch, kind="stable")
    mesh = replace(fine.bodies[0].mesh, faces=fine.bodies[0].mesh.faces[order])
    scene = Scene()
    body = scene.add(mesh)
    for name in ("leather", "wood", "paper"):
        scene.swatch_index(name)
    restore_fine(Path("a.glb"), scene, body, told)
    assert body.fine is not None
    with pytest.raises(SceneError, match="body"):
        restore_fine(Path("a.glb"), scene, body, edit(told))


@pytest.mark.parametrize("soup", [False, True])
def test_cut_faces_cover_the_surface_without_a_crack(soup: bool, fine: Scene) -> None:
    body = fine.bodies[0]
    if soup:  # as an STL has it: no face shares a vertex with another
        triangles = body.mesh.triangles_m
        mesh = replace(
            body.mesh, vertices_m=triangles.reshape(-1, 3), faces=np.arange(triangles.size // 3).reshape(-1, 3)
        )
        body = replace(body, mesh=mesh)
    vertices_m, faces, swatch = cut_faces(body)
    cut = trimesh.Trimesh(vertices_m, faces, process=False)
    cut.merge_vertices(digits_vertex=15)
    assert cut.is_watertight and cut.is_winding_consistent  # each side of each piece is a side of just one other
    assert cut.area == pytest.approx(trimesh.Trimesh(body.mesh.vertices_m, body.mesh.faces).area, rel=1e-12)
    area_m2, leaves = np.bincount(swatch, cut.area_faces, 4), body.fine
    heavier = np.bincount(parts(leaves.paint)[0], leaves.areas_m2(body.mesh), 4)
    whole = np.setdiff1d(np.arange(12), leaves.faces)
    heavier += np.bincount(body.face_swatch[whole], trimesh.triangles.area(body.mesh.triangles_m[whole]), 4)
    np.testing.assert_allclose(area_m2, heavier, atol=1e-15)


@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_comes_back_as_cut_faces(suffix: str, fine: Scene, tmp_path: Path) -> None:
    export_scene(fine, tmp_path / f"a.{suffix}")
    back = import_scene(tmp_path / f"a.{suffix}", "m")
    X_WB = fine.bodies[0].X_WB
    points = places(fine)[:100]
    moved = points if suffix == "ply" else points @ X_WB[:3, :3].T + X_WB[:3, 3]
    same = [a[0] == b[0] for a, b in zip(felt(back, 0, moved), felt(fine, 0, points), strict=True)]
    assert all(same)


def test_body_whose_parent_is_gone_hangs_on_nothing(fine: Scene, tmp_path: Path) -> None:
    fine.attach("box", "twin")
    file = tmp_path / "a.gltf"
    export_scene(fine, file)
    assert import_scene(file).bodies[0].parent == "twin"
    text = file.read_text(encoding="utf-8")
    assert '"parent": "twin"' in text
    file.write_text(text.replace('"parent": "twin"', '"parent": "box"'), encoding="utf-8")  # itself
    with pytest.warns(ExchangeWarning, match="box"):
        assert import_scene(file).bodies[0].parent is None
