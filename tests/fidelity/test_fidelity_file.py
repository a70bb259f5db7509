"""The fidelity file."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hapscene
from hapscene.fidelity.coarser_mesh import coarser_mesh
from hapscene.fidelity.fidelity import BodyFidelity, Fidelity, Level, SwatchFidelity
from hapscene.fidelity.fidelity_file import (
    FidelityError,
    fidelity_beside,
    load_fidelity,
    save_fidelity,
)

from .conftest import scene_of

TOLD = {"faces": 2560.0, "error_jnd": 0.4, "tick_median_us": 2.1}
MADE = {"device": "omni", "untuned_faces": 5120, "untuned_tick_median_us": 4.0, "handle": None}


@pytest.fixture
def scene():
    made = scene_of("sphere")
    made.paint("body", "leather", made.bodies[0].mesh.triangles_m.mean(axis=1)[:, 2] > 0)
    return made


@pytest.fixture
def fidelity(scene):
    names = [swatch.name for swatch in scene.swatches]
    mesh = coarser_mesh(scene.bodies[0], 2560, names)
    level = Level({"body": BodyFidelity(mesh)}, {"wood": SwatchFidelity(5, 4)}, TOLD)
    return Fidelity(level, MADE)


@pytest.fixture
def file(tmp_path, scene, fidelity):
    path = tmp_path / "x.fidelity.json"
    save_fidelity(fidelity, path, scene)
    return path


def test_round_trip(file, scene, fidelity):
    read = load_fidelity(file, scene)
    was, now = fidelity.level, read.level
    assert read.made == MADE
    assert now.swatches == was.swatches and now.cost == was.cost and now.bodies.keys() == was.bodies.keys()
    for name, body in was.bodies.items():
        mesh = now.bodies[name].mesh
        assert mesh.digest == body.mesh.digest
        assert mesh.group_names == body.mesh.group_names and np.array_equal(mesh.group, body.mesh.group)


def test_body_without_coarser_mesh_is_not_written(tmp_path, scene):
    save_fidelity(Fidelity(Level({"body": BodyFidelity()})), tmp_path / "x.fidelity.json", scene)
    assert load_fidelity(tmp_path / "x.fidelity.json", scene).level.bodies == {}


def test_files_of_earlier_versions(file, scene, fidelity):
    content = json.loads(file.read_text())
    content["levels"][0]["swatches"]["wood"]["left_out"] = ["tap"]
    content["levels"].append({"told": {}, "bodies": {"gone": {"mesh": None}}, "swatches": {}})
    file.write_text(json.dumps(content))
    read = load_fidelity(file, scene)
    assert read.level.swatches == fidelity.level.swatches


def test_fidelity_file_of_the_demo():
    assets = Path(__file__).parents[2] / "assets"
    scene = hapscene.load_scene(assets / "demo.scene.json")
    first = load_fidelity(assets / "demo.fidelity.json", scene).level
    assert first.cost["error_jnd"] <= 1.0 and first.cost["faces"] < 0.5 * sum(len(b.mesh.faces) for b in scene.bodies)


def test_fidelity_beside():
    assert fidelity_beside("a/x.scene.json").as_posix() == fidelity_beside("a/x.ply").as_posix() == "a/x.fidelity.json"


@pytest.mark.parametrize("change", ["painting", "swatch", "name", "mesh", "sides"])
def test_a_changed_scene_is_refused(file, scene, change):
    body = scene.bodies[0]
    if change == "painting":
        scene.paint("body", "wood", [0, 1, 2, len(body.face_swatch) - 1])
    elif change == "swatch":
        scene.swatches[1] = replace(scene.swatches[1], stiffness_N_m=333.0)
    elif change == "name":
        scene.rename(0, "other")
    elif change == "mesh":
        body.mesh = replace(body.mesh, vertices_m=body.mesh.vertices_m * (1 + 1e-12))
    else:
        body.two_sided = True
    with pytest.raises(FidelityError, match=r"x\.fidelity\.json: .*hapscene tune"):
        load_fidelity(file, scene)


def test_poses_may_change(file, scene):
    X_WB = np.eye(4)
    X_WB[:3, 3] = 0.1
    scene.pose("body", X_WB)
    assert load_fidelity(file, scene).made == MADE


LEVEL = ("levels", 0)
BODY, SWATCH = (*LEVEL, "bodies", "body"), (*LEVEL, "swatches", "wood")


@pytest.mark.parametrize(
    ("place", "value", "expected"),
    [
        (("version",), 2, "update hapscene"),
        (("format",), "hapscene scene", "not a fidelity"),
        (("scene",), "ab", "SHA-256"),
        (("levels",), [], "levels is"),
        (("made", "device"), ["omni"], "expected a number"),
        (("more",), 1, "unknown key 'more'"),
        ((*LEVEL, "told", "error_jnd"), "0", "expected a number"),
        ((*LEVEL, "bodies", "cup"), {}, "no body 'cup'; there are: body"),
        ((*LEVEL, "swatches", "oak"), {}, "no swatch 'oak'"),
        ((*BODY, "crease_rad"), 0.5, "unknown key"),
        ((*BODY, "mesh"), None, "mesh must be an object"),
        ((*BODY, "mesh", "path"), "../x.ply", "name of a PLY file"),
        ((*BODY, "mesh", "path"), "x.stl", "name of a PLY file"),
        ((*BODY, "mesh", "path"), "gone.ply", "no such file"),
        ((*BODY, "mesh", "sha256"), "0" * 64, "has changed"),
        ((*BODY, "mesh", "face_count"), 10**9, "expected 1 to 5120"),
        ((*BODY, "mesh", "face_count"), 2559, "has 2,560 faces"),
        ((*SWATCH, "order"), 0, "order is"),
        ((*SWATCH, "order"), 1000, "order is"),
        ((*SWATCH, "update_ticks"), 0, "from 1 to 1000"),
    ],
)
def test_invalid_files(file, scene, place, value, expected):
    content = json.loads(file.read_text())
    at = content
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value
    file.write_text(json.dumps(content))
    with pytest.raises(FidelityError) as raised:
        load_fidelity(file, scene)
    assert expected in str(raised.value) and "x.fidelity.json" in str(raised.value) and "\n" not in str(raised.value)


def test_a_changed_mesh_is_refused(file, scene):
    mesh = next(file.parent.glob("*.ply"))
    content = bytearray(mesh.read_bytes())
    content[-1] ^= 1
    mesh.write_bytes(content)
    with pytest.raises(FidelityError, match="has changed"):
        load_fidelity(file, scene)


def test_nan_is_not_written(tmp_path, scene):
    with pytest.raises(ValueError):
        save_fidelity(Fidelity(Level(cost={"error_jnd": math.nan})), tmp_path / "x.fidelity.json", scene)
    assert not list(tmp_path.iterdir())


def test_meshes_are_deleted_with_the_file_unless_a_scene_uses_them(file, scene, fidelity):
    coarse = fidelity.level.bodies["body"].mesh
    other = hapscene.Scene()
    other.add(replace(coarse, path=next(file.parent.glob(f"*{'.ply'}"))), name="coarse")
    meshes = set(file.parent.glob("*.ply"))
    assert len(meshes) == 1
    kept = other.bodies[0].mesh.path
    other.save(file.parent / "other.scene.json")
    save_fidelity(Fidelity(), file, scene)
    assert set(file.parent.glob("*.ply")) == {kept}


def test_another_suffix_is_refused(tmp_path, scene):
    with pytest.raises(FidelityError, match=r"x\.json"):
        save_fidelity(Fidelity(), tmp_path / "x.json", scene)
