"""PLY and OBJ, and meshes whose materials have names of swatches."""

from pathlib import Path

import numpy as np

from hapscene.exchange import export_scene, import_scene
from hapscene.scene.scene import Scene


def test_trimesh_reads_obj_materials(scene: Scene, tmp_path: Path) -> None:
    import trimesh

    obj, mtl = export_scene(scene, tmp_path / "desk.obj")
    assert mtl == tmp_path / "desk.mtl"
    loaded = trimesh.load_scene(obj, group_material=True, process=False)
    by_name = {g.visual.material.name: g for g in loaded.geometry.values()}
    for index, swatch in enumerate(scene.swatches):
        part = by_name[swatch.name.replace("\\", "_")]
        assert len(part.faces) == sum(int((body.face_swatch == index).sum()) for body in scene.bodies)
        colour = np.asarray(part.visual.material.diffuse)[:3] / 255
        np.testing.assert_allclose(colour, swatch.albedo_rgb, atol=1 / 255)


def test_trimesh_reads_ply_faces(scene: Scene, tmp_path: Path) -> None:
    import trimesh

    file = export_scene(scene, tmp_path / "desk.ply")[0]
    loaded = trimesh.load(file, process=False)
    raw, at = loaded.metadata["_ply_raw"]["face"]["data"], 0
    for body in scene.bodies:
        rows = slice(at, at := at + len(body.mesh.faces))
        assert np.array_equal(raw["group"][rows].ravel(), body.face_swatch)
        p_W = body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]
        assert np.array_equal(loaded.vertices[loaded.faces[rows]], p_W[body.mesh.faces])
        albedo = np.array([swatch.albedo_rgb for swatch in scene.swatches])[body.face_swatch]
        assert np.abs(loaded.visual.face_colors[rows, :3] / 255 - albedo).max() <= 0.5 / 255 + 1e-9
    assert len(loaded.faces) == at


def test_import_by_material_name(tmp_path: Path) -> None:
    """Material names take precedence over object names; unknown names stay plain."""
    (tmp_path / "part.obj").write_text(
        "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\n"
        "o wood\nusemtl steel\nf 1 3 2\nusemtl paper\nf 1 2 4\no table\nusemtl leather\nf 1 4 3\nusemtl tin\nf 2 3 4\n"
    )
    scene = import_scene(tmp_path / "part.obj", "mm")
    (body,) = scene.bodies
    assert [scene.swatches[i].name for i in body.face_swatch] == ["wood", "paper", "leather", "plain"]
    assert body.mesh.diagonal_m < 0.02
