"""Deforming bodies in contact: correct final shape, no steps, no penetration."""

import numpy as np
import pytest
import trimesh

from hapscene import Flag, Mesh, Renderer, Scene
from hapscene.contact.inside import look_direction
from hapscene.contact.world import WAYS
from hapscene.errors import SceneError, UsageWarning

BALL = trimesh.creation.icosphere(3, radius=0.05)
TICKS_A_FRAME = 17


def ball(crease_rad: float = 0.0, two_sided: bool = False) -> tuple[Renderer, np.ndarray]:
    scene = Scene()
    body = scene.add(Mesh.from_trimesh(BALL, "m"), name="liver", two_sided=two_sided)
    return Renderer(scene, ["wall"], crease_rad=crease_rad), np.array(body.mesh.vertices_m)


def bent(vertices: np.ndarray, phase: float) -> np.ndarray:
    """Scale by 4 %, shear and bend by some mm."""
    breath = 1.0 + 0.04 * np.sin(phase)
    moved = breath * vertices
    moved[:, 0] += 0.2 * np.sin(1.3 * phase) * vertices[:, 2]
    moved[:, 2] += 0.004 * np.sin(60.0 * vertices[:, 1] + phase)
    return moved


def test_rays_look_along_the_axes_and_into_the_octants() -> None:
    ways = np.array([look_direction(way) for way in range(WAYS)])
    signs = {(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x * x + y * y + z * z in (1, 3)}
    assert {tuple(np.sign(way).astype(int)) for way in ways} == signs
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0)


@pytest.mark.parametrize("crease_rad", [0.0, 0.6])
def test_deformed_body_equals_a_new_body_of_that_shape(crease_rad: float) -> None:
    renderer, vertices = ball(crease_rad)
    renderer.run(np.linspace([0.003, 0.002, 0.08], [0.003, 0.002, 0.042], 200))
    for phase in np.linspace(0.1, 2.0, 20):
        renderer.deform("liver", bent(vertices, phase))
        renderer.run(np.tile([0.003, 0.002, 0.042], (TICKS_A_FRAME, 1)))
    felt = renderer.run(np.tile([0.003, 0.002, 0.042], (60, 1)))

    scene = Scene()
    scene.add(Mesh(bent(vertices, 2.0), BALL.faces), name="liver")
    fresh = Renderer(scene, ["wall"], crease_rad=crease_rad)
    truth = fresh.run(np.linspace([0.003, 0.002, 0.08], [0.003, 0.002, 0.042], 200))
    assert felt.touching.all() and felt.face[-1] == truth.face[-1]
    np.testing.assert_allclose(felt.p_WP_m[-1], truth.p_WP_m[-1], atol=1e-9)
    np.testing.assert_allclose(felt.nhat_W[-1], truth.nhat_W[-1], atol=1e-7)


@pytest.mark.parametrize("two_sided", [False, True])
def test_contact_point_moves_between_shapes_without_a_step(two_sided: bool) -> None:
    renderer, vertices = ball(two_sided=two_sided)
    renderer.run(np.linspace([0.003, 0.002, 0.08], [0.003, 0.002, 0.04], 200))
    depth, changes = [], 0
    for frame in range(120):  # two seconds at 60 Hz; the top moves at up to 30 mm/s
        renderer.deform("liver", bent(vertices, 0.05 * frame))
        felt = renderer.run(np.tile([0.003, 0.002, 0.04], (TICKS_A_FRAME, 1)))
        depth.append(felt.depth_m)
        changes += int(np.count_nonzero(~felt.touching))
        assert not felt.flags.any()
    assert changes == 0
    assert np.abs(np.diff(np.concatenate(depth))).max() < 2e-4  # at most 0.75 mm per frame; 0.13 mm at an edge


