"""The two-rate coupling with a simple simulation: momentum, prediction, chatter."""

import re
import warnings

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import hapscene
from hapscene.bridge.simulation import RATIO_MAX, ratio_max

Array = NDArray[np.float64]

STIFFNESS_N_M = 650.0
SIDE_M = 0.1


class Box:
    """A box that slides and turns under a constant force and dry friction, by the semi-implicit Euler method."""

    names = ("box",)

    def __init__(self, mass_kg: float, step_s: float, f_N: float = 0.0, drag_N: float = 0.0, turns: bool = True):
        self.mass_kg, self.step_s, self.f_N, self.drag_N = mass_kg, step_s, np.array([f_N, 0.0, 0.0]), drag_N
        self.inertia_kg_m2 = mass_kg * SIDE_M**2 / 6.0 if turns else 1e30
        self.X_WB, self.v_m_s, self.w_rad_s, self.steps = np.eye(4), np.zeros(3), np.zeros(3), 0

    def read(self, X_WB: Array) -> None:
        X_WB[0] = self.X_WB

    def mobility(self, body: int) -> Array:
        return hapscene.bridge.free_mobility(self.mass_kg, 3 * [self.inertia_kg_m2], self.X_WB[:3, :3])

    def advance(self, wrench_W: Array) -> None:
        self.steps += 1
        self.v_m_s += (wrench_W[0, :3] + self.f_N) / self.mass_kg * self.step_s
        most_m_s = self.drag_N / self.mass_kg * self.step_s
        self.v_m_s -= np.clip(self.v_m_s, -most_m_s, most_m_s)
        self.w_rad_s += wrench_W[0, 3:] / self.inertia_kg_m2 * self.step_s
        self.X_WB[:3, 3] += self.v_m_s * self.step_s
        self.X_WB[:3, :3] = Rotation.from_rotvec(self.w_rad_s * self.step_s).as_matrix() @ self.X_WB[:3, :3]


@pytest.fixture(scope="module")
def scene() -> hapscene.Scene:
    scene = hapscene.Scene()
    swatch = hapscene.Swatch("test", stiffness_N_m=STIFFNESS_N_M)
    scene.add(trimesh.creation.box(3 * [SIDE_M]), name="box", unit="m", swatch=swatch)
    return scene


