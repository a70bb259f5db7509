"""Packing a scene: meshes once, bodies at their poses, balls that hold them, records as attributes."""

import gc
import weakref

import numpy as np
import pytest
import trimesh

from hapscene.constants import SKIN_RATIO, SKIN_RATIO_MIN
from hapscene.contact.triangle import to_body, to_body_last, to_world
from hapscene.contact.world import BODY, FAR_M, HALF_TURN_COS2_MIN, build_world, shapes_of, skin_of, update_ball
from hapscene.records import records
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

X = trimesh.transformations.euler_matrix(0.3, -0.7, 1.1)
X[:3, 3] = (1.0, 2.0, 3.0)


def two_instances_and_a_ball() -> Scene:
    mesh = Mesh.from_trimesh(trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.2, 0.3]]), "m")
    scene = Scene()
    scene.add(mesh, name="a")
    scene.add(trimesh.creation.icosphere(subdivisions=1, radius=0.05), name="ball", unit="m")
    scene.add(mesh, name="b", pose=X, two_sided=True)
    return scene


def test_instances_share_mesh_and_search():
    bodies = build_world(two_instances_and_a_ball().bodies).bodies
    assert bodies[0].search == bodies[2].search != bodies[1].search
    assert (bodies[0].face, bodies[1].face, bodies[2].face) == (0, 12, 0)
    assert [b.two_sided for b in bodies] == [0, 0, 1]


def test_bodies_start_at_rest():
    body = build_world(two_instances_and_a_ball().bodies).bodies[2]
    np.testing.assert_array_equal(body.R_WB, X[:3, :3])
    np.testing.assert_array_equal(body.last_R_WB, X[:3, :3])
    np.testing.assert_array_equal(body.p_WB_m, (1, 2, 3))
    np.testing.assert_array_equal(body.last_p_WB_m, (1, 2, 3))
    assert body.moved == 0


def test_balls_contain_their_bodies():
    scene = two_instances_and_a_ball()
    world = build_world(scene.bodies)
    for body, ball in zip(scene.bodies, world.ball_W_m, strict=True):
        vertices = trimesh.transform_points(body.mesh.vertices_m, body.X_WB)
        distance = np.linalg.norm(vertices - ball[:3], axis=1).max()
        assert distance <= ball[3] < 1.01 * distance


@pytest.mark.parametrize(("radius_m", "far_m"), [(0.05, FAR_M), (2.0, 80.0)])
def test_the_tool_is_far_beyond_20_diameters_of_the_largest_body(radius_m: float, far_m: float) -> None:
    scene = Scene()
    for size_m in (radius_m, 0.05):
        scene.add(trimesh.creation.icosphere(subdivisions=1, radius=size_m), unit="m")
    assert build_world(scene.bodies).proxy[0].far_m == pytest.approx(far_m, rel=1e-4)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-3, 0.5, 2.0, 2.9, 3.1])
