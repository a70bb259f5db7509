"""Edge crossing by face adjacency: agrees with casts, stops at other faces, and reports missing adjacency."""

import numpy as np
import pytest
import trimesh

from hapscene.contact.proxy import move_proxy, place_proxy
from hapscene.contact.world import build_world
from hapscene.scene.scene import Scene


def world_of(*meshes: trimesh.Trimesh, known: bool = True, two_sided: bool = False):
    scene = Scene()
    for mesh in meshes:
        scene.add(mesh, unit="m", two_sided=two_sided)
    world = build_world(scene.bodies)
    if not known:
        world.corners_m[:, 3] = -1
    return world


def roof(angle_deg: float) -> trimesh.Trimesh:
    """Return two slopes that meet at x = 0, the second turned down by an angle (up if negative); 0.2 m long."""
    slope = np.radians(angle_deg)
    ridge = [[0, -0.1, 0], [0, 0.1, 0]]
    far = [[0.1 * np.cos(slope), y, -0.1 * np.sin(slope)] for y in (-0.1, 0.1)]
    near = [[-0.1, -0.1, 0], [-0.1, 0.1, 0]]
    return trimesh.Trimesh([*ridge, *far, *near], [[0, 2, 3], [0, 3, 1], [4, 0, 1], [4, 1, 5]], process=False)


def glide(world, start, *tools):
    """Return the proxy positions for a sequence of tool positions after `start`."""
    place_proxy(world, tuple(map(float, start)))
    return np.array([(move_proxy(world, tuple(map(float, tool))), world.proxy[0].p_WP_m.copy())[1] for tool in tools])


@pytest.mark.parametrize("angle_deg", [0.01, 20.0, -0.01, -60.0])
@pytest.mark.parametrize("two_sided", [False, True])
def test_edge_crossing_agrees_with_casts(angle_deg, two_sided) -> None:
    x = np.linspace(-0.004, 0.004, 101)
    tools = np.c_[x, 0.3 * x, np.full(len(x), -0.003)]
    known, alone = (
        glide(world_of(roof(angle_deg), known=known, two_sided=two_sided), (-0.004, 0, 0.01), *tools)
        for known in (True, False)
    )
    np.testing.assert_allclose(known, alone, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(2))
def test_proxy_stays_on_a_rough_surface(seed) -> None:
    rng = np.random.default_rng(seed)
    z = rng.normal(scale=0.0008, size=(40, 40))
    t = np.linspace(0.0, 6.0, 3000)
    tools = np.c_[0.03 * np.cos(t), 0.03 * np.sin(1.3 * t), -0.004 + 0.001 * np.sin(11 * t)]
    world = world_of(ground(z))
    found = glide(world, tools[0] + [0, 0, 0.02], *tools)
    height = height_over(z, found)
    assert height.min() > -20e-6 and height.max() < 100e-6


def height_over(z, p):
    """Return the height of points above a grid whose cells are split from the first to the third corner."""
    n = len(z)
    u, v = (p[:, 0] + 0.05) / 0.1 * (n - 1), (p[:, 1] + 0.05) / 0.1 * (n - 1)
    i, j = np.minimum(u.astype(int), n - 2), np.minimum(v.astype(int), n - 2)
    u, v = u - i, v - j
    a, b, c, d = z[i, j], z[i + 1, j], z[i + 1, j + 1], z[i, j + 1]
    return p[:, 2] - np.where(u >= v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))


def ground(z) -> trimesh.Trimesh:
    """Return a grid of heights (n, n) over 0.1 m by 0.1 m, with cells split from the first to the third corner."""
    n = len(z)
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, n), np.linspace(-0.05, 0.05, n), indexing="ij")
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    return trimesh.Trimesh(np.c_[x.ravel(), y.ravel(), z.ravel()], np.r_[np.c_[a, b, c], np.c_[a, c, d]], process=False)


def test_plane_of_a_facet_is_dropped_beyond_its_edge() -> None:
    """In one tick across a floor of small faces to a pillar and halfway around it."""
    pillar = trimesh.creation.cylinder(radius=1e-3, segment=[[0, 0, -0.01], [0, 0, 0.01]], sections=64)
    goal = np.array([0.0005, -0.0009, -0.001])
    found = glide(
        world_of(ground(np.zeros((101, 101))), pillar), (-0.002, -0.0002, 0.005), (-0.002, -0.0002, -0.001), goal
    )
    np.testing.assert_allclose(found[-1], goal * [1, 1, 0], rtol=0.0, atol=1e-8)


def test_jump_over_a_slot_ends_on_the_far_side() -> None:
    """In one tick along a 20 mm block with a slot in the middle, 0.2 mm below its top."""
    outline = [[-10, 0], [-1, 0], [-0.9, -5], [0.9, -5], [1, 0], [10, 0]]
    vertices = 1e-3 * np.array([[x, y, z] for x, z in outline for y in (-10, 10)])
    k = 2 * np.arange(len(outline) - 1)
    block = trimesh.Trimesh(vertices, np.r_[np.c_[k, k + 2, k + 3], np.c_[k, k + 3, k + 1]], process=False)
    found = glide(world_of(block), (0.006, 0.001, 0.005), (0.006, 0.001, -0.0002), (-0.0088, 0.001, -0.0002))
    np.testing.assert_allclose(found, [[0.006, 0.001, 0.0], [-0.0088, 0.001, 0.0]], rtol=0.0, atol=1e-9)


def test_degenerate_faces_do_not_hold_the_proxy() -> None:
    """Between the slopes lies a strip below the resolution of the search, or one of width 0."""
    strip = 2e-7
    for width in (strip, 0.0):
        vertices = [[-0.1, -0.1, 0], [0, -0.1, 0], [0, 0.1, 0], [-0.1, 0.1, 0]]
        vertices += [[width, -0.1, 0], [width, 0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0]]
        faces = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2], [4, 6, 7], [4, 7, 5]]
        world = world_of(trimesh.Trimesh(vertices, faces, process=False))
        tools = np.c_[np.linspace(-0.003, 0.003, 61), np.zeros(61), np.full(61, -0.002)]
        found = glide(world, (-0.003, 0, 0.01), *tools)
        np.testing.assert_allclose(found, tools * [1, 1, 0], atol=1e-9)
        assert world.proxy[0].face[0] in (4, 5)
