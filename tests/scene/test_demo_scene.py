"""The shipped demo scene and its meshes."""

import json
import warnings
from importlib import resources

import numpy as np
import pytest

import hapscene
from hapscene.scene.mesh_doctor import examine

ASSETS = resources.files("hapscene_assets")


@pytest.fixture(scope="module")
def scene():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return hapscene.load_scene(ASSETS / "demo.scene.json")


def test_three_bodies_and_four_swatches(scene):
    assert [body.name for body in scene.bodies] == ["bracket", "toad", "plate"]
    assert {swatch.name for swatch in scene.swatches} == {"plain", "wood", "paper", "leather", "epoxy"}
    used = [set(body.face_swatch.tolist()) for body in scene.bodies]
    assert all(len(swatches) >= 2 for swatches in used) and set.union(*used) == {1, 2, 3, 4}


def test_bodies_are_side_by_side_on_a_plane(scene):
    low, high = np.array([body.mesh.bounds_m + body.X_WB[:3, 3] for body in scene.bodies]).transpose(1, 0, 2)
    np.testing.assert_allclose(low[:, 2], 0, atol=1e-9)
    assert (low[1:, 0] > high[:-1, 0] + 0.01).all()


@pytest.mark.parametrize("index", range(3))
def test_meshes_are_closed_and_have_no_defects(scene, index):
    report = examine(scene.bodies[index].mesh)
    assert report.closed and not report.findings


def test_plate_has_a_texture_and_two_adjacent_materials(scene):
    plate = scene.bodies[2].mesh
    left, right = plate.faces_of("woven"), plate.faces_of("grained") & plate.faces_of("top")
    assert plate.triangles_m[left][..., 0].max() == pytest.approx(0) == plate.triangles_m[right][..., 0].min()
    assert plate.colour_rgb[left].mean(axis=0)[2] > plate.colour_rgb[right].mean(axis=0)[2]


@pytest.mark.parametrize("name", ["bracket.obj", "toad.ply", "plate.obj"])
def test_meshes_have_a_source_and_a_licence(name):
    sidecar = json.loads((ASSETS / "meshes" / name).with_suffix(".json").read_text())
    assert sidecar["file"] == name and sidecar["licence"] == "MIT" and sidecar["unit"] in ("m", "mm")
    assert sidecar["source"] and sidecar["what"]
