"""Bodies, poses, paint, and warnings about winding."""

import math
import warnings

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.errors import MeshError, SceneError, SwatchError
from hapscene.scene.mesh import Mesh, MeshWarning
from hapscene.scene.region import Box
from hapscene.surface.swatch import PLAIN, Swatch

BOX = trimesh.creation.box((0.1, 0.1, 0.1))
OAK, SLATE = Swatch("oak", stiffness_N_m=400), Swatch("slate", stiffness_N_m=900)


def turn(angle_rad=0.3, scale=1.0):
    X = trimesh.transformations.rotation_matrix(angle_rad, (0, 1, 1), (0.1, 0.2, 0.3))
    X[:3, :3] *= scale
    return X


def test_add_file(tmp_path):
    BOX.export(tmp_path / "box.ply")
    scene = hapscene.Scene()
    body = scene.add(str(tmp_path / "box.ply"), name="bunny", unit="m", swatch=OAK)
    assert scene.bodies == [body] and scene.body("bunny") is body and not body.two_sided
    assert scene.swatches == [PLAIN, OAK] and (body.face_swatch == 1).all()
    np.testing.assert_array_equal(body.X_WB, np.eye(4))
    assert body.X_WB.dtype == np.float64 and body.face_swatch.dtype == np.int16


def test_default_names_are_unique(tmp_path):
    BOX.export(tmp_path / "box.ply")
    scene = hapscene.Scene()
    names = [scene.add(tmp_path / "box.ply", unit="m").name for _ in range(3)] + [scene.add(BOX, unit="m").name]
    assert names == ["box", "box_2", "box_3", "body"]
    with pytest.raises(SceneError, match="box"):
        scene.add(BOX, name="box", unit="m")
    with pytest.raises(SceneError):
        scene.add(BOX, name="a\nb", unit="m")
    with pytest.raises(SceneError, match="bocks"):
        scene.body("bocks")


def test_instances_share_their_mesh(tmp_path):
    BOX.export(tmp_path / "box.ply")
    scene = hapscene.Scene()
    a, b = scene.add(tmp_path / "box.ply", unit="m"), scene.add(str(tmp_path / "box.ply"), unit="m", pose=turn())
    assert a.mesh is b.mesh and a.face_swatch is not b.face_swatch
    assert scene.add(tmp_path / "box.ply", unit="mm").mesh is not a.mesh
    assert scene.add(a.mesh).mesh is a.mesh


@pytest.mark.parametrize(
    "pose",
    [
        np.eye(3),
        turn(scale=1.0001),
        np.diag([1.0, 1, -1, 1]),
        turn() * np.nan,
        "here",
        [[1, 2], [3]],
        trimesh.transformations.translation_matrix((2e4, 0, 0)),
    ],
)
def test_invalid_pose_raises_and_adds_no_body(pose):
    scene = hapscene.Scene()
    with pytest.raises(SceneError, match="pose"):
        scene.add(BOX, name="box", unit="m", pose=pose)
    assert not scene.bodies


