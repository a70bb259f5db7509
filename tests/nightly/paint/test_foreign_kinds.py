"""Twelve kinds of third-party meshes: open, paint, save, load; the painted areas stay, and are those of the region."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.paint.opening import open_session
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import NOTHING, parts
from hapscene.scene.scene import Scene, load_scene

SPHERE = 0.15
"""Radius of the painted sphere, in diagonals of the mesh [1]."""

POINT_COUNT = 200_000
"""Random points on the mesh, by which the area inside the sphere is estimated [count]."""


def gltf_tree(meshes: Path, folder: Path) -> Path:
    """A glTF file with its buffers beside it; its nodes are nested, turned and scaled."""
    tree, turn = trimesh.Scene(), trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.01, 0.0, 0.0))
    tree.add_geometry(trimesh.creation.capsule(0.05, 0.01), "capsule")
    tree.add_geometry(trimesh.creation.torus(0.03, 0.01), "ring", parent_node_name="capsule", transform=turn)
    tree.add_geometry(trimesh.creation.icosphere(3, 0.02), "ball", parent_node_name="ring", transform=turn @ turn)
    for name, content in trimesh.exchange.gltf.export_gltf(tree).items():
        (folder / name).write_bytes(content)
    return folder / "model.gltf"


def off(meshes: Path, folder: Path) -> Path:
    trimesh.load(meshes / "rabbit.obj", force="mesh").export(folder / "rabbit.off")
    return folder / "rabbit.off"


KINDS: dict[str, str | Callable[[Path, Path], Path]] = {
    "GLB with a texture": "Duck.glb",
    "GLB without a texture": "monkey.glb",
    "glTF tree": gltf_tree,
    "CAD STL": "featuretype.STL",
    "STL with defects": "busted.STL",
    "STL of open patches": "teapot.stl",
    "STEP": "base_interface_AP214.STEP",
    "OBJ with sharp edges": "fandisk.obj",
    "OBJ with groups": "groups.obj",
    "scan PLY": "bunny.ply",
    "OFF": off,
}


def face_areas(body: Body) -> np.ndarray:
    return trimesh.triangles.area(body.mesh.vertices_m[body.mesh.faces])


def areas(scene: Scene) -> dict[str, float]:
    """Area of the first body that each swatch covers [m²]; of a blend, that of the heavier swatch."""
    body = scene.bodies[0]
    fine, area = body.fine or NOTHING, face_areas(body)
    undivided = np.setdiff1d(np.arange(len(area)), fine.face)
    one, _, _ = parts(fine.paint)
    swatch = np.concatenate([body.face_swatch[undivided], one])
    covered = np.bincount(
        swatch, np.concatenate([area[undivided], area[fine.face] * 0.5**fine.level]), len(scene.swatches)
    )
    return dict(zip([swatch.name for swatch in scene.swatches], covered.tolist(), strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_painted_areas_survive_saving(shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    monkeypatch.chdir(tmp_path)
    made = KINDS[kind]
    file = shared / "data" / "meshes" / made if isinstance(made, str) else made(shared / "data" / "meshes", tmp_path)
    has_unit = file.suffix.lower() in (".glb", ".gltf", ".step")
    session = open_session(str(file), unit=None if has_unit else "mm")
    body = session.scene.bodies[0]
    corners_m = body.mesh.vertices_m[body.mesh.faces]
    whole_m2 = face_areas(body).sum()
    centre_m, radius_m = corners_m[face_areas(body).argmax()].mean(axis=0), SPHERE * body.mesh.diagonal_m
    session.fill_sphere(centre_m, radius_m, session.add_swatch("leather"))

    shape = trimesh.Trimesh(body.mesh.vertices_m, body.mesh.faces, process=False)
    points_m, _ = trimesh.sample.sample_surface(shape, POINT_COUNT, seed=0)
    share = (np.linalg.norm(points_m - centre_m, axis=1) < radius_m).mean()
    spread = np.sqrt(share * (1 - share) / POINT_COUNT)
    assert areas(session.scene)["leather"] / whole_m2 == pytest.approx(share, abs=5 * spread)

    low_m, high_m = body.mesh.bounds_m
    session.begin_stroke(session.add_swatch("wood"), 0.05 * body.mesh.diagonal_m)
    for along in np.linspace(0.3, 0.7, 9):
        session.drag_to(low_m + (high_m - low_m) * (along, along, 2.0), (0.0, 0.0, -1.0))
    session.end_stroke()
    painted = areas(session.scene)
    assert painted["wood"] > 0.0 and sum(painted.values()) == pytest.approx(whole_m2)
    assert areas(load_scene(session.save())) == pytest.approx(painted, rel=1e-9)
