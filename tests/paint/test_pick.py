"""Where a ray from the eye falls, and a ring laid on the surface, against closed forms."""

import numpy as np
import pytest
from trimesh.creation import icosphere

from hapscene.paint.pick import drape, middle, pick
from hapscene.paint.shape import Shape
from hapscene.scene.scene import Scene

from .conftest import mesh_of, plate_mesh

TURN = np.array([[0.0, 0.0, 1.0, 0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 1.0, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
"""A pose: (x, y, z) of the body are (y, z, x) of the world."""


def circle(radius_m: float, z_m: float = 0.0, count: int = 24) -> np.ndarray:
    turn = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return np.stack([radius_m * np.cos(turn), radius_m * np.sin(turn), np.full(count, z_m)], axis=1)


@pytest.fixture
def scene() -> Scene:
    scene = Scene()
    scene.add(mesh_of(icosphere(subdivisions=6, radius=0.02)), name="ball", pose=TURN)
    scene.add(plate_mesh(), name="plate")
    return scene


def in_world(p_B_m: np.ndarray) -> np.ndarray:
    return p_B_m @ TURN[:3, :3].T + TURN[:3, 3]


def test_a_ray_falls_on_the_nearest_body(scene) -> None:
    shapes = [Shape(body.mesh) for body in scene.bodies]
    hit = pick(scene.bodies, shapes, in_world(np.array([0.0, 0.0, 1.0])), TURN[:3, :3] @ [0.0, 0.0, -1.0])
    assert hit is not None and hit.body == 0
    np.testing.assert_allclose(hit.p_W_m, in_world(np.array([0.0, 0.0, 0.02])), atol=1e-5)
    assert hit.nhat_W @ TURN[:3, 2] == pytest.approx(1.0, abs=1e-3)
    assert pick(scene.bodies, shapes, np.array([0.0, 0.0, np.nan]), np.array([0.0, 0.0, 1.0])) is None


def test_a_ring_lies_on_a_ball(scene) -> None:
    shapes = [Shape(body.mesh) for body in scene.bodies]
    up = TURN[:3, :3] @ np.array([0.0, 0.0, 1.0])
    hit = pick(scene.bodies, shapes, in_world(np.array([0.0, 0.0, 1.0])), -up)
    assert hit is not None
    hit = hit.__class__(**{**vars(hit), "nhat_W": up})  # of the ball, not of a facet
    laid = drape(scene.bodies[0], shapes[0], hit, in_world(circle(0.01, 0.02)), 0.01)
    height = np.sqrt(0.02**2 - 0.01**2)
    np.testing.assert_allclose(laid, in_world(circle(0.01, height)), atol=2e-5)


def test_beside_the_body_a_ring_stays_in_its_plane(scene) -> None:
    shapes = [Shape(body.mesh) for body in scene.bodies]
    top = int(np.argmax(shapes[1].centroid_m @ [0.0, 0.0, 1.0] + 1e-3 * (shapes[1].centroid_m[:, 0] < -0.019)))
    hit = middle(scene.bodies, shapes, 1, top)
    ring = hit.p_W_m + circle(0.005)
    laid = drape(scene.bodies[1], shapes[1], hit, ring, 0.005)
    np.testing.assert_allclose(laid, ring, atol=1e-9)
    assert (ring[:, 0] < -0.02).any()  # some are beside it
