"""The proxy (god-object): agrees with closed forms, never crosses a face, lies on the surface in contact, and returns
after a closed tour."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.constants import CAST_MAX, NEAR_MAX
from hapscene.contact.proxy import move_proxy, place_proxy
from hapscene.contact.world import World, build_world
from hapscene.flags import Flag
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

MICRON = 1e-6
TURN = trimesh.transformations.euler_matrix(0.3, -0.7, 1.1)[:3, :3]
PLACES = [
    pytest.param(np.eye(3), 0.0, id="at the origin"),
    pytest.param(TURN, 0.0, id="turned"),
    pytest.param(TURN, 10.0, id="turned, 10 m away"),
]
BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])


def play(meshes, path, poses=None, two_sided=False):
    scene = Scene()
    for i, mesh in enumerate(meshes):
        scene.add(mesh, name=f"body {i}", unit="m", two_sided=two_sided)
    return Renderer(scene, effects=["wall"]).run(path, poses=poses)


def between(points, ticks: int = 200) -> np.ndarray:
    """Return a path of straight lines between points, `ticks` each."""
    s = np.linspace(0, 1, ticks, endpoint=False)[:, None]
    legs = [a + (b - a) * s for a, b in zip(np.array(points)[:-1], np.array(points)[1:], strict=True)]
    return np.concatenate([*legs, np.array(points)[-1:]])


def placed(mesh, R, offset_m) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices @ R.T + offset_m, mesh.faces, process=False)


def prism(outline) -> trimesh.Trimesh:
    """Return a prism along y, 0.1 m long, over a star-shaped outline (n, 2) in x and z."""
    outline = np.array(outline)
    n = len(outline)
    front, back = (np.insert(outline, 1, y, axis=1) for y in (-0.05, 0.05))
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
    faces = np.concatenate([fan, fan[:, ::-1] + n, np.c_[i, i + n, j], np.c_[j, i + n, j + n]])
    mesh = trimesh.Trimesh(np.concatenate([front, back]), faces, process=False)
    assert mesh.is_watertight and mesh.volume > 0
    return mesh


@pytest.mark.parametrize(("R", "offset_m"), PLACES)
def test_plane(R, offset_m):
    path = between([(0, 0, 0.01), (0, 0, -0.005), (0.03, -0.02, -0.01), (-0.04, 0.03, -0.001)])
    r = play([placed(BOX, R, offset_m)], path @ R.T + offset_m)
    p = (r.p_WP_m - offset_m) @ R
    np.testing.assert_allclose(p, np.c_[path[:, :2], np.maximum(path[:, 2], 0)], atol=MICRON)
    pressed = path[:, 2] < -1e-4
    assert r.touching[pressed].all()
    np.testing.assert_allclose(r.f_W_N[pressed] @ R, -500 * path[pressed, 2:] * [0, 0, 1], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(("R", "offset_m"), PLACES)
@pytest.mark.parametrize("angle_deg", [5, 90])
def test_groove(R, offset_m, angle_deg):
    """Pressed into the groove, the proxy settles at the bottom, 10 mm down; also exactly on the plane of symmetry."""
    h = 0.01 * np.tan(np.radians(angle_deg / 2))
    groove = prism([(0, -0.01), (-h, 0), (-0.05, 0), (-0.05, -0.03), (0.05, -0.03), (0.05, 0), (h, 0)])
    path = between([(0, 0, 0.005), (0, 0, -0.012), (0, 0.03, -0.012), (0.0004, -0.03, -0.012)])
    r = play([placed(groove, R, offset_m)], path @ R.T + offset_m)
    p = ((r.p_WP_m - offset_m) @ R)[200:]
    np.testing.assert_allclose(p, path[200:] * [0, 1, 0] + [0, 0, -0.01], atol=MICRON)


@pytest.mark.parametrize(("R", "offset_m"), PLACES)
def test_corner_of_three_planes(R, offset_m):
    cells = [(i, j, k) for i in range(2) for j in range(2) for k in range(2) if (i, j, k) != (1, 1, 1)]
    parts = [trimesh.creation.box(bounds=[np.array(c) - 1.0, np.array(c)]) for c in cells]
    corner = trimesh.util.concatenate(parts).apply_scale(0.05)
    path = between([(0.02, 0.02, 0.02), (-0.01, -0.02, -0.03), (-0.01, -0.02, 0.03), (-0.01, 0.02, 0.03)])
    r = play([placed(corner, R, offset_m)], path @ R.T + offset_m)
    np.testing.assert_allclose((r.p_WP_m - offset_m) @ R, np.maximum(path, 0.0), atol=MICRON)


def assert_at_the_foot(mesh, path, p, face):
    """The proxy (n, 3) is the tool's foot on the plane of the touched face, and lies on that face."""
    normal, corner = mesh.face_normals[face], mesh.triangles[face, 0]
    depth = np.einsum("ij,ij->i", normal, corner - path)
    np.testing.assert_allclose(p, path + depth[:, None] * normal, atol=MICRON)
    on_um = trimesh.triangles.closest_point(mesh.triangles[face] / MICRON, p / MICRON)  # its tolerances are absolute
    assert np.linalg.norm(on_um - p / MICRON, axis=1).max() < 1.0


