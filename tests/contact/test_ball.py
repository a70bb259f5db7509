"""A tool with a tip radius: agrees with closed forms, and is never nearer to a mesh than its radius (`trimesh`)."""

import warnings
from functools import cache
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from hapscene.device.model import DeviceWarning
from hapscene.errors import HapsceneError, UsageWarning
from hapscene.flags import Flag
from hapscene.loop.twin import Twin
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from tests.contact.test_proxy import BOX, PLACES
from tests.contact.test_puncture import BREAK

R_M = 0.005
CLOSE_M = 3e-6
SHARED = Path("../shared/data/meshes")


def renderer(*meshes, radius_m: float = R_M, **more) -> Renderer:
    scene = Scene()
    for i, mesh in enumerate(meshes):
        scene.add(mesh, name=f"body {i}", unit="m")
    return Renderer(scene, effects=["wall"], tip_radius_m=radius_m, **more)


def between(points, ticks: int = 200) -> np.ndarray:
    """Return a path of straight lines between points, `ticks` each."""
    points = np.array(points, float)
    s = np.linspace(0, 1, ticks, endpoint=False)[:, None]
    return np.concatenate([a + (b - a) * s for a, b in pairwise(points)] + [points[-1:]])


def sheet(corners) -> trimesh.Trimesh:
    """Return a quadrilateral of two triangles."""
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def plate_with_hole(radius_m: float, count: int = 64) -> trimesh.Trimesh:
    """Return a sheet in z = 0 around a regular polygon with this inradius."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    ring = np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    i, j = np.arange(count), np.roll(np.arange(count), -1)
    faces = np.concatenate((np.c_[i, i + count, j], np.c_[j, i + count, j + count]))
    inner_m = radius_m / np.cos(np.pi / count)
    return trimesh.Trimesh(np.concatenate((inner_m * ring, 0.05 * ring)), faces, process=False)


def distance_m(mesh, points) -> np.ndarray:
    """Return the distances of points from a mesh, by `trimesh.triangles.closest_point` of all faces that come near."""
    triangles = mesh.vertices[mesh.faces]
    middle = triangles.mean(axis=1)
    size_m = np.linalg.norm(triangles - middle[:, None], axis=2).max()
    tree, least = cKDTree(middle), np.empty(len(points))
    for k, p in enumerate(points):
        near = tree.query_ball_point(p, tree.query(p)[0] + 2 * size_m)
        found = trimesh.triangles.closest_point(triangles[near], np.tile(p, (len(near), 1)))
        least[k] = np.linalg.norm(found - p, axis=1).min()
    return least


@pytest.mark.parametrize(("R", "offset_m"), PLACES)
def test_faces_edges_and_corners_of_a_box(R, offset_m):
    """Outside a box and less than r away, the nearest place for the ball is straight away from the nearest point."""
    path = between([(0, 0, 0.02), (0, 0, 0.002), (0.052, 0.01, 0.002), (0.052, 0.051, 0.003), (0.051, 0.052, -0.01)])
    nearest = np.clip(path, *BOX.bounds)
    away = path - nearest
    length = np.linalg.norm(away, axis=1, keepdims=True)
    expected = np.where(length < R_M, nearest + R_M * away / length, path)
    mesh = trimesh.Trimesh(BOX.vertices @ R.T + offset_m, BOX.faces, process=False)
    r = renderer(mesh).run(path @ R.T + offset_m)
    np.testing.assert_allclose((r.p_WP_m - offset_m) @ R, expected, atol=CLOSE_M)
    pressed = length[:, 0] < R_M - 1e-4
    assert r.touching[pressed].all() and not r.flags.any()
    np.testing.assert_allclose(r.nhat_W[pressed] @ R, (away / length)[pressed], atol=1e-3)


@pytest.mark.parametrize("half_deg", [10, 45, 80])
def test_groove(half_deg):
    """In a groove with walls at ±α to the vertical, the ball rests r / sin α above its line."""
    a = np.radians(half_deg)
    walls = [sheet([(0, -0.05, 0), (0, 0.05, 0), (s * 0.1 * np.sin(a), 0.05, 0.1 * np.cos(a)),
                    (s * 0.1 * np.sin(a), -0.05, 0.1 * np.cos(a))]) for s in (-1, 1)]  # fmt: skip
    rest_m = R_M / np.sin(a)
    path = between([(0, 0, rest_m + 0.01), (0, 0, rest_m - 0.002), (0.0002, 0.03, rest_m - 0.002)])
    for bodies in (walls, [trimesh.util.concatenate(walls)]):
        r = renderer(*bodies).run(path)
        np.testing.assert_allclose(r.p_WP_m[401 - 1, [0, 2]], (0, rest_m), atol=CLOSE_M)
        assert r.p_WP_m[-1, 1] == pytest.approx(0.03, abs=CLOSE_M)


@pytest.mark.parametrize("ticks", [200, 3])
@pytest.mark.parametrize("hole_m", [0.002, 0.00495, 0.0055])
def test_hole(hole_m, ticks):
    """The ball passes through a hole that is larger than itself only, also at 10 m/s."""
    r = renderer(plate_with_hole(hole_m)).run(between([(0, 0, 0.015), (0, 0, -0.015)], ticks))
    if hole_m < R_M:
        np.testing.assert_allclose(r.p_WP_m[-1], (0, 0, np.sqrt(R_M**2 - hole_m**2)), atol=CLOSE_M)
    else:
        np.testing.assert_allclose(r.p_WP_m, r.p_WT_m, atol=1e-12)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("radius_m", [1e-4, R_M])
def test_thin_plate_at_10_m_s(side, radius_m):
    plate = sheet([(-0.1, -0.1, 0), (0.1, -0.1, 0), (0.1, 0.1, 0), (-0.1, 0.1, 0)])
    path = side * between([(0.0, 0.0, 0.095), (0.01, 0.02, -0.095)], 19)
    r = renderer(plate, radius_m=radius_m).run(path)
    np.testing.assert_allclose(r.p_WP_m[:, 2], side * np.maximum(side * path[:, 2], radius_m), atol=CLOSE_M)


def test_loose_triangles_and_junctions():
    """A plane of triangles that share no vertices, with junctions amid edges and both windings, is as even as one."""
    rng, faces = np.random.default_rng(1), []
    for i in range(12):
        y = np.sort(rng.uniform(-0.03, 0.03, rng.integers(1, 6)))  # the corners of a strip lie amid edges of the next
        edge, x = np.array([-0.03, *y, 0.03]), 0.005 * i - 0.03
        for low, high in pairwise(edge):
            faces += [[(x, low, 0), (x + 0.005, low, 0), (x, high, 0)], [(x, high, 0), (x + 0.005, low, 0),
                      (x + 0.005, high, 0)]]  # fmt: skip
    corners = np.array(faces)
    corners[::3] = corners[::3, ::-1]
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    r = renderer(mesh).run(between([(0, 0, 0.01), (0, 0, 0.003), (0.02, 0.01, -0.01), (-0.02, -0.02, 0.004)]))
    np.testing.assert_allclose(r.p_WP_m[200:], np.c_[r.p_WT_m[200:, :2], np.full(401, R_M)], atol=CLOSE_M)
    assert not r.flags.any()


def test_moving_bodies_push_and_carry():
    """A box that rises at 3 m/s lifts the ball of a still tool; a wall that moves sideways pushes it off."""
    n = 40
    lift, shift = np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(4), (n, 1, 1))
    lift[:, 2, 3] = 0.003 * np.minimum(np.arange(n), 10)
    shift[:, 0, 3] = 0.004 * np.maximum(np.arange(n) - 20, 0)
    wall = trimesh.creation.box(bounds=[[-0.06, -0.05, 0.0], [-0.059, 0.05, 0.1]])
    r = renderer(BOX, wall).run(np.tile((0.0, 0.0, 0.012), (n, 1)), {"body 0": lift, "body 1": shift})
    top, side = lift[:, 2, 3] + R_M, shift[:, 0, 3] - 0.059 + R_M
    expected = np.c_[np.maximum(side, 0.0), 0 * top, np.maximum(top, 0.012)]
    np.testing.assert_allclose(r.p_WP_m, expected, atol=CLOSE_M)


def test_turning_body():
    """A bar that turns by 3° per tick about z sweeps the ball along: it stays r in front of the bar."""
    n = 30
    angle = np.radians(3.0) * np.arange(n)
    poses = np.array([trimesh.transformations.rotation_matrix(a, (0, 0, 1)) for a in angle])
    bar = trimesh.creation.box(bounds=[[-0.1, -0.002, -0.02], [0.1, 0.0, 0.02]])
    tool = np.array((0.03, 0.02, 0.0))
    r = renderer(bar).run(np.tile(tool, (n, 1)), {"body 0": poses})
    normal = np.c_[-np.sin(angle), np.cos(angle), 0 * angle]
    behind = np.maximum(R_M - normal @ tool, 0.0)
    np.testing.assert_allclose(r.p_WP_m, tool + behind[:, None] * normal, atol=CLOSE_M)


def test_deforming_body():
    """A box that grows by 2 mm lifts the ball by 2 mm, within the time between two shapes."""
    made = renderer(BOX)
    made.step((0.0, 0.0, 0.02))
    made.step((0.0, 0.0, 0.004))
    vertices = BOX.vertices.copy()
    vertices[vertices[:, 2] == 0.0, 2] = 0.002
    made.deform("body 0", vertices)
    r = made.run(np.tile((0.0, 0.0, 0.004), (100, 1)))
    assert (np.diff(r.p_WP_m[:, 2]) >= -1e-9).all() and np.diff(r.p_WP_m[:, 2]).max() < 1e-4
    np.testing.assert_allclose(r.p_WP_m[-1], (0, 0, 0.002 + R_M), atol=CLOSE_M)
    r = made.run(between([(0.0, 0.0, 0.004), (0.053, 0.0, 0.004)]))
    away = np.array((0.053, 0.0, 0.004)) - (0.05, 0.0, 0.002)
    np.testing.assert_allclose(r.p_WP_m[-1], (0.05, 0, 0.002) + R_M * away / np.linalg.norm(away), atol=CLOSE_M)


def test_added_body():
    scene = Scene()
    scene.add(BOX, name="body 0", unit="m")
    made = Renderer(scene, effects=["wall"], tip_radius_m=R_M)
    made.step((0.0, 0.0, 0.1))
    scene.add(trimesh.creation.box(bounds=[[-0.05, -0.05, 0.01], [0.05, 0.05, 0.03]]), name="lid", unit="m")
    made.repaint(scene)
    made.remove("body 0")
    assert made.step((0.0, 0.0, 0.033)).contact.p_W_m[2] == pytest.approx(0.03, abs=CLOSE_M)


def test_contact_point_lies_on_the_surface():
    """The force acts at the contact point, and the swatch is the one that is painted there."""
    scene = Scene()
    scene.add(BOX, name="body 0", unit="m")
    made = Renderer(scene, effects=["wall"], tip_radius_m=R_M)
    made.step((0.01, 0.02, 0.02))
    contact = made.step((0.01, 0.02, 0.004)).contact
    np.testing.assert_allclose(contact.p_W_m, (0.01, 0.02, 0.0), atol=1e-9)
    np.testing.assert_allclose(contact.tau_body_W_Nm((0, 0, 0)), np.cross(contact.p_W_m, contact.f_body_W_N))
    contact = made.step((0.051, 0.02, 0.002)).contact  # past the edge
    np.testing.assert_allclose(contact.p_W_m, (0.05, 0.02, 0.0), atol=CLOSE_M)
    impulse = made.impulse("body 0")
    np.testing.assert_allclose(impulse.angular_N_m_s, np.cross((0.01, 0.02, 0.0), (0, 0, -0.0005)) + np.cross(
        (0.05, 0.02, 0.0), 1e-3 * contact.f_body_W_N), atol=1e-8)  # fmt: skip


def test_starts_outside_faces():
    """A ball that overlaps a face at the start is moved out before the first tick."""
    made = renderer(BOX)
    made.reset((0.0, 0.0, 0.001))
    r = made.run(np.tile((0.0, 0.0, 0.001), (3, 1)))
    np.testing.assert_allclose(r.p_WP_m, np.tile((0, 0, R_M), (3, 1)), atol=CLOSE_M)


@pytest.mark.parametrize("two_sided", [False, True])
def test_ball_punctures_and_withdraws(two_sided):
    """The skin breaks while the centre is above it; it lets the ball in, out without force, and then holds again."""
    scene = Scene()
    scene.add(BOX, name="skin", unit="m", swatch=Swatch("skin", stiffness_N_m=290.0), two_sided=two_sided)
    made = Renderer(scene, [BREAK], tip_radius_m=R_M)
    found = []
    for z in np.concatenate((np.arange(0.008, -0.015, -2e-4), np.arange(-0.015, 0.008, 2e-4))):
        contact = made.step((0.003, 0.002, z)).contact
        found.append((int(made.surface.touch[0].inside), contact is not None))
    assert [state for state, _ in groupby(found)] == [(0, False), (0, True), (1, False), (0, False)]
    for z in np.arange(0.008, 0.003, -2e-4):
        contact = made.step((0.003, 0.002, z)).contact
    assert contact is not None and contact.depth_m == pytest.approx(R_M - 0.0032, abs=1e-5)


def test_one_puncture_ends_where_another_begins():
    """The ball leaves a body and breaks into another in the same tick: the first holds it again."""
    scene = Scene()
    for name, low_m in (("lower", -0.02), ("upper", 0.03)):
        mesh = trimesh.creation.box(bounds=[[-0.05, -0.05, low_m], [0.05, 0.05, low_m + 0.02]])
        scene.add(mesh, name=name, unit="m", swatch=Swatch("skin", stiffness_N_m=290.0))
    made = Renderer(scene, [BREAK], tip_radius_m=R_M)
    made.step((0.003, 0.002, 0.012))
    for z in (0.0, -0.002, -0.01, 0.035):
        made.step((0.003, 0.002, z))
    assert made.world.proxy[0].puncture_count == 1 and made.world.bodies["punctured"].tolist() == [0, 1]
    assert made.step((0.003, 0.002, 0.002)).contact.body == "lower"


def test_start_inside_is_reported():
    with pytest.warns(UsageWarning, match="body 0"):
        renderer(BOX).step((0.0, 0.0, -0.01))


def test_no_room():
    """In a gap narrower than itself, the ball stays, which is flagged."""
    plates = [trimesh.creation.box(bounds=[[-0.05, -0.05, z], [0.05, 0.05, z + 0.01]]) for z in (-0.014, 0.004)]
    made = renderer(*plates)
    made.reset((0.0, 0.0, 0.0))
    assert made.run(np.tile((0.0, 0.0, 0.001), (3, 1))).flags[-1] & Flag.UNSETTLED


@pytest.mark.parametrize("radius_m", [-1e-3, np.nan, 3.0])
def test_radius_out_of_range(radius_m):
    with pytest.raises(HapsceneError, match="tip_radius_m"):
        renderer(BOX, radius_m=radius_m)


@pytest.mark.parametrize(("tip", "warned"), [("3 mm ball", True), ("10 mm ball", False), ("steel stylus", False)])
def test_swatch_of_another_tip_is_reported(tip, warned):
    scene = Scene()
    scene.add(BOX, name="body 0", unit="m", swatch=Swatch("steel", tip=tip))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        Renderer(scene, effects=["wall"], tip_radius_m=R_M)
    assert ([w.category for w in found] == [DeviceWarning]) == warned


def test_twin_has_a_tip():
    scene = Scene()
    scene.add(BOX, name="body 0", unit="m")
    assert Twin(scene, "omni", tip_radius_m=R_M).renderer.tip_radius_m == R_M


def walk(mesh, ticks: int, seed: int) -> np.ndarray:
    """Return a path of the device between random points around and inside a mesh, at speeds up to 20 m/s."""
    rng = np.random.default_rng(seed)
    low, high = mesh.bounds + 0.1 * np.ptp(mesh.bounds, axis=0) * [[-1], [1]]
    points, legs = rng.uniform(low, high, (ticks // 10, 3)), []
    points[0] = high + 0.1
    for a, b, count in zip(points[:-1], points[1:], rng.choice([5, 50, 500], len(points) - 1), strict=True):
        legs.append(a + (b - a) * np.linspace(0, 1, count, endpoint=False)[:, None])
    return np.concatenate(legs)[:ticks]


def check_walk(mesh, radius_m: float, ticks: int, seed: int) -> None:
    r = renderer(mesh, radius_m=radius_m).run(walk(mesh, ticks, seed))
    some = np.flatnonzero(r.touching)[:: max(1, ticks // 1000)]
    assert len(some) > 200
    assert distance_m(mesh, r.p_WP_m[some]).min() > radius_m - 5e-6
    assert (r.flags > 0).mean() < 0.01


@cache
def scan(path: Path) -> trimesh.Trimesh:
    found = trimesh.load(path, process=False, force="mesh")
    mesh = trimesh.Trimesh(found.vertices - found.bounds.mean(axis=0), found.faces, process=False)
    mesh.apply_scale(0.15 / np.ptp(mesh.bounds, axis=0).max())
    return mesh


@pytest.mark.parametrize("radius_m", [0.001, 0.006])
def test_walk_over_a_scan(radius_m):
    check_walk(scan(Path("assets/meshes/toad.ply")), radius_m, 2000, 2)


def test_sphere():
    ball = trimesh.creation.icosphere(6, 0.05)
    facet_m = 0.05 - np.linalg.norm(ball.triangles_center, axis=1).min()
    angle = np.linspace(0.1, 2.0, 1000)[:, None]
    way = np.hstack((np.cos(angle), np.sin(angle) * 0.8, np.sin(angle) * 0.6))
    r = renderer(ball).run(np.concatenate((between([way[0] * 0.07, way[0] * 0.054]), way * 0.054)))
    height_m = np.linalg.norm(r.p_WP_m[201:], axis=1) - 0.05 - R_M
    assert -CLOSE_M - facet_m < height_m.min() and height_m.max() < CLOSE_M
    np.testing.assert_allclose(r.p_WP_m[201:] / (0.05 + R_M), way, atol=5e-4)


@pytest.mark.parametrize("width_m", [0.003, 0.0099])
def test_slot_narrower_than_the_ball(width_m):
    """The ball rests on both edges of a slot, and moves along it."""
    sides = []
    for s in (-1, 1):
        x = sorted((s * width_m / 2, s * 0.05))
        sides.append(trimesh.creation.box(bounds=[[x[0], -0.05, -0.02], [x[1], 0.05, 0]]))
    height_m = np.sqrt(R_M**2 - (width_m / 2) ** 2)
    r = renderer(*sides).run(between([(0, 0, 0.01), (0, 0, -0.01), (0.0002, 0.02, -0.01)]))
    np.testing.assert_allclose(r.p_WP_m[200:, 0], 0.0, atol=CLOSE_M)
    np.testing.assert_allclose(r.p_WP_m[200:, 2], height_m, atol=CLOSE_M)
    assert r.p_WP_m[-1, 1] == pytest.approx(0.02, abs=CLOSE_M)


@pytest.mark.nightly
@pytest.mark.parametrize("radius_m", [0.0005, 0.003, 0.01])
@pytest.mark.parametrize(
    "name", ["bunny.ply", "fandisk.obj", "teapot.stl", "busted.STL", "rabbit.obj", "cycloidal.ply"]
)
def test_walk_over_foreign_meshes(name, radius_m):
    if not SHARED.exists():
        pytest.skip("the folder ../shared is absent")
    check_walk(scan(SHARED / name), radius_m, 20_000, 3)
