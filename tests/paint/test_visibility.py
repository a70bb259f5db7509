"""What the eye sees is painted, and nothing else; unless one paints through."""

import numpy as np
import pytest
from trimesh.creation import box, icosphere

from hapscene.paint.model.mesh import MANY, WIDE, Visibility, visible_points
from hapscene.paint.model.session import Session
from hapscene.scene.fine_paint import finest_of, parts
from hapscene.scene.scene import Scene
from tests.subface_areas import areas_m2

from .conftest import mesh_of, plate_mesh, turned

EYE = np.array([0.0, 0.0, 0.3])
DOWN = np.array([0.0, 0.0, -1.0])


def bowl() -> object:
    """A ball without its top: its inside is a back, and is not drawn."""
    ball = icosphere(subdivisions=3, radius=0.02)
    ball.update_faces(ball.triangles_center[:, 2] < 0.012)
    return mesh_of(ball)


def test_back_faces_are_hit_only_if_two_sided() -> None:
    for two_sided in (False, True):
        scene = Scene()
        scene.add(bowl(), name="bowl", swatch="wood", two_sided=two_sided)
        session = Session(scene)
        assert session.pick(EYE, DOWN) is not None
        assert (session.pick(EYE, DOWN, visible_only=True) is not None) is two_sided
        session.begin_stroke("plain", 0.004)
        assert (session.drag_to(EYE, DOWN) is not None) is two_sided
        assert bool(session.end_stroke()) is two_sided


def test_other_side_of_a_thin_wall_and_hidden_bodies_are_not_painted() -> None:
    scene = Scene()
    scene.add(plate_mesh(0.001), name="upper")
    scene.add(plate_mesh(0.001), name="lower", pose=turned(0.0, (0.0, 0.0, -0.003)))
    session = Session(scene)
    session.add_swatch("wood")
    session.begin_stroke("wood", 0.006)
    session.drag_to(EYE, DOWN)
    session.end_stroke()
    seen_z = scene.bodies[0].mesh.triangles_m.mean(axis=1)[scene.bodies[0].face_swatch == 1][:, 2]
    assert len(seen_z) and (seen_z == 0.0005).all()
    for eye in (EYE, None):
        session.fill_sphere([0.0, 0.0, 0.0], 0.008, "wood", eye_W_m=eye)
        through = eye is None
        assert (scene.bodies[1].face_swatch == 1).any() == through
        low = scene.bodies[0].mesh.triangles_m.mean(axis=1)[:, 2] < 0
        assert (scene.bodies[0].face_swatch[low] == 1).any() == through


def test_from_afar_a_plate_hides_what_is_close_behind_it() -> None:
    scene = Scene()
    for name, z_m in (("upper", 0.0), ("lower", -0.003)):
        scene.add(plate_mesh(0.001), name=name, pose=turned(0.0, (0.0, 0.0, z_m)))
    x, y, z = np.random.default_rng(0).uniform(-0.019, 0.019, (3, 200))
    top = z > 0.0
    points = np.stack([x, y, np.where(top, 0.0005, -0.0025)], axis=1)
    for far_m in (0.01, 1.0, 1e5):
        seen = visible_points(scene.bodies, Session(scene).shapes, points, (0.0, 0.0, far_m))
        np.testing.assert_array_equal(seen, top)


def test_a_sheet_close_behind_another_of_the_same_body_is_not_painted() -> None:
    sheets = [box((0.04, 0.04, 1e-4)).subdivide().subdivide().subdivide() for _ in range(2)]
    sheets[1].apply_translation((0.0, 0.0, 3e-4))
    scene = Scene()
    scene.add(mesh_of(sheets[0] + sheets[1]), name="sheets")
    session = Session(scene)
    session.add_swatch("wood")
    session.begin_stroke("wood", 0.008)
    session.drag_to(EYE, DOWN)
    session.end_stroke()
    body = scene.bodies[0]
    assert body.fine is not None
    wood = np.concatenate([np.flatnonzero(body.face_swatch == 1), body.fine.face[parts(body.fine.paint)[0] == 1]])
    assert len(wood) > 4 and (body.mesh.triangles_m.mean(axis=1)[wood, 2] > 3e-4).all()