def orbit(tool) -> np.ndarray:
    """Return a path with an approach from outside to its first point."""
    return np.concatenate([between([1.2 * tool[0], tool[0]], 50), tool])


@pytest.mark.parametrize(("R", "offset_m"), PLACES)
def test_cylinder(R, offset_m):
    mesh = trimesh.creation.cylinder(radius=0.05, height=0.1, sections=96)
    turn = np.linspace(0, 2, 1500)
    path = orbit(np.c_[0.047 * np.cos(turn), 0.047 * np.sin(turn), 0.02 * np.sin(3 * turn)])
    r = play([placed(mesh, R, offset_m)], path @ R.T + offset_m)
    assert r.touching[51:].all()
    assert_at_the_foot(mesh, path[51:], ((r.p_WP_m - offset_m) @ R)[51:], r.face[51:])
    np.testing.assert_allclose(
        np.linalg.norm(r.f_W_N, axis=1), 500 * np.linalg.norm(r.p_WP_m - r.p_WT_m, axis=1), rtol=1e-3
    )


def work_of_a_tour(mesh, height_m) -> tuple[float, float]:
    """Return ∮ F · dx and ∮ |F · dx| over a closed tour in contact [J]."""
    t = np.linspace(0, 2 * np.pi, 20_001)
    tour = np.c_[0.01 * np.cos(t), 0.008 * np.sin(t), height_m - 0.003 + 0.001 * np.sin(3 * t)]
    r = play([mesh], np.concatenate([between([tour[0] + [0, 0, 0.01], tour[0]]), tour, tour]))
    f = r.f_W_N[-len(tour) :]
    assert r.touching[-len(tour) :].all()
    np.testing.assert_allclose(r.p_WP_m[-1], r.p_WP_m[-len(tour)], atol=MICRON)
    each = ((f[1:] + f[:-1]) / 2 * np.diff(tour, axis=0)).sum(axis=1)
    return float(each.sum()), float(np.abs(each).sum())


def test_closed_tour_over_facets_generates_no_work():
    """Slipping over a convex edge dissipates a little of the stored energy, and never generates any."""
    work_J, effort_J = work_of_a_tour(trimesh.creation.icosphere(subdivisions=3, radius=0.05), 0.05)
    assert -0.02 * effort_J < work_J < 1e-6 * effort_J


def test_thin_wall_stops_a_fast_tool():
    for wall_m, speed_m_s in ((2e-4, 5.0), (1e-3, 2.0)):
        wall = trimesh.creation.box(bounds=[[-0.05, -0.05, -wall_m], [0.05, 0.05, 0.0]])
        z = np.arange(0.0303, -0.03, -1e-3 * speed_m_s)
        r = play([wall], np.c_[0 * z + 0.003, 0 * z, z])
        np.testing.assert_allclose(r.p_WP_m[:, 2], np.maximum(z, 0), atol=MICRON)


