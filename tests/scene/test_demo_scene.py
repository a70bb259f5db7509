"""The shipped demo scene and its meshes."""

import warnings
from importlib import resources

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


@pytest.mark.parametrize("index", range(3))
def test_meshes_are_closed_and_have_no_defects(scene, index):
    report = examine(scene.bodies[index].mesh)
    assert report.volume_m3 and not report.findings