@pytest.mark.parametrize("tool", ["sphere", "brush"])
def test_partly_occluded_face_is_painted_where_visible(tool: str) -> None:
    scene = Scene()
    scene.add(mesh_of(box((0.2, 0.2, 0.01))), name="plate")
    scene.add(mesh_of(icosphere(subdivisions=4, radius=0.02)), name="ball", pose=turned(0.0, (0.0, 0.0, 0.06)))
    session = Session(scene)
    wood, eye, body = session.add_swatch("wood"), np.array([0.03, 0.02, 0.3]), scene.bodies[0]
    if tool == "sphere":
        session.fill_sphere(np.zeros(3), 1.0, wood, eye_W_m=eye)
    else:
        session.begin_stroke(wood, 0.1)
        session.drag_to(eye, np.array([0.028, 0.0, 0.005]) - eye)
        session.end_stroke()
    rng = np.random.default_rng(0)
    top = [int(f) for f in np.flatnonzero(body.mesh.normals[:, 2] > 0.9)]
    wrong_m, hidden_count = [0.0], 0
    for weight in rng.dirichlet([1.0, 1.0, 1.0], 2000):
        face = top[rng.integers(2)]
        p = weight @ body.mesh.triangles_m[face]
        if tool == "brush" and np.linalg.norm(p - [0.028, 0.0, 0.005]) > 0.099:
            continue
        found = None if body.fine is None else body.fine.at(face, weight)
        painted = (body.face_swatch[face] if found is None else parts(found)[0]) == wood
        towards = (eye - p) / np.linalg.norm(eye - p)
        by_m = float(np.linalg.norm(np.cross(np.array([0.0, 0.0, 0.06]) - p, towards))) - 0.02  # off the ball's border
        hidden_count += by_m < 0.0
        if painted == (by_m < 0.0):
            wrong_m.append(abs(by_m))
    assert hidden_count > 50
    assert max(wrong_m) < finest_of(body.mesh) + 0.02 * (1 - np.cos(np.pi / 50))  # the ball is of facets


def test_parts_are_cut_above_a_width_that_grows_with_their_number() -> None:
    scene = Scene()
    scene.add(plate_mesh(0.001), name="plate")
    look, away_m = Visibility(scene.bodies, Session(scene).shapes, 0, EYE), EYE[2] - 0.0005
    for count, times in ((100, 0.9), (100, 1.1), (2 * MANY, 1.9), (2 * MANY, 2.1)):
        side_m = times * WIDE * away_m
        triangle = np.array([(-side_m / 2, -1e-3, 0.0005), (side_m / 2, -1e-3, 0.0005), (0.0, 2e-3, 0.0005)])
        seen, partly = look(np.tile(triangle, (count, 1, 1)), np.ones(count, np.uint8))
        assert seen.all() and (partly == (times in (1.1, 2.1))).all()


def test_narrow_occluder_is_detected() -> None:
    scene = Scene()
    scene.add(mesh_of(box((0.2, 0.2, 0.01))), name="plate")
    scene.add(mesh_of(box((0.0015, 0.3, 0.001))), name="wire", pose=turned(0.0, (0.013, 0.0, 0.06)))
    session = Session(scene)
    wood, body = session.add_swatch("wood"), scene.bodies[0]
    session.fill_sphere(np.zeros(3), 1.0, wood, eye_W_m=EYE)
    assert body.fine is not None
    bare = parts(body.fine.paint)[0] != wood
    up = body.mesh.normals[body.fine.face][:, 2] > 0.9
    area_m2 = areas_m2(body.fine, body.mesh)[bare & up].sum()
    wide_m = 0.0015 * (0.3 - 0.005) / (0.3 - 0.0605)  # of the shadow of its upper side
    assert area_m2 == pytest.approx(0.2 * wide_m, rel=0.15)