def test_paint_all_faces_group_indices_mask_and_region(tmp_path):
    mesh = Mesh(np.array(BOX.vertices), np.array(BOX.faces), np.arange(12) // 4, ("left", "right", "lid"))
    scene = hapscene.Scene()
    body = scene.add(mesh, name="box")
    assert scene.paint("box", OAK) == 12 and (body.face_swatch == 1).all()
    assert scene.paint("box", SLATE, "lid") == 4 and body.face_swatch.tolist() == [1] * 8 + [2] * 4
    assert scene.paint("box", PLAIN, [0, 3, 3]) == 2 and body.face_swatch[[0, 3]].tolist() == [0, 0]
    assert scene.paint("box", SLATE, np.arange(12) < 2) == 2
    assert scene.paint("box", OAK, Box((-1, -1, 0.04), (1, 1, 1)), resolution_m=math.inf) == 2
    assert (body.face_swatch[mesh.normals[:, 2] > 0.9] == 1).all()
    assert scene.paint("box", OAK, []) == 0
    assert scene.swatches == [PLAIN, OAK, SLATE]


@pytest.mark.parametrize(
    ("where", "error", "name"),
    [
        ([3, 12], SceneError, "12"),
        ([-1, 3], SceneError, "-1"),
        ([0.5], SceneError, "box"),
        ([[0]], SceneError, "box"),
        ("lid", MeshError, "lid"),
    ],
)
def test_invalid_faces_raise(where, error, name):
    scene = hapscene.Scene()
    scene.add(BOX, name="box", unit="m")
    with pytest.raises(error, match=name):
        scene.paint("box", OAK, where)
    assert scene.swatches == [PLAIN]


def test_swatch_by_name_file_and_object(tmp_path):
    hapscene.save_swatch(SLATE, tmp_path / "slate.swatch")
    scene = hapscene.Scene()
    scene.add(BOX, name="box", unit="m", swatch=tmp_path / "slate.swatch")
    assert scene.swatch_index(str(tmp_path / "slate.swatch")) == 1
    assert scene.swatch_index(SLATE) == 1  # an equal swatch, not the same object
    assert scene.swatch_index("plain") == 0
    with pytest.raises(SceneError, match="slate"):
        scene.swatch_index(Swatch("slate"))
    with pytest.raises(SwatchError, match="oka"):
        scene.paint("box", "oka")
    with pytest.raises(SwatchError):
        scene.add(BOX, unit="m", swatch=tmp_path / "gone.swatch")
    assert len(scene.bodies) == 1


def flipped_ball(subdivisions, count):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    faces = np.array(ball.faces)
    faces[:count] = faces[:count, ::-1]
    return Mesh(np.array(ball.vertices), faces)


def test_mesh_without_area_warns():
    flat = Mesh([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0], [0.7, 0, 0]], [[0, 1, 2], [1, 2, 3]])
    with pytest.warns(MeshWarning, match="slab"):
        hapscene.Scene().add(flat, name="slab")
    many = np.tile(flat.faces, (1000, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hapscene.Scene().add(Mesh([*flat.vertices_m, [0, 1, 0]], [*many, [0, 1, 4]]), name="one has")


def test_mixed_winding_warns_once_unless_two_sided():
    mesh = flipped_ball(3, 100)
    scene = hapscene.Scene()
    with pytest.warns(MeshWarning, match="100 of 1,280") as caught:
        scene.add(mesh, name="ball")
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.add(mesh)  # an instance: no second warning
        hapscene.Scene().add(mesh, two_sided=True)
        hapscene.Scene().add(flipped_ball(3, 0))


def test_inward_winding_warns():
    with pytest.warns(MeshWarning, match="1,280"):
        hapscene.Scene().add(flipped_ball(3, 1280))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hapscene.Scene().add(flipped_ball(3, 1280), two_sided=True)
        ball = flipped_ball(3, 1280)
        hapscene.Scene().add(Mesh(ball.vertices_m, ball.faces[1:]))  # an open bowl, which may be intended


def test_attached_bodies_move_with_their_parent():
    scene = hapscene.Scene()
    mesh = hapscene.Mesh(vertices_m=np.eye(3), faces=np.array([[0, 1, 2]]))
    for name in "abcd":
        scene.add(mesh, name=name)
    scene.pose("b", translated(0.0, 1.0, 0.0))
    scene.attach("b", "a")
    scene.attach("c", "b")
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    scene.pose("a", quarter)
    assert scene.pose_count == 2
    np.testing.assert_allclose(scene.body("b").X_WB[:3, 3], (-1.0, 0.0, 0.0), atol=1e-15)
    np.testing.assert_array_equal(scene.body("c").X_WB, quarter)
    np.testing.assert_array_equal(scene.body("d").X_WB, np.eye(4))
    assert scene.copy().body("c").parent == "b"
    for parent in ("a", "b", "c"):
        with pytest.raises(SceneError):
            scene.attach("a", parent)
    scene.body("a").parent = "c"  # a cycle, set directly, must not loop forever
    scene.pose("a", np.eye(4))


def translated(*place_m):
    X = np.eye(4)
    X[:3, 3] = place_m
    return X
