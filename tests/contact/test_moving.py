"""Poses of moving bodies: accepted, corrected or rejected; motion, rest and teleport."""

import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import hapscene
from hapscene.contact.moving import ROTATION_TOLERANCE
from hapscene.errors import SceneError, UsageWarning
from hapscene.flags import Flag
from hapscene.scene.mesh import Mesh

BOX = trimesh.creation.box((0.1, 0.1, 0.1))
ON_TOP = (0.01, 0.02, 0.049)


def boxes(*places_m) -> hapscene.Scene:
    scene, mesh = hapscene.Scene(), Mesh.from_trimesh(BOX, "m")
    for i, p in enumerate(places_m):
        scene.add(mesh, name=f"box {i}", pose=at(p))
    return scene


def at(p, R=None) -> np.ndarray:
    X = np.eye(4)
    X[:3, 3] = p
    if R is not None:
        X[:3, :3] = R
    return X


def pressed(*places_m) -> tuple[hapscene.Renderer, hapscene.MovingBodies]:
    """Return boxes with the tool 1 mm below the top of the first."""
    renderer = hapscene.Renderer(boxes(*places_m), ["wall"])
    for z in (0.051, 0.0495, 0.049):
        renderer.step((0.01, 0.02, z))
    return renderer, renderer.moving_bodies([f"box {i}" for i in range(len(places_m))])


def test_slots_and_poses_by_name_give_the_same_bits():
    path = np.tile(ON_TOP, (200, 1))
    path[0, 2] = 0.06
    X = [
        at((1e-4 * k, 0.0, 1e-3 * np.sin(k / 20)), Rotation.from_rotvec([0, 0, k / 900]).as_matrix())
        for k in range(200)
    ]
    whole = hapscene.Renderer(boxes((0, 0, 0))).run(path, {"box 0": X})
    named, slotted = hapscene.Renderer(boxes((0, 0, 0))), hapscene.Renderer(boxes((0, 0, 0)))
    slots = slotted.moving_bodies(["box 0"])
    for k in range(200):
        slots.X_WB[0] = X[k]
        a, b = named.step(path[k], {"box 0": X[k]}), slotted.step(path[k], slots)
        assert a.f_W_N.tolist() == b.f_W_N.tolist() == whole.f_W_N[k].tolist()
    assert whole.touching[1:].all()


def test_body_without_a_new_pose_comes_to_rest():
    renderer, slots = pressed((0, 0, 0))
    slots.X_WB[0, 0, 3] = 1e-3
    moved = renderer.step(ON_TOP, slots)
    speed = renderer.surface.memory[0].drag_m_s.copy()
    still = renderer.step(ON_TOP)
    assert speed == pytest.approx([1.0, 0.0, 0.0]) and not renderer.surface.memory[0].drag_m_s.any()
    assert renderer.world.bodies[0].moved == 0 and moved.contact and still.contact


@pytest.mark.parametrize(
    "spoil",
    [
        lambda X: X.__setitem__((0, 3), np.nan),
        lambda X: X.__setitem__((1, 1), np.inf),
        lambda X: X.__setitem__((0, 3), 1e6),
        lambda X: X.__setitem__((slice(0, 3), slice(0, 3)), 1.02 * np.eye(3)),
        lambda X: X.__setitem__((slice(0, 3), slice(0, 3)), np.diag([1.0, 1.0, -1.0])),
        lambda X: X.__setitem__((slice(0, 3), slice(0, 3)), 0.0),
        lambda X: X.__setitem__(slice(None), at((0.5, 0.0, 0.0)).T),
    ],
    ids=["nan", "inf", "far", "scaled", "mirrored", "flat", "transposed"],
)
def test_invalid_pose_is_flagged_and_last_valid_one_kept(spoil):
    renderer, slots = pressed((0, 0, 0))
    good = at((0.0, 0.0, 0.001), Rotation.from_rotvec([0, 0, 0.1]).as_matrix())
    slots.X_WB = good[None]
    before = renderer.step(ON_TOP, slots)
    spoil(slots.X_WB[0])
    with pytest.warns(UsageWarning, match="'box 0'"):
        command = renderer.step(ON_TOP, slots)
    body = renderer.world.bodies[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert renderer.step(ON_TOP, slots).flags == Flag.POSE_REFUSED  # one warning is enough
    assert command.flags == Flag.POSE_REFUSED and before.flags == Flag(0)
    assert (good[:3, :3] == body.R_WB).all() and (body.p_WB_m == good[:3, 3]).all()
    np.testing.assert_allclose(command.f_W_N, before.f_W_N, atol=1e-12)
    spoiled = {"box 0": slots.X_WB[0].copy()}
    slots.X_WB = good[None]
    assert renderer.step(ON_TOP, slots).flags == Flag(0)
    assert renderer.step(ON_TOP, spoiled).flags == Flag.POSE_REFUSED


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.floats(1e-12, ROTATION_TOLERANCE / 4))
def test_rounding_errors_of_a_rotation_are_corrected(seed, size):
    rng = np.random.default_rng(seed)
    R = Rotation.random(random_state=seed).as_matrix()
    X = at(rng.normal(size=3), R + size * rng.uniform(-1.0, 1.0, (3, 3)))
    renderer = hapscene.Renderer(SCENE, [])
    assert renderer.step((0.0, 0.0, 1.0), {"box 0": X}).flags == Flag(0)
    held = renderer.world.bodies[0].R_WB
    assert np.abs(held @ held.T - np.eye(3)).max() < 1e-12
    u, _, vt = np.linalg.svd(X[:3, :3])  # the nearest rotation
    np.testing.assert_allclose(held, u @ vt, atol=2e-12)