def test_moving_body_deforms() -> None:
    renderer, vertices = ball()
    bodies = renderer.moving_bodies(["liver"])
    depth = []
    for tick in range(600):
        tool = np.array([0.0, 0.0, max(0.045, 0.054 - 0.5e-3 * tick)])
        if tick % TICKS_A_FRAME == 0:
            renderer.deform("liver", (1.0 + 0.05 * np.sin(0.01 * tick)) * vertices)
        turn = 0.5e-3 * tick
        bodies.X_WB[0, :3, :3] = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        bodies.X_WB[0, :3, 3] = [0.02e-3 * tick, 0.0, 0.0]
        command = renderer.step(tool + np.array([0.02e-3 * tick, 0.0, 0.0]), bodies)
        assert command.contact is not None or tick < 20
        depth.append(command.contact.depth_m if command.contact else 0.0)
    assert np.abs(np.diff(depth)).max() < 6e-4 and np.abs(np.diff(depth[20:])).max() < 1e-4


@pytest.mark.parametrize("lift_m", [0.0, 1e-13])  # with rounding alone, its normal is arbitrary
def test_face_that_degenerates_is_released(lift_m: float) -> None:
    scene = Scene()
    mesh = Mesh(np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]]), np.array([[0, 1, 2], [1, 3, 2]]))
    scene.add(mesh, name="sheet")
    renderer = Renderer(scene, ["wall"])
    renderer.run(np.linspace([0.02, 0.02, 0.01], [0.02, 0.02, -0.003], 50))
    flat = np.array(mesh.vertices_m)
    flat[0] = flat[1] + [0.0, 0.0, lift_m]
    renderer.deform("sheet", flat)
    felt = renderer.run(np.tile([0.02, 0.02, -0.003], (80, 1)))
    assert not felt.f_W_N.any() and not felt.touching.any()


def test_shrinking_body_does_not_hide_another() -> None:
    mesh = Mesh.from_trimesh(BALL, "m")
    scene = Scene()
    scene.add(mesh, name="heart")
    scene.add(mesh, name="lung", pose=trimesh.transformations.translation_matrix([0.2, 0.0, 0.0]))
    for phase in range(4):
        renderer = Renderer(scene, ["wall"])
        for k, part in enumerate(np.array_split(np.linspace([0.1, 0.0, 0.0], [0.1505, 0.0, 0.0], 600), 36)):
            renderer.deform("heart", (1.0 + 0.05 * np.sin(0.4 * k + phase)) * np.array(mesh.vertices_m))
            felt = renderer.run(part)
        assert felt.touching[-1] and felt.body[-1] == 1


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("x_m", [0.003, 0.0003, -0.0005])  # in front of a wall, near it, in contact with it
def test_part_of_a_fold_that_passes_the_proxy_holds_it(x_m: float, two_sided: bool) -> None:
    floor, wall = [[0, -1, 0], [1, -1, 0], [1, 1, 0], [0, 1, 0]], [[0, -1, 0], [0, 1, 0], [0, 1, 1], [0, -1, 1]]
    vertices = np.array(floor + wall) * 0.05
    scene = Scene()
    fold = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))
    scene.add(fold, name="fold", two_sided=two_sided)
    renderer = Renderer(scene, ["wall"])
    renderer.run(np.linspace([0.01, 0.0, 0.01], [x_m, 0.0, 0.01], 100))
    for rise_m in np.linspace(0.0, 0.015, 30):  # 0.5 mm a shape, none at the height of the tool
        renderer.deform("fold", vertices + np.outer(np.arange(8) < 4, [0.0, 0.0, rise_m]))
        felt = renderer.run(np.tile([x_m, 0.0, 0.01], (TICKS_A_FRAME, 1)))
    felt = renderer.run(np.tile([x_m, 0.0, 0.01], (60, 1)))
    assert felt.p_WP_m[-1] == pytest.approx((max(x_m, 0.0), 0.0, 0.015), abs=1e-6)


def test_pose_of_a_deforming_body_excludes_its_shift() -> None:
    renderer, vertices = ball()
    renderer.run(np.linspace([0.0, 0.0, 0.06], [0.0, 0.0, 0.048], 100))
    renderer.deform("liver", 1.1 * vertices)
    renderer.run(np.tile([0.0, 0.0, 0.048], (4, 1)))
    assert not renderer.moving_bodies(["liver"]).X_WB[0, :3, 3].any()