@pytest.mark.parametrize(("width_a_m", "width_b_m"), [(0.1, 0.01), (0.05, 1.0)])
def test_proxy_slides_over_the_seam_between_bodies(width_a_m, width_b_m):
    a = trimesh.creation.box(bounds=[[-width_a_m, -width_a_m, -width_a_m], [0, width_a_m, 0]])
    b = trimesh.creation.box(bounds=[[0, -width_b_m, -width_b_m], [width_b_m, width_b_m, 0]])
    path = between([(-0.008, 0, 0.001), (-0.008, 0, -0.0005), (0.008, 0.001, -0.0005), (-0.008, 0, -0.0005)])
    r = play([a, b], path)
    np.testing.assert_allclose(r.p_WP_m, np.c_[path[:, :2], np.maximum(path[:, 2], 0)], atol=MICRON)


# --- bodies that move


def moved(ticks, offsets_m) -> np.ndarray:
    X = np.tile(np.eye(4), (ticks, 1, 1))
    X[:, :3, 3] = offsets_m
    return X


def test_rotating_plate_pushes_the_proxy():
    plate = trimesh.creation.box(bounds=[[0, -0.05, -0.001], [0.1, 0.05, 0.001]])
    angle = np.linspace(-0.6, 0.6, 600)
    X = np.array([trimesh.transformations.rotation_matrix(-a, (0, 1, 0)) for a in angle])
    tool = np.array([0.06, 0.0, 0.003])
    r = play([plate], np.tile(tool, (600, 1)), {"body 0": X})
    p_B = np.einsum("tji,tj->ti", X[:, :3, :3], r.p_WP_m)
    tool_B = np.einsum("tji,j->ti", X[:, :3, :3], tool)
    np.testing.assert_allclose(p_B[:, 2], np.maximum(tool_B[:, 2], 0.001), atol=MICRON)
    np.testing.assert_allclose(p_B[:, :2], tool_B[:, :2], atol=MICRON)


@pytest.mark.parametrize("speed_m_s", [0.05, 0.5, 2.0])
def test_moving_floor_does_not_carry_the_proxy_through_a_wall(speed_m_s):
    """The tool rests and presses on a moving floor in front of a wall of 0.2 mm."""
    wall = trimesh.creation.box(bounds=[[0.03, -0.05, -0.05], [0.0302, 0.05, 0.05]])
    tool = between([(0.0295, 0, 0.005), (0.0295, 0, -0.005), (0.0295, 0, -0.005)], 100)
    slide = np.clip((np.arange(201) - 120) * 1e-3 * speed_m_s, 0, 0.03)
    r = play([BOX, wall], tool, {"body 0": moved(201, slide[:, None] * [1, 0, 0])})
    np.testing.assert_allclose(r.p_WP_m, np.maximum(tool, (-1, -1, 0)), atol=MICRON)
    assert not r.flags.any()


def test_squeezed_tool_is_released():
    ticks = 400
    gap = np.abs(np.linspace(0.01, -0.01, ticks)) + 1e-4
    upper = trimesh.creation.box(bounds=[[-0.05, -0.05, 0], [0.05, 0.05, 0.02]])
    poses = {
        "body 0": moved(ticks, -gap[:, None] / 2 * [0, 0, 1]),
        "body 1": moved(ticks, gap[:, None] / 2 * [0, 0, 1]),
    }
    r = play([BOX, upper], np.tile([0.0, 0.0, 0.002], (ticks, 1)), poses)
    assert (np.abs(r.p_WP_m[:, 2]) <= gap / 2 + MICRON).all()
    assert not r.touching[[0, -1]].any()