SCENE = boxes((0, 0, 0))


def test_teleport_does_not_move_the_proxy():
    """A teleport away from the tool and back around it neither drags nor hits the tool."""
    renderer, slots = pressed((0, 0, 0))
    slots.X_WB = at((0.3, 0.0, 0.0))[None]
    slots.teleport("box 0")
    gone = renderer.step(ON_TOP, slots)
    assert gone.contact is None and not gone.f_W_N.any()
    assert renderer.surface.touch[0].p_WP_m.tolist() == list(ON_TOP)
    slots.X_WB = at((0.0, 0.0, 0.0))[None]
    slots.teleport("box 0")
    assert renderer.step(ON_TOP, slots).contact is None  # the tool is inside the body
    assert renderer.step((0.01, 0.02, 0.06), slots).contact is None
    assert renderer.step(ON_TOP, slots).contact is not None


def test_contact_with_another_body_survives_a_teleport():
    """In the corner of two boxes, one of which is teleported away."""
    renderer = hapscene.Renderer(boxes((0, 0, 0), (0.1, 0.0, 0.05)), ["wall"])
    corner = (0.0505, 0.0, 0.0495)  # below the top of the first, inside the side of the second
    for p in ((0.045, 0.0, 0.055), (0.0495, 0.0, 0.0495), corner):
        renderer.step(p)
    assert renderer.world.proxy[0].count == 2
    slots = renderer.moving_bodies(["box 1"])
    slots.X_WB = at((0.5, 0.0, 0.0))[None]
    slots.teleport("box 1")
    contact = renderer.step((0.045, 0.0, 0.0495), slots).contact
    assert contact.body == "box 0" and not contact.began and contact.depth_m == pytest.approx(0.0005)


def test_scene_pose_teleports_a_body():
    scene = boxes((0, 0, 0))
    renderer = hapscene.Renderer(scene, ["wall"])
    renderer.step((0.01, 0.02, 0.051))
    assert renderer.step(ON_TOP).contact is not None
    scene.pose("box 0", at((0.3, 0.0, 0.0)))
    assert renderer.step(ON_TOP).contact is None
    assert renderer.step((0.31, 0.02, 0.051)).contact is None
    assert renderer.step((0.31, 0.02, 0.049)).contact is not None
    scene.pose("box 0", at((0.0, 0.0, 0.0)))
    assert not renderer.run(np.tile((0.31, 0.02, 0.049), (3, 1))).touching.any()