def test_instances_deform_independently() -> None:
    mesh = Mesh.from_trimesh(BALL, "m")
    scene = Scene()
    scene.add(mesh, name="one")
    scene.add(mesh, name="two", pose=trimesh.transformations.translation_matrix([0.2, 0.0, 0.0]))
    renderer, other = Renderer(scene, ["wall"]), Renderer(scene, ["wall"])
    renderer.deform("one", 0.5 * np.array(mesh.vertices_m))
    renderer.run(np.tile([0.0, 0.0, 0.3], (5, 1)))
    down = np.linspace([0.0, 0.0, 0.06], [0.0, 0.0, 0.04], 50)
    assert not renderer.run(down).touching.any()
    renderer.reset([0.2, 0.0, 0.06])
    assert renderer.run(down + np.array([0.2, 0.0, 0.0])).touching[-1]
    assert other.run(down).touching[-1]


def test_invalid_shape_is_rejected() -> None:
    renderer, vertices = ball()
    with pytest.raises(SceneError, match="liver"):
        renderer.deform("liver", vertices[:-1])
    with pytest.raises(SceneError, match="liver"):
        renderer.deform("liver", vertices * np.nan)
    with pytest.raises(SceneError, match="kidney"):
        renderer.deform("kidney", vertices)
    assert renderer.run(np.tile([0.0, 0.0, 0.055], (5, 1))).flags.max() == Flag(0)


def winding_number(corners_m: np.ndarray, p_m: np.ndarray) -> float:
    """Return how often a surface (n, 3, 3) winds around a point: 1 inside, 0 outside (van Oosterom & Strackee 1983)."""
    a, b, c = (corners_m[:, k] - p_m for k in range(3))
    u, v, w = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
    return float(np.arctan2(volume, u * v * w + dots[0] * w + dots[1] * u + dots[2] * v).sum() / (2.0 * np.pi))


def violent(vertices: np.ndarray, random: np.random.Generator, waves: np.ndarray) -> np.ndarray:
    """Shift the vertices along sines over the body, by up to 13 mm along each axis."""
    moved = vertices.copy()
    for wave, way in zip(waves, np.eye(3), strict=True):
        moved += 0.013 * np.outer(np.sin(vertices @ wave + random.uniform(0.0, 6.0)), way)
    return moved


@pytest.mark.parametrize("two_sided", [False, True])
def test_violent_shapes_never_enclose_the_proxy(two_sided: bool) -> None:
    """Also shapes that intersect themselves: a recovery is flagged."""
    flagged = 0
    for seed in range(24):
        random = np.random.default_rng(seed)
        renderer, vertices = ball(two_sided=two_sided)
        waves = random.normal(size=(3, 3))
        waves *= 100.0 / np.linalg.norm(waves, axis=1)[:, None]
        way = random.normal(size=3)
        way /= np.linalg.norm(way)
        tool = random.uniform(0.043, 0.052) * way
        renderer.run(np.linspace(0.06 * way, tool, 60))
        for _ in range(3):
            shape = violent(vertices, random, waves)
            renderer.deform("liver", shape)
            felt = renderer.run(np.tile(tool, (TICKS_A_FRAME, 1)))
            assert not felt.flags[2:].any()  # in the first tick of the shape or the next one
            flagged += int(felt.flags[:2].max() == Flag.PROXY_RESET)
        renderer.run(np.tile(tool, (60, 1)))
        assert winding_number(shape[BALL.faces], renderer.world.proxy[0].p_W_m) < 0.5
    assert flagged > 0


def test_oscillating_body_is_reported_once() -> None:
    renderer, vertices = ball()
    for k in range(30):
        renderer.deform("liver", (1.0 + 0.02 * np.sin(0.3 * k)) * vertices)  # smooth: no warning
    with pytest.warns(UsageWarning, match="liver") as caught:
        for k in range(30):
            renderer.deform("liver", (1.0 + 0.01 * (-1) ** k) * vertices)
    assert len(caught) == 1