@pytest.mark.parametrize("start", range(6))
def test_contact_from_a_start_on_the_surface(start):
    """The tool starts exactly on a face, an edge or a corner, of a body at rest or at its first pose."""
    rng = np.random.default_rng(start)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    X = trimesh.transformations.random_rotation_matrix(rng.random(3))
    X[:3, 3] = rng.normal(size=3)
    weights = [(1, 0, 0), (0.5, 0.5, 0), tuple(rng.dirichlet((1, 1, 1)))][start % 3]
    on_B = np.array(weights) @ ball.triangles[rng.integers(len(ball.faces))]
    on, into = X[:3, :3] @ on_B + X[:3, 3], X[:3, :3] @ -on_B / np.linalg.norm(on_B)
    path = on + np.arange(30)[:, None] * 1e-4 * into
    standing = trimesh.Trimesh(trimesh.transform_points(ball.vertices, X), ball.faces, process=False)
    assert play([standing], path).touching[3:].all()
    assert play([ball], path, {"body 0": np.tile(X, (30, 1, 1))}).touching[3:].all()


# --- properties for random paths

SHAPES = {
    "box": BOX,
    "ball": trimesh.creation.icosphere(subdivisions=2, radius=0.05),
    "groove": prism([(0, -0.01), (-0.01, 0), (-0.05, 0), (-0.05, -0.03), (0.05, -0.03), (0.05, 0), (0.01, 0)]),
    "knife": prism([(0, 0.05), (-0.005, -0.05), (0.005, -0.05)]),
    "plate": trimesh.creation.box(extents=(0.1, 0.1, 0.002)),
}
points = st.tuples(*[st.floats(-0.08, 0.08, allow_subnormal=False)] * 3)
tours = st.lists(points, min_size=2, max_size=6)


def solid_angle(mesh, points_m) -> np.ndarray:
    """Winding number of a closed mesh around points: 1 inside, 0 outside (Van Oosterom & Strackee 1983)."""
    a, b, c = (mesh.triangles[None, :, k] - points_m[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    over = np.einsum("pfi,pfi->pf", a, np.cross(b, c))
    under = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    return np.arctan2(over, under).sum(axis=1) / (2 * np.pi)


def distance(mesh, points_m) -> np.ndarray:
    """From points to the nearest face [m]."""
    from trimesh.triangles import closest_point

    count = len(mesh.faces)
    return np.array(
        [
            np.linalg.norm(closest_point(mesh.triangles / MICRON, np.tile(p, (count, 1))) - p, axis=1).min() * MICRON
            for p in points_m / MICRON
        ]
    )


@pytest.mark.parametrize("two_sided", [False, True], ids=["outward", "two-sided"])
@pytest.mark.parametrize("shape", SHAPES)
@settings(max_examples=12, deadline=None)
@given(tour=tours)
def test_proxy_stays_outside_and_on_the_surface(shape, two_sided, tour):
    mesh = SHAPES[shape]
    path = between([(0.09, 0.09, 0.09), *tour], 40)
    r = play([mesh], path, two_sided=two_sided)
    assert np.isfinite(r.p_WP_m).all() and np.isfinite(r.f_W_N).all()
    off = distance(mesh, r.p_WP_m)
    inside = solid_angle(mesh, r.p_WP_m) > 0.5
    assert not (inside & (off > 2 * MICRON)).any()
    assert off[r.touching].max(initial=0.0) < 2 * MICRON  # within a skin at an edge
    np.testing.assert_array_equal(r.p_WP_m[~r.touching], path[~r.touching])


@settings(max_examples=20, deadline=None)
@given(tour=st.lists(st.tuples(*[st.floats(-0.03, 0.03)] * 2, st.floats(-0.015, -0.001)), min_size=2, max_size=5))
def test_proxy_returns_after_a_closed_tour(tour):
    """Over one plane, the proxy returns to its start."""
    path = between([(0, 0, 0.01), tour[0], *tour[1:], tour[0]], 30)
    r = play([BOX], path)
    np.testing.assert_allclose(r.p_WP_m[-1], r.p_WP_m[30], atol=1e-9)


def test_placing_the_proxy_in_free_space():
    scene = Scene()
    scene.add(BOX, unit="m")
    world = build_world(scene.bodies)
    place_proxy(world, (0.01, 0.02, 0.03))
    assert tuple(world.proxy[0].p_W_m) == (0.01, 0.02, 0.03)
    assert move_proxy(world, (0.01, 0.02, 0.02))
    assert (world.proxy[0].count, world.proxy[0].touching) == (0, 0)
    assert tuple(world.proxy[0].p_WP_m) == (0.01, 0.02, 0.02)


# --- more bodies than a tick can test

ROUND = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
BALL = Mesh.from_trimesh(ROUND, "m")
LARGER = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=0.051), "m")
CUBE = Mesh.from_trimesh(trimesh.creation.box(extents=(0.1, 0.1, 0.1)), "m")
THROUGH = (0.001, 0.0005, -0.045)


