"""What the eye sees is painted, and nothing else; unless one paints through."""

import numpy as np
import pytest
from trimesh.creation import box, icosphere

from hapscene.paint.session import Session
from hapscene.paint.visibility import seen_places
from hapscene.scene.scene import Scene

from .conftest import mesh_of, plate_mesh, turned

EYE = np.array([0.0, 0.0, 0.3])
DOWN = np.array([0.0, 0.0, -1.0])


def bowl() -> object:
    """A ball without its top: its inside is a back, and is not drawn."""
    ball = icosphere(subdivisions=3, radius=0.02)
    ball.update_faces(ball.triangles_center[:, 2] < 0.012)
    return mesh_of(ball)


def test_the_back_of_a_face_is_not_hit_and_a_two_sided_one_is() -> None:
    for two_sided in (False, True):
        scene = Scene()
        scene.add(bowl(), name="bowl", swatch="wood", two_sided=two_sided)
        session = Session(scene)
        assert session.pick(EYE, DOWN) is not None
        assert (session.pick(EYE, DOWN, seen=True) is not None) is two_sided
        session.begin_stroke("plain", 0.004)
        assert (session.drag_to(EYE, DOWN) is not None) is two_sided
        assert bool(session.end_stroke()) is two_sided


def test_a_thin_wall_keeps_its_other_side_and_hidden_bodies_their_paint() -> None:
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


@pytest.mark.parametrize("away_m", [0.1, 5.0])
def test_against_rays_over_all_faces(away_m: float) -> None:
    scene = Scene()
    scene.add(mesh_of(icosphere(subdivisions=2, radius=0.02)), name="ball")
    cube = mesh_of(box((0.01, 0.01, 0.01)))
    scene.add(cube, name="cube", pose=turned(0.0, (0.0, 0.0, 0.03)))
    session = Session(scene)
    eye = np.array([0.3, 0.2, 1.0]) * away_m
    for body in scene.bodies:
        p_W = body.mesh.triangles_m.mean(axis=1) + body.X_WB[:3, 3]
        found = seen_places(scene.bodies, session.shapes, p_W, eye)
        for p, seen in zip(p_W, found, strict=True):
            hidden = False
            for other in scene.bodies:
                a, b, c = np.moveaxis(other.mesh.triangles_m + other.X_WB[:3, 3], 1, 0)
                n, d = np.cross(b - a, c - a), p - eye
                under = n @ d
                t = np.einsum("ij,ij->i", n, a - eye) / np.where(under == 0.0, np.inf, under)
                x = eye + t[:, None] * d
                inside = np.ones(len(a), bool)
                for u, v in ((a, b), (b, c), (c, a)):
                    inside &= np.einsum("ij,ij->i", np.cross(v - u, x - u), n) >= 0.0
                before = (t > 0.0) & (t < 1.0 - 1e-4 / np.linalg.norm(d))
                hidden |= bool((inside & (under < 0.0) & before).any())
            assert seen == (not hidden)
