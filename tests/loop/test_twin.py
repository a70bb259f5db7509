"""The simulated twin: it uses the haptic tick of the renderer, and obeys mechanics."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from hapscene import assets
from hapscene.device.model import device_named, limits_of
from hapscene.device.sim.hand import GRIPS, Grip
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError, PathError
from hapscene.flags import Flag
from hapscene.handle.plant import Plant
from hapscene.loop import ReferenceTrajectory, Twin
from hapscene.motion.gestures import GESTURES, PRESS_N, act
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene, load_scene

TICK_S = 1e-3
MASS = PointMass(0.045, 0.1, 0.26, 5.5e-5)


def test_twin_equals_the_renderer(plate: Scene) -> None:
    twin = Twin(plate, MASS)
    result = twin.run(act("stroke", plate, TICK_S))
    again = Renderer(plate).run(result.recording.p_WT_m)
    assert result.recording.touching.any()
    for name in ("p_WP_m", "f_W_N", "a_m_s2", "flags", "slip_m_s"):
        assert np.array_equal(getattr(again, name), getattr(result.recording, name)), name


def test_twin_follows_scene_pose() -> None:
    scene = Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="box", unit="m")
    twin = Twin(scene, MASS, effects=["wall"])
    press = ReferenceTrajectory.hold((0.0, 0.0, 0.04), 100)
    twin.reset((0.0, 0.0, 0.0505))
    assert twin.run(press).recording.touching.any()
    scene.pose("box", np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    assert not twin.run(press).recording.touching.any()


def test_force_is_delayed(plate: Scene) -> None:
    twin = Twin(plate, MASS, delay_ticks=3)
    twin.reset((0.0, 0.0, 0.0))
    result = twin.run(ReferenceTrajectory.hold((0.0, 0.0, -0.02), 50))
    assert result.recording.f_W_N.any()
    assert np.array_equal(result.f_motor_W_N[3:], result.recording.f_W_N[:-3])
    assert not result.f_motor_W_N[:3].any()


def test_hand_force(plate: Scene) -> None:
    """f = k (target − x) + b (ẋ_target − ẋ) + push at the start of each tick; the target moves linearly."""
    t_s = TICK_S * np.arange(60)
    path = 0.03 + 0.01 * np.column_stack((np.sin(20.0 * t_s), np.cos(30.0 * t_s), np.sin(50.0 * t_s)))
    twin = Twin(plate, PointMass(0.045, 0.1))
    twin.reset(path[0] + 0.001, (0.1, -0.2, 0.3))
    result = twin.run(ReferenceTrajectory.along(path, Grip(200.0, 3.0, 0.01), (0.1, 0.2, 0.3)))
    speed = np.diff(path, axis=0, append=path[-1:]) / TICK_S
    pull_N = 200.0 * (path - result.p_W_m) + 3.0 * (speed - result.v_W_m_s) + (0.1, 0.2, 0.3)
    np.testing.assert_allclose(result.f_hand_W_N, pull_N, atol=1e-9)


@pytest.mark.parametrize("motor", range(3))
def test_load_of_the_warmest_motor(plate: Scene, motor: int) -> None:
    twin = Twin(plate, Omni(), X_WD=stand((0.0, 0.0, 0.05)))
    twin.reset((0.0, 0.0, 0.05))
    twin.tool.arm.omni.heat[0, motor] = 0.5
    assert twin.run(ReferenceTrajectory.hold((0.0, 0.0, 0.05), 1)).heat[0] == pytest.approx(0.5, rel=0.01)


def test_work_equals_kinetic_energy_gain(plate_of: Callable[..., Scene]) -> None:
    twin = Twin(plate_of(1000.0), PointMass(0.045), effects=["wall"])
    twin.reset((0.0, 0.0, 0.001), (0.0, 0.0, -0.2))
    result = twin.run(ReferenceTrajectory.hold((0.0, 0.0, 0.0), 200, "none"))
    kinetic_J = 0.5 * 0.045 * (result.v_W_m_s**2).sum(axis=1)
    assert result.work_J[:-1].cumsum() == pytest.approx(kinetic_J[1:] - kinetic_J[0], abs=1e-12)
    assert kinetic_J[-1] > kinetic_J[0]  # a sampled spring generates energy


def test_run_continues_from_the_last_state(plate: Scene) -> None:
    reference = act("tap", plate, TICK_S)
    X_WD = stand((0.0, 0.0, 0.01))
    first = Twin(plate, Omni(), handle=Plant(), seed=3, X_WD=X_WD).run(reference)
    twin = Twin(plate, Omni(), handle=Plant(), seed=3, X_WD=X_WD)
    quarter = len(reference) // 4
    step_m = np.linalg.norm(np.diff(reference.target_W_m, axis=0), axis=1)
    half = quarter + int(step_m[quarter : 3 * quarter].argmin()) + 1  # where the hand moves slowest
    parts = [
        ReferenceTrajectory(reference.target_W_m[a:b], reference.grip[a:b], reference.push_W_N[a:b])
        for a, b in ((0, half), (half, None))
    ]
    second = [twin.run(part) for part in parts]
    joined = np.concatenate([result.a_handle_m_s2 for result in second])
    assert first.a_handle_m_s2.any() and np.array_equal(first.f_coil_N > 0.0, first.a_handle_m_s2.any(axis=1))
    # the first half does not know the next target: the speed of the target differs in one tick
    assert np.abs(joined - first.a_handle_m_s2).max() < 1e-3 * np.abs(first.a_handle_m_s2).max()


@pytest.mark.parametrize("device", [MASS, Omni()], ids=["point", "omni"])
def test_press_force(plate: Scene, device: PointMass | Omni) -> None:
    result = Twin(plate, device).run(act("press", plate, TICK_S, grip="medium"))
    held_N = np.median(np.linalg.norm(result.f_hand_W_N, axis=1)[result.recording.touching])
    hand_N_m, wall_N_m = GRIPS["medium"].k_N_m, 500.0  # springs in series
    assert held_N == pytest.approx(PRESS_N * wall_N_m / (hand_N_m + wall_N_m), rel=0.1)
    assert result.rest_m_s < 5e-3


@pytest.mark.parametrize("name", GESTURES)
def test_every_gesture_makes_contact(plate: Scene, name: str) -> None:
    twin, reference = Twin(plate, Omni(), handle=Plant()), act(name, plate, TICK_S, grip="medium")
    result = twin.run(reference)
    low_m, high_m = (extreme(reference.target_W_m, axis=0) for extreme in (np.min, np.max))
    assert np.array_equal(twin.X_WD, stand(0.5 * (low_m + high_m)))  # the device is placed around the gesture
    assert result.recording.touching.any()
    assert np.isfinite(result.p_W_m).all() and np.isfinite(result.a_handle_m_s2).all()
    assert not result.recording.flags.any()


def test_released_grip_has_no_force(plate: Scene) -> None:
    pressing = act("press", plate, TICK_S)
    grip = np.where((pressing.target_W_m[:, 2] < pressing.target_W_m[:, 2].min() + 1e-9)[:, None], 0.0, pressing.grip)
    reference = ReferenceTrajectory.along(pressing.target_W_m, grip)
    result = Twin(plate, MASS).run(reference)
    free = reference.grip[:, 0] == 0.0
    assert free.any() and not result.f_hand_W_N[free].any()
    assert result.p_W_m[free, 2].max() > result.p_W_m[~free, 2].min()  # the wall pushes it out


def test_invalid_input_is_rejected(plate: Scene) -> None:
    with pytest.raises(PathError, match="wave"):
        act("wave", plate, TICK_S)
    with pytest.raises(PathError, match="light"):
        act("tap", plate, TICK_S, grip="none")
    with pytest.raises(HapsceneError, match="delay_ticks"):
        Twin(plate, MASS, delay_ticks=-1)
    with pytest.raises(HapsceneError, match="onmi"):
        Twin(plate, "onmi")
    with pytest.raises(HapsceneError, match="ideal"):
        Twin(plate, "ideal")
    with pytest.raises(HapsceneError, match="device"):
        Twin(plate, 3.0)  # type: ignore[arg-type]
    with pytest.raises(PathError, match="target_W_m"):
        ReferenceTrajectory.along([[0.0, 0.0, np.nan]])
    with pytest.raises(PathError, match="target_W_m"):
        ReferenceTrajectory(*np.empty((3, 0, 3)))


@pytest.mark.parametrize(
    "made",
    [
        lambda: ReferenceTrajectory.along([]),
        lambda: ReferenceTrajectory.along(None),  # type: ignore[arg-type]
        lambda: ReferenceTrajectory.along(np.zeros((3, 4))),
        lambda: ReferenceTrajectory.along(np.zeros(5)),
        lambda: ReferenceTrajectory.along(np.zeros((3, 3)), np.zeros((2, 3))),
        lambda: ReferenceTrajectory.along(np.zeros((3, 3)), "light", (1e300, 0.0, 0.0)),
        lambda: ReferenceTrajectory.hold((0.0, 0.0, 0.0), 0),
        lambda: ReferenceTrajectory.hold((0.0, 0.0, 0.0), 1.5),  # type: ignore[arg-type]
        lambda: ReferenceTrajectory.hold((0.0, 0.0), 5),
        lambda: ReferenceTrajectory(1.0, 2.0, 3.0),  # type: ignore[arg-type]
    ],
)
def test_invalid_reference_trajectory_is_rejected(made: Callable[[], ReferenceTrajectory]) -> None:
    with pytest.raises(PathError):
        made()


def test_one_row_applies_to_all_ticks() -> None:
    reference = ReferenceTrajectory.along(np.zeros((4, 3)), (1.0, 2.0, 0.0), (0.0, 0.0, -1.0))
    assert reference.grip.tolist() == [[1.0, 2.0, 0.0]] * 4
    assert reference.push_W_N.tolist() == [[0.0, 0.0, -1.0]] * 4
    for plain in (ReferenceTrajectory.along(np.zeros((4, 3))), ReferenceTrajectory.hold((0.0, 0.0, 0.0), 4)):
        assert plain.grip.tolist() == [GRIPS["light"].row().tolist()] * 4 and not plain.push_W_N.any()


@pytest.fixture(scope="module")
def demo() -> Scene:
    return load_scene(assets.path("demo"))


@pytest.mark.parametrize("grip", ["light", "medium", "firm"])
@pytest.mark.parametrize("device", ["omni", "phantom-1.0", "premium-1.5"])
@pytest.mark.filterwarnings("ignore::hapscene.device.model.DeviceWarning")
def test_stroke_over_walls_and_a_pocket(demo: Scene, device: str, grip: str) -> None:
    reference = act("stroke", demo, TICK_S, grip=grip)
    held = Omni() if device == "omni" else device_named(device).point
    result = Twin(demo, held, limits=limits_of(device, TICK_S), handle=Plant()).run(reference)
    recording = result.recording
    touching, body = recording.touching, demo.bodies[0]
    assert np.count_nonzero(touching) > 800
    assert np.all(recording.body[touching] == 0) and not touching[-1]
    assert np.count_nonzero(touching & (recording.flags & Flag.FORCE_LIMITED > 0)) < 0.05 * np.count_nonzero(touching)
    outward = recording.nhat_W[touching] @ (0.0, 0.0, 1.0)
    assert outward.min() > -0.1  # never below the body
    assert np.linalg.norm(recording.p_WT_m[-1] - reference.target_W_m[-1]) < 0.01
    low_m, high_m = body.mesh.bounds_m + body.X_WB[:3, 3]
    assert np.all((recording.p_WT_m[touching, :2] > low_m[:2]) & (recording.p_WT_m[touching, :2] < high_m[:2]))