def pressed(*meshes: Mesh) -> World:
    """Return bodies at the origin, with the tool 5 mm below the top of a ball of 0.05 m."""
    scene = Scene()
    for mesh in meshes:
        scene.add(mesh)
    world = build_world(scene.bodies)
    place_proxy(world, (0.0, 0.0, 0.06))
    for z in (0.0515, 0.0509, 0.0504, 0.049, 0.045):
        assert move_proxy(world, (0.0, 0.0, z))
    return world


def test_coincident_bodies_equal_one_body():
    one, many = pressed(BALL), pressed(*[BALL] * (3 * NEAR_MAX))
    proxy = many.proxy[0]
    assert proxy.near_flags == Flag.CROWDED and proxy.near_count == NEAR_MAX
    assert one.proxy[0].near_flags == 0
    np.testing.assert_allclose(proxy.p_WP_m, one.proxy[0].p_WP_m, atol=MICRON)
    for _ in range(2):  # leaves all bodies
        move_proxy(many, (0.0, 0.0, 0.2))
    assert proxy.near_flags == 0 and proxy.touching == 0


def test_body_in_contact_is_listed_among_many():
    world = pressed(*[BALL] * (NEAR_MAX + 50), LARGER)
    proxy = world.proxy[0]
    assert proxy.near_flags == Flag.CROWDED and proxy.near_count == NEAR_MAX + 1
    assert proxy.body[0] == NEAR_MAX + 50
    assert np.linalg.norm(proxy.p_WP_m) > 0.0509


@pytest.mark.parametrize("moves", [8, 9])  # the last move drops a plane, or adds one
def test_unsettled_tick_leaves_the_proxy_outside(moves):
    """The tool cuts straight through many bodies, which takes several ticks; the result equals that of one body."""
    one, many = pressed(BALL), pressed(*[BALL] * (CAST_MAX // moves))
    assert move_proxy(one, THROUGH)
    proxy, settled = many.proxy[0], []
    while not settled or not settled[-1]:
        settled.append(move_proxy(many, THROUGH))
        off = distance(ROUND, proxy.p_WP_m[None])[0]
        assert proxy.touching == 1 and off < 2 * proxy.skin_m[0]
        assert settled[-1] or np.array_equal(proxy.p_WP_m, proxy.p_W_m)
        assert len(settled) < 9
    assert len(settled) > 1
    np.testing.assert_allclose(proxy.p_WP_m, one.proxy[0].p_WP_m, atol=MICRON)


def overlapping(count: int) -> Scene:
    """Return cubes at one position, and one elsewhere."""
    scene = Scene()
    for _ in range(count):
        scene.add(CUBE)
    scene.add(CUBE, name="apart", pose=trimesh.transformations.translation_matrix((9.0, 0.0, 0.0)))
    return scene


def test_too_many_overlapping_bodies_are_flagged():
    renderer = Renderer(overlapping(300), effects=["wall"])
    path = between([(0.0, 0.0, 0.06), (0.01, 0.0, 0.045)], 40)
    recording = renderer.run(path)
    assert (recording.flags[recording.touching] == Flag.CROWDED).all()
    np.testing.assert_allclose(recording.f_W_N[-1], (0.0, 0.0, 2.5), rtol=1e-6, atol=1e-9)
