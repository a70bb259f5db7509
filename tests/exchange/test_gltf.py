"""Exported glTF files, read by trimesh and checked by the schema."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.exchange import export_scene
from hapscene.exchange.gltf import glb_of
from hapscene.exchange.swatch_payload import groups_of
from hapscene.scene.gltf_check import parse_gltf
from hapscene.scene.scene import Scene
from hapscene.surface.swatch_file import swatch_from_json, swatch_to_json

Y_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""z up to y up: x stays, z becomes y."""


def tree_of(file: Path) -> dict:
    return parse_gltf(file.read_bytes(), True, file.name)[0]


def test_trimesh_reads_all_pieces(scene: Scene, tmp_path: Path) -> None:
    import trimesh

    file = export_scene(scene, tmp_path / "desk.glb", show="feel")[0]
    loaded = trimesh.load_scene(file, process=False)
    assert len(loaded.graph.nodes_geometry) == 9 and len(loaded.geometry) == 6  # the twin shares the stone's three
    for body in scene.bodies:
        for index, _, rows in groups_of(body):
            swatch = scene.swatches[index]
            X, geometry = loaded.graph[f"{body.name}/{swatch.name}"]
            mesh = loaded.geometry[geometry]
            np.testing.assert_allclose(X, Y_UP @ body.X_WB, rtol=0, atol=1e-15)
            assert np.array_equal(mesh.triangles, body.mesh.triangles_m[rows].astype(np.float32))
            material = mesh.visual.material
            assert material.name == swatch.name and bool(material.doubleSided) == body.two_sided
            if index:  # the mean of its grain is about its colour
                grain = np.asarray(material.baseColorTexture) / 255
                np.testing.assert_allclose(grain.mean(axis=(0, 1)), swatch.albedo_rgb, atol=0.1)


def test_tangents_are_unit_vectors_along_the_surface(scene: Scene, tmp_path: Path) -> None:
    tree, chunk = parse_gltf(export_scene(scene, tmp_path / "desk.glb")[0].read_bytes(), True, "desk.glb")[:2]

    def rows(accessor: int) -> np.ndarray:
        view = tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]
        return np.frombuffer(chunk, "<f4", view["byteLength"] // 4, view.get("byteOffset", 0))

    found = [one["attributes"] for mesh in tree["meshes"] for one in mesh["primitives"]]
    grained = [attributes for attributes in found if "TANGENT" in attributes]
    assert grained
    for attributes in grained:
        normal, tangent = rows(attributes["NORMAL"]).reshape(-1, 3), rows(attributes["TANGENT"]).reshape(-1, 4)
        np.testing.assert_allclose(np.linalg.norm(tangent[:, :3], axis=1), 1.0, atol=1e-5)
        np.testing.assert_allclose(np.einsum("ij,ij->i", normal, tangent[:, :3]), 0.0, atol=1e-5)
        assert (tangent[:, 3] == 1.0).all()
    for attributes in found:
        bounds = tree["accessors"][attributes["POSITION"]]
        at = rows(attributes["POSITION"]).reshape(-1, 3)
        assert (bounds["min"], bounds["max"]) == (at.min(axis=0).tolist(), at.max(axis=0).tolist())


@pytest.mark.parametrize("count", range(4))
def test_chunks_are_padded_to_four_bytes(count: int) -> None:
    made = glb_of({"name": count * "?"}, b"\1\2\3\4", Path("a.glb"))
    assert len(made) == int.from_bytes(made[8:12], "little") and int.from_bytes(made[12:16], "little") % 4 == 0


def test_extras_have_the_parameters(scene: Scene, tmp_path: Path) -> None:
    tree = tree_of(export_scene(scene, tmp_path / "desk.glb")[0])
    assert tree["nodes"][0]["extras"] == {"hapscene_version": 1}
    extras = next(m["extras"] for m in tree["materials"] if m["name"] == "wood")
    assert extras["stiffness_N_m"] == scene.swatches[1].stiffness_N_m
    assert swatch_to_json(swatch_from_json(extras["swatch_file"])) == swatch_to_json(scene.swatches[1])