def test_ball_of_a_moving_body_contains_its_sweep(angle_rad):
    """A point that stands still sweeps a chord in the body's frame: where that meets the body, it lies in the ball."""
    rng = np.random.default_rng(int(10 * angle_rad))
    body, ball = records(1, BODY)[0], np.zeros(4)
    body.radius_m, body.skin_m, body.center_B_m = 0.05, 1e-6, rng.normal(size=3)
    was, now = trimesh.transformations.random_rotation_matrix(rng.random(3)), np.eye(4)
    turn = trimesh.transformations.rotation_matrix(angle_rad, rng.normal(size=3))
    now[:3, :3], now[:3, 3] = turn[:3, :3] @ was[:3, :3], rng.normal(size=3)
    before = rng.normal(size=3)
    body.R_WB, body.p_WB_m = was[:3, :3], before
    update_ball(body, ball)
    still = ball.copy()
    np.testing.assert_allclose(still, [*(was[:3, :3] @ body.center_B_m + before), 0.05 + 1e-6], rtol=1e-12)
    body.last_R_WB, body.last_p_WB_m, body.moved = was[:3, :3], before, 1
    body.R_WB, body.p_WB_m = now[:3, :3], now[:3, 3]
    nearer = update_ball(body, ball)
    way = np.linalg.norm(ball[:3] - still[:3])
    if np.cos(angle_rad / 2) ** 2 <= HALF_TURN_COS2_MIN:
        assert ball[3] == np.inf
        return
    assert nearer == pytest.approx(way + ball[3] - still[3])
    largest = 0.0
    for _ in range(2000):  # points whose chord touches the body: through a point on its sphere, at some time
        at_B = rng.normal(size=3)
        at_B = body.center_B_m + 0.05 * at_B / np.linalg.norm(at_B)
        s = rng.random()
        blend = (1 - s) * was[:3, :3].T + s * now[:3, :3].T
        shift = (1 - s) * was[:3, :3].T @ before + s * now[:3, :3].T @ now[:3, 3]
        p_W = np.linalg.solve(blend, at_B + shift)
        a, b = (np.array(to(body, tuple(p_W))) for to in (to_body_last, to_body))
        np.testing.assert_allclose(a + s * (b - a), at_B, atol=1e-9)
        largest = max(largest, float(np.linalg.norm(p_W - ball[:3])))
    assert largest <= ball[3] * (1 + 1e-9)
    if angle_rad == 0.0:
        assert ball[3] == pytest.approx(0.05 + 1e-6 + way)
    assert tuple(np.round(to_world(body, to_body(body, (1.0, 2.0, 3.0))), 9)) == (1.0, 2.0, 3.0)


def test_pushing_body_respects_the_plane_limit(world):
    """Four planes may be left by a tick that did not settle: a pushing body makes room before it adds its own."""
    from hapscene.contact.planes import copy_plane
    from hapscene.contact.proxy import _carry, move_proxy

    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    ball.apply_translation((0.1, 0.0, 0.02))
    w = world(trimesh.creation.box((0.1, 0.1, 0.02)), ball, at=(0.0, 0.0, 0.02))
    move_proxy(w, (0.0, 0.0, 0.005))
    proxy, pusher = w.proxy[0], w.bodies[1]
    assert proxy.count == 1
    for slot in (1, 2, 3):
        copy_plane(proxy, 0, slot)
    proxy.count = 4
    pusher.moved, pusher.p_WB_m = 1, (-0.09, 0.0, 0.0)
    update_ball(pusher, w.ball_W_m[1])
    w.near[:2], proxy.near_count = (0, 1), 2
    _carry(w, tuple(map(float, proxy.p_W_m)))
    assert proxy.count == 4 and proxy.body[3] == 1


def test_search_structures_live_as_long_as_the_bodies():
    scene = two_instances_and_a_ball()
    bodies = build_world(scene.bodies).bodies
    alive = [weakref.ref(search) for search in shapes_of(scene.bodies, 0.0).searches.values()]
    row = bodies[1]
    del bodies, scene
    gc.collect()
    assert len(alive) == 2 and all(search() is not None for search in alive)
    del row
    gc.collect()
    assert all(search() is None for search in alive)


def test_a_second_world_of_the_same_meshes_shares_them():
    scene = two_instances_and_a_ball()
    one, two = build_world(scene.bodies), build_world(scene.bodies)
    assert one.corners_m is two.corners_m and (one.bodies.search == two.bodies.search).all()
    assert one.bodies is not two.bodies and one.proxy is not two.proxy
    assert build_world(scene.bodies, 0.5).corners_m is not one.corners_m


@pytest.mark.parametrize(("large_m", "skin_m"), [(0.2, SKIN_RATIO * 0.1), (10.0, SKIN_RATIO_MIN * 10.0)])
def test_skin_follows_smallest_body_and_float32_limit(large_m: float, skin_m: float) -> None:
    small, large = (Mesh([[0, 0, 0], [0.6 * size, 0, 0], [0, 0.8 * size, 0]], [[0, 1, 2]]) for size in (0.1, large_m))
    assert skin_of(small) == pytest.approx(SKIN_RATIO * 0.1)
    assert skin_of(small, large, small) == pytest.approx(skin_m)