@pytest.mark.parametrize("step_s", [2.5e-4, 1e-3, 1.5e-3, 1 / 60])
def test_momentum_is_conserved(scene: hapscene.Scene, step_s: float) -> None:
    box = Box(0.2, step_s)
    bridge, renderer = hapscene.bridge.Bridge(box), hapscene.Renderer(scene)
    hand = np.zeros(3)
    start = np.array([-0.051, 0.02, 0.01])
    for k in range(round(0.5 / step_s)):
        bridge.step(
            renderer,
            start + 0.1 * k * step_s * np.array([1.0, 0.0, 0.0]),
            lambda c: np.add(hand, c.f_W_N * renderer.tick_s, out=hand),
        )
    impulse = renderer.impulse("box")
    assert np.linalg.norm(impulse.linear_N_s) > 0.01 and impulse.angular_N_m_s[2] < 0.0
    assert box.mass_kg * box.v_m_s == pytest.approx(impulse.linear_N_s, rel=1e-12, abs=1e-17)
    assert box.inertia_kg_m2 * box.w_rad_s == pytest.approx(impulse.angular_N_m_s, rel=1e-12, abs=1e-17)
    assert hand == pytest.approx(-impulse.linear_N_s, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("step_s", [2.5e-4, 1e-3, 1 / 60])
def test_momentum_of_two_tools(scene: hapscene.Scene, step_s: float) -> None:
    """They press on opposite sides, one more than the other, beside the centre of mass."""
    box, tools = Box(0.2, step_s), [hapscene.Renderer(scene), hapscene.Renderer(scene)]
    bridge, hands = hapscene.bridge.Bridge(box), np.zeros((2, 3))
    for k in range(round(0.3 / step_s)):
        s = 0.02 * k * step_s
        places = np.array([[-0.051 + s, 0.02, 0.01], [0.051 - 0.5 * s, 0.0, -0.01]])
        bridge.step(tools, places, lambda made: np.add(hands, [1e-3 * c.f_W_N for c in made], out=hands))
    one, other = (tool.impulse("box") for tool in tools)
    assert one.linear_N_s[0] > 0.01 and other.linear_N_s[0] < -0.01
    assert box.mass_kg * box.v_m_s == pytest.approx(one.linear_N_s + other.linear_N_s, rel=1e-9, abs=1e-15)
    spin = one.angular_N_m_s + other.angular_N_m_s
    assert box.inertia_kg_m2 * box.w_rad_s == pytest.approx(spin, rel=1e-9, abs=1e-15)
    assert -hands == pytest.approx(np.array([one.linear_N_s, other.linear_N_s]), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(("step_s", "ticks"), [(1e-3, 1000), (4e-4, 400), (1.5e-3, 1500), (1 / 60, 1000)])
def test_number_of_ticks(scene: hapscene.Scene, step_s: float, ticks: int) -> None:
    """The tool moves to the end of each step on a straight line."""
    bridge, renderer, seen_m = hapscene.bridge.Bridge(Box(0.2, step_s)), hapscene.Renderer(scene), list[float]()
    ends = {}
    for k in range(round(ticks * 1e-3 / step_s)):
        x_m = -0.1 - 1e-4 * (k % 7)
        bridge.step(renderer, (x_m, 0.0, 0.0), lambda _: seen_m.append(float(renderer.surface.touch["p_WT_m"][0, 0])))
        ends.setdefault(len(seen_m) - 1, x_m)
    assert len(seen_m) == ticks
    np.testing.assert_allclose(seen_m, np.interp(np.arange(ticks), [*ends], [*ends.values()]), atol=1e-15)


@pytest.mark.parametrize(("part", "chatters"), [(0.93, False), (1.07, True)])
def test_two_tools_chatter_at_half_the_ratio(scene: hapscene.Scene, part: float, chatters: bool) -> None:
    """They hold a box between them, as two springs side by side."""
    step_s = 4e-3
    box = Box(STIFFNESS_N_M * step_s**2 / (0.5 * part * ratio_max(4)), step_s, turns=False)
    box.X_WB[0, 3] = 1e-5  # beside the equilibrium
    tools, felt = [hapscene.Renderer(scene, effects=["wall"]) for _ in range(2)], list[tuple[float, int]]()
    for tool, x_m in zip(tools, (-0.051, 0.051), strict=True):
        tool.tune("test", damping_Ns_m=0.0)
        tool.reset((x_m, 0.0, 0.0))
    bridge, places = hapscene.bridge.Bridge(box), np.array([[-0.0495, 0.0, 0.0], [0.0495, 0.0, 0.0]])
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        for _ in range(400):
            bridge.step(tools, lambda: places, lambda made: felt.append((made[0].f_W_N[0], len(given))))
    assert [note.category for note in given] == chatters * [hapscene.bridge.ChatterWarning]
    assert (np.ptp(felt[800:], axis=0)[0] > 0.1) == chatters  # 0.5 mN and 0.8 N
    assert felt[1][1] == chatters  # after the first tick
    if chatters:
        least_g = 1e3 * 2 * STIFFNESS_N_M * step_s**2 / ratio_max(4)
        has = (f"{1e3 * box.mass_kg:.3g} g", "1300 N/m", "steps of 4 ms", f"{least_g:.3g} g", f"{part**0.5:.2g}")
        assert re.findall(r"-?[\d.]+ g|-?\d+ N/m|steps of \d+ ms|(?<=factor of )[\d.]+", str(given[0].message)) == [
            *has
        ]


def test_ratio_max_of_one_tick() -> None:
    assert ratio_max(1) == RATIO_MAX == 4.0
    assert ratio_max(2) == pytest.approx(1.754, abs=1e-3)
    assert ratio_max(1000) == pytest.approx(2.237, abs=2e-3)


def test_the_time_of_a_recording_goes_on_after_the_ticks_of_a_bridge(scene: hapscene.Scene) -> None:
    bridge, renderer = hapscene.bridge.Bridge(box := Box(0.2, 1 / 60)), hapscene.Renderer(scene)
    path = np.tile((0.2, 0.0, 0.0), (40, 1))
    first, second = bridge.run(renderer, path), renderer.run(path)
    assert box.steps == 3  # of 16 or 17 ticks
    assert first.t_s == pytest.approx(np.arange(40) / 1000.0) and second.t_s == pytest.approx(
        np.arange(40, 80) / 1000.0
    )


def test_a_twin_pushes_a_body(scene: hapscene.Scene) -> None:
    """The steps of the simulation do not divide the run; the impulse of the last ticks is not applied yet."""
    box, twin = Box(0.2, 7e-3), hapscene.loop.Twin(scene, hapscene.device.PointMass(0.05))
    way = np.linspace((-0.06, 0.0, 0.0), (-0.04, 0.0, 0.0), 102)
    result = hapscene.bridge.Bridge(box).run_twin(twin, hapscene.loop.ReferenceTrajectory.along(way, "medium"))
    given = 1e-3 * result.recording.f_body_W_N[:, 0].sum()
    assert len(result) == 102 and given > 1e-3 and box.steps == 15
    assert twin.renderer.impulse("box").linear_N_s[0] == pytest.approx(given)
    assert box.mass_kg * box.v_m_s[0] == pytest.approx(given)


def test_teleport(scene: hapscene.Scene) -> None:
    box = Box(0.2, 1 / 60)
    bridge, renderer, felt = hapscene.bridge.Bridge(box), hapscene.Renderer(scene), list[hapscene.Command]()
    for _ in range(3):
        bridge.step(renderer, (0.2, 0.0, 0.0), felt.append)
    box.X_WB[0, 3] = 0.4
    bridge.teleport("box")
    for _ in range(3):
        bridge.step(renderer, (0.2, 0.0, 0.0), felt.append)
    assert not any(c.contact for c in felt) and box.v_m_s[0] == 0.0
    with pytest.raises(hapscene.HapsceneError, match="no moving body 'bux'; there are: box"):
        bridge.teleport("bux")


def test_recovery_from_an_invalid_pose(scene: hapscene.Scene) -> None:
    """As after a simulation that diverged and was reset."""
    box = Box(0.2, 0.01)
    bridge, renderer = hapscene.bridge.Bridge(box), hapscene.Renderer(scene)
    for x, flagged in ((0.0, False), (np.nan, True), (0.02, False), (0.02, False)):
        box.X_WB[0, 3] = x
        assert bool(bridge.step(renderer, (0.0, 0.0, 0.3)).flags & hapscene.Flag.POSE_REFUSED) == flagged
    assert renderer.world.bodies[0].p_WB_m[0] == 0.02


def test_invalid_arguments(scene: hapscene.Scene) -> None:
    bridge = hapscene.bridge.Bridge(Box(0.2, 1e-3))
    with pytest.raises(hapscene.HapsceneError, match="2 numbers"):
        bridge.step(hapscene.Renderer(scene), (0.0, 1.0))
    with pytest.raises(hapscene.HapsceneError, match="3 numbers; expected three for each of 2"):
        bridge.step([hapscene.Renderer(scene), hapscene.Renderer(scene)], (0.0, 0.0, 1.0))
    with pytest.raises(hapscene.HapsceneError, match="tick_s"):
        bridge.step([hapscene.Renderer(scene), hapscene.Renderer(scene, tick_s=2e-3)], np.zeros((2, 3)))
    other = hapscene.Scene()
    other.add(trimesh.creation.box(3 * [SIDE_M]), name="bux", unit="m")
    with pytest.raises(hapscene.HapsceneError, match="no body 'box'; there are: bux"):
        bridge.step(hapscene.Renderer(other), (0.0, 0.0, 1.0))


def test_free_mobility_is_the_inverse_of_the_spatial_inertia() -> None:
    rng = np.random.default_rng(6)
    R, com_B_m, inertia = (
        Rotation.random(random_state=1).as_matrix(),
        rng.normal(size=3),
        np.cov(rng.normal(size=(3, 9))),
    )
    C = np.cross(np.eye(3), R @ com_B_m)  # C v = c × v
    for given in (inertia, np.diag(inertia)):
        about_com = R @ (inertia if given is inertia else np.diag(given)) @ R.T
        spatial = np.block([[2.0 * np.eye(3), -2.0 * C], [2.0 * C, about_com - 2.0 * C @ C]])
        mobility = hapscene.bridge.free_mobility(2.0, given, R, com_B_m)
        np.testing.assert_allclose(mobility @ spatial, np.eye(6), atol=1e-12)


def test_steady_motion_is_predicted_between_steps(scene: hapscene.Scene) -> None:
    """A body that moves and turns at a constant rate about no axis of the world, in steps of ten ticks."""
    box, seen = Box(0.2, 0.01), list[Array]()
    box.v_m_s[:], box.w_rad_s[:] = (0.1, -0.2, 0.3), (2.0, -3.0, 4.0)
    box.X_WB[:3, :3] = Rotation.from_rotvec((0.3, -0.7, 1.1)).as_matrix()
    bridge, renderer = hapscene.bridge.Bridge(box), hapscene.Renderer(scene)
    body = renderer.world.bodies[0]
    for _ in range(6):
        bridge.step(renderer, (0.0, 0.0, 1.0), lambda _: seen.append(np.c_[body.R_WB, body.p_WB_m]))
    t = np.arange(60)[:, None] * 1e-3
    turns = Rotation.from_rotvec(t * box.w_rad_s) * Rotation.from_rotvec((0.3, -0.7, 1.1))
    expected = np.concatenate((turns.as_matrix(), (t * box.v_m_s)[:, :, None]), axis=2)
    np.testing.assert_allclose(seen[30:], expected[30:], atol=1e-9)


def test_a_constant_force_is_predicted_and_an_impact_is_not(scene: hapscene.Scene) -> None:
    """The rendered body has the acceleration of the force in each tick; an impact does not accelerate it afterwards."""
    box, seen_m = Box(0.2, 0.01, f_N=0.4), list[float]()
    bridge, renderer = hapscene.bridge.Bridge(box), hapscene.Renderer(scene)
    body = renderer.world.bodies[0]
    for k in range(12):
        if k == 6:
            box.f_N[0] = 0.0
        if k == 9:
            box.v_m_s[0] += 0.5
        bridge.step(renderer, (0.0, 0.0, 1.0), lambda _: seen_m.append(float(body.p_WB_m[0])))
    moved_m = np.diff(seen_m)[:110]
    np.testing.assert_allclose(np.diff(moved_m[30:60]), 0.4 / 0.2 * 1e-3**2, rtol=1e-9)
    steps_m = moved_m.reshape(11, 10)[7:]
    np.testing.assert_allclose(steps_m, np.tile(steps_m[:, :1], 10), rtol=1e-12)
    np.testing.assert_allclose(np.diff(steps_m[1:, 0]), [0.0, 2 * 0.5 * 1e-3], atol=1e-15)  # and is made up for