@pytest.mark.parametrize("seed", range(12))
def test_body_that_hits_the_tool_at_speed_pushes_it_out(seed):
    """A ring passes a still tool at 3 m/s and turns at 100 rad/s: the proxy is never inside, also in the first tick."""
    random = np.random.default_rng(seed)
    major_m, minor_m, sections = 0.05, 0.02, 64
    scene = hapscene.Scene()
    scene.add(trimesh.creation.torus(major_m, minor_m, major_sections=sections), name="ring", unit="m")
    way, spin = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
    t = np.arange(-40, 40) * 1e-3
    turn = Rotation.from_rotvec(100.0 * np.outer(t, spin)) * Rotation.random(random_state=seed)
    offset = 0.02 * np.cross(way, spin)
    X = np.array([at(offset + 3.0 * s * way, R) for s, R in zip(t, turn.as_matrix(), strict=True)])
    felt = hapscene.Renderer(scene, ["wall"]).run(np.zeros((len(t), 3)), {"ring": X})
    assert felt.touching.any() and not felt.flags.any()
    x, y, z = np.einsum("nji,nj->in", X[:, :3, :3], felt.p_WP_m - X[:, :3, 3])
    away_m = np.hypot(np.hypot(x, y) - major_m, z) - minor_m
    chord_m = (major_m + minor_m) * (1.0 - np.cos(np.pi / sections)) + minor_m * (1.0 - np.cos(np.pi / 32))
    assert away_m.min() > -chord_m - 1e-6  # of a polygon, which lies inside the ring


def test_names_that_change_from_tick_to_tick():
    """Each combination of names has its own slots; arrays and lists give the same bits."""
    arrays, lists = (hapscene.Renderer(boxes((0, 0, 0), (1, 0, 0)), ["wall"]) for _ in range(2))
    for k in range(150):
        poses = {f"box {k % 2}": at((k % 2, 0.0, 1e-5 * k)), f"box {1 - k % 2}": at((1 - k % 2, 0.0, 1e-5 * k))}
        poses = dict(list(poses.items())[: 1 + k % 3 // 2])
        a = arrays.step(ON_TOP if k else (0.01, 0.02, 0.06), poses)
        b = lists.step(ON_TOP if k else (0.01, 0.02, 0.06), {name: X.tolist() for name, X in poses.items()})
        assert a.f_W_N.tobytes() == b.f_W_N.tobytes() and a.flags == b.flags == Flag(0)
    assert a.contact.depth_m == pytest.approx(0.05 + 1e-5 * 149 - 0.049)


def test_invalid_moving_bodies_are_rejected():
    renderer = hapscene.Renderer(boxes((0, 0, 0), (1, 0, 0)), [])
    for names in (["crate"], ["box 0", "box 0"]):
        with pytest.raises(SceneError, match=names[0]):
            renderer.moving_bodies(names)
    with pytest.raises(SceneError, match="box 1"):
        renderer.moving_bodies(["box 0"]).teleport("box 1")
    for bad in (np.eye(3), "X", [["a"] * 4] * 4):
        with pytest.raises(SceneError, match="box 0"):
            renderer.step((0, 0, 1), {"box 0": bad})


def test_moving_bodies_of_another_renderer_are_rejected():
    """Their indices would be invalid in another scene, and a teleport would apply to one renderer only."""
    slots = hapscene.Renderer(boxes((0, 0, 0), (1, 0, 0))).moving_bodies(["box 1"])
    with pytest.raises(SceneError):
        hapscene.Renderer(SCENE, []).step((0.0, 0.0, 1.0), slots)


def test_moving_bodies_start_at_the_pose_of_the_scene():
    scene = boxes((0, 0, 0))
    renderer = hapscene.Renderer(scene, ["wall"])
    renderer.step((0.01, 0.02, 0.06))
    scene.pose("box 0", at((0.3, 0.0, 0.0)))
    slots = renderer.moving_bodies(["box 0"])
    assert slots.X_WB[0, 0, 3] == 0.3
    assert renderer.step((0.01, 0.02, 0.04), slots).contact is None


@pytest.mark.parametrize("when", ["first", "before a reset"])
def test_first_pose_is_no_motion(when):
    renderer = hapscene.Renderer(boxes((0, 0, 0)), ["wall"])
    if when != "first":
        renderer.step((0.0, 0.0, 0.3))
    renderer.step((0.0, 0.0, 0.3), {"box 0": at((0.1, 0.0, 0.0))})
    if when != "first":
        renderer.reset((0.0, 0.0, 0.3))
    renderer.step((0.0, 0.0, 0.3))
    body = renderer.world.bodies[0]
    assert body.last_p_WB_m.tolist() == body.p_WB_m.tolist() == [0.1, 0.0, 0.0]
