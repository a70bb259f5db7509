"""The closed loop: it is the real tick, and it obeys mechanics."""

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
from hapscene.loop import Intent, Twin
from hapscene.motion.gestures import GESTURES, PRESS_N, act
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene, load_scene

TICK_S = 1e-3
MASS = PointMass(0.045, 0.1, 0.26, 5.5e-5)


def test_it_is_the_renderers_own_tick(plate: Scene) -> None:
    twin = Twin(plate, MASS)
    feel = twin.run(act("stroke", plate, TICK_S))
    again = Renderer(plate).run(feel.recording.p_WT_m)
    assert feel.recording.touching.any()
    for name in ("p_WP_m", "f_W_N", "a_m_s2", "flags", "slip_m_s"):
        assert np.array_equal(getattr(again, name), getattr(feel.recording, name)), name


def test_it_sees_a_body_that_the_scene_puts_elsewhere() -> None:
    scene = Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="box", unit="m")
    twin = Twin(scene, MASS, effects=["wall"])
    press = Intent.hold((0.0, 0.0, 0.04), 100)
    twin.reset((0.0, 0.0, 0.0505))
    assert twin.run(press).recording.touching.any()
    scene.pose("box", np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    assert not twin.run(press).recording.touching.any()


def test_a_push_rests_where_the_spring_carries_it(plate: Scene) -> None:
    twin = Twin(plate, PointMass(0.045, 2.0), effects=["wall"])
    twin.reset((0.0, 0.0, 0.0))
    feel = twin.run(Intent.hold((0.0, 0.0, 0.0), 2000, "none", push_W_N=(0.0, 0.0, -1.0)))
    assert feel.p_W_m[-1, 2] == pytest.approx(-1.0 / 500.0, rel=1e-6)
    assert feel.rest_m_s < 1e-6


def test_force_goes_out_after_the_delay(plate: Scene) -> None:
    twin = Twin(plate, MASS, delay_ticks=3)
    twin.reset((0.0, 0.0, -0.001))
    feel = twin.run(Intent.hold((0.0, 0.0, -0.002), 50))
    assert np.array_equal(feel.f_motor_W_N[3:], feel.recording.f_W_N[:-3])
    assert not feel.f_motor_W_N[:3].any()


def test_the_hand_pulls_with_its_spring_its_damper_and_its_push(plate: Scene) -> None:
    """f = k (target − x) + b (ẋ_target − ẋ) + push at each tick's start, the target on its way to the next tick's."""
    t_s = TICK_S * np.arange(60)
    path = 0.03 + 0.01 * np.column_stack((np.sin(20.0 * t_s), np.cos(30.0 * t_s), np.sin(50.0 * t_s)))
    twin = Twin(plate, PointMass(0.045, 0.1))
    twin.reset(path[0] + 0.001, (0.1, -0.2, 0.3))
    feel = twin.run(Intent.along(path, Grip(200.0, 3.0, 0.01), (0.1, 0.2, 0.3)))
    speed = np.diff(path, axis=0, append=path[-1:]) / TICK_S
    pull_N = 200.0 * (path - feel.p_W_m) + 3.0 * (speed - feel.v_W_m_s) + (0.1, 0.2, 0.3)
    np.testing.assert_allclose(feel.f_hand_W_N, pull_N, atol=1e-9)


@pytest.mark.parametrize("motor", range(3))
def test_the_warmest_motor_is_told(plate: Scene, motor: int) -> None:
    twin = Twin(plate, Omni(), X_WD=stand((0.0, 0.0, 0.05)))
    twin.reset((0.0, 0.0, 0.05))
    twin.body.arm.omni.heat[0, motor] = 0.5
    assert twin.run(Intent.hold((0.0, 0.0, 0.05), 1)).heat[0] == pytest.approx(0.5, rel=0.01)


def test_work_of_the_motors_is_what_the_free_mass_gains(plate_of: Callable[..., Scene]) -> None:
    twin = Twin(plate_of(1000.0), PointMass(0.045), effects=["wall"])
    twin.reset((0.0, 0.0, 0.001), (0.0, 0.0, -0.2))
    feel = twin.run(Intent.hold((0.0, 0.0, 0.0), 200, "none"))
    kinetic_J = 0.5 * 0.045 * (feel.v_W_m_s**2).sum(axis=1)
    assert feel.work_J[:-1].cumsum() == pytest.approx(kinetic_J[1:] - kinetic_J[0], abs=1e-12)
    assert kinetic_J[-1] > kinetic_J[0]  # a sampled spring gives energy (W8)


def test_the_same_seed_gives_the_same_bits_and_run_goes_on_where_it_was(plate: Scene) -> None:
    intent = act("tap", plate, TICK_S)
    X_WD = stand((0.0, 0.0, 0.01))
    first = Twin(plate, Omni(), handle=Plant(), seed=3, X_WD=X_WD).run(intent)
    twin = Twin(plate, Omni(), handle=Plant(), seed=3, X_WD=X_WD)
    quarter = len(intent) // 4
    step_m = np.linalg.norm(np.diff(intent.target_W_m, axis=0), axis=1)
    half = quarter + int(step_m[quarter : 3 * quarter].argmin()) + 1  # where the hand hardly moves
    parts = [
        Intent(intent.target_W_m[a:b], intent.grip[a:b], intent.push_W_N[a:b]) for a, b in ((0, half), (half, None))
    ]
    second = [twin.run(part) for part in parts]
    joined = np.concatenate([feel.a_handle_m_s2 for feel in second])
    assert first.a_handle_m_s2.any() and np.array_equal(first.f_coil_N > 0.0, first.a_handle_m_s2.any(axis=1))
    # the target's speed over the seam is not known to the first half: one tick differs in it, no more than that
    assert np.abs(joined - first.a_handle_m_s2).max() < 1e-3 * np.abs(first.a_handle_m_s2).max()


@pytest.mark.parametrize("device", [MASS, Omni()], ids=["point", "omni"])
def test_a_press_presses_as_hard_as_it_says(plate: Scene, device: PointMass | Omni) -> None:
    feel = Twin(plate, device).run(act("press", plate, TICK_S, grip="medium"))
    held_N = np.median(np.linalg.norm(feel.f_hand_W_N, axis=1)[feel.recording.touching])
    hand_N_m, wall_N_m = GRIPS["medium"].k_N_m, 500.0  # springs in a row: the wall gives way too
    assert held_N == pytest.approx(PRESS_N * wall_N_m / (hand_N_m + wall_N_m), rel=0.1)
    assert feel.rest_m_s < 5e-3


@pytest.mark.parametrize("name", GESTURES)
def test_every_gesture_touches_and_stays_finite(plate: Scene, name: str) -> None:
    feel = Twin(plate, Omni(), handle=Plant()).run(act(name, plate, TICK_S, grip="medium"))
    assert feel.recording.touching.any()
    assert np.isfinite(feel.p_W_m).all() and np.isfinite(feel.a_handle_m_s2).all()
    assert not feel.recording.flags.any()


def test_who_lets_go_pulls_no_more(plate: Scene) -> None:
    intent = act("let-go", plate, TICK_S)
    feel = Twin(plate, MASS).run(intent)
    free = intent.grip[:, 0] == 0.0
    assert free.any() and not feel.f_hand_W_N[free].any()
    assert feel.p_W_m[free, 2].max() > feel.p_W_m[~free, 2].min()  # the wall throws it out


def test_wrong_input_is_answered(plate: Scene) -> None:
    with pytest.raises(PathError, match="no gesture 'wave'"):
        act("wave", plate, TICK_S)
    with pytest.raises(PathError, match="choose light, medium or firm"):
        act("tap", plate, TICK_S, grip="none")
    with pytest.raises(HapsceneError, match="delay_ticks must be a whole number"):
        Twin(plate, MASS, delay_ticks=-1)
    with pytest.raises(HapsceneError, match="no device 'onmi'; there are: ideal, omni"):
        Twin(plate, "onmi")
    with pytest.raises(HapsceneError, match="device 'ideal' has no mass"):
        Twin(plate, "ideal")
    with pytest.raises(HapsceneError, match="invalid device"):
        Twin(plate, 3.0)  # type: ignore[arg-type]
    with pytest.raises(PathError, match="must be finite"):
        Intent.along([[0.0, 0.0, np.nan]])
    with pytest.raises(PathError, match=r"target_W_m must be \(1, 3\), a row per tick; it is \(0, 3\)"):
        Intent(*np.empty((3, 0, 3)))


@pytest.mark.parametrize(
    "made",
    [
        lambda: Intent.along([]),
        lambda: Intent.along(None),  # type: ignore[arg-type]
        lambda: Intent.along(np.zeros((3, 4))),
        lambda: Intent.along(np.zeros(5)),
        lambda: Intent.along(np.zeros((3, 3)), np.zeros((2, 3))),
        lambda: Intent.along(np.zeros((3, 3)), "light", (1e300, 0.0, 0.0)),
        lambda: Intent.hold((0.0, 0.0, 0.0), 0),
        lambda: Intent.hold((0.0, 0.0, 0.0), 1.5),  # type: ignore[arg-type]
        lambda: Intent.hold((0.0, 0.0), 5),
        lambda: Intent(1.0, 2.0, 3.0),  # type: ignore[arg-type]
    ],
)
def test_an_intention_that_is_none(made: Callable[[], Intent]) -> None:
    with pytest.raises(PathError):
        made()


def test_one_row_is_for_all_ticks() -> None:
    intent = Intent.along(np.zeros((4, 3)), (1.0, 2.0, 0.0), (0.0, 0.0, -1.0))
    assert intent.grip.tolist() == [[1.0, 2.0, 0.0]] * 4
    assert intent.push_W_N.tolist() == [[0.0, 0.0, -1.0]] * 4
    for plain in (Intent.along(np.zeros((4, 3))), Intent.hold((0.0, 0.0, 0.0), 4)):
        assert plain.grip.tolist() == [GRIPS["light"].row().tolist()] * 4 and not plain.push_W_N.any()


@pytest.fixture(scope="module")
def demo() -> Scene:
    return load_scene(assets.path("demo"))


@pytest.mark.parametrize("grip", ["light", "medium", "firm"])
@pytest.mark.parametrize("device", ["omni", "phantom-1.0", "premium-1.5"])
@pytest.mark.filterwarnings("ignore::hapscene.device.model.DeviceWarning")
def test_a_stroke_over_walls_and_a_pocket_ends_in_the_air_over_its_body(demo: Scene, device: str, grip: str) -> None:
    intent = act("stroke", demo, TICK_S, grip=grip)
    held = Omni() if device == "omni" else device_named(device).point
    feel = Twin(demo, held, limits=limits_of(device, TICK_S), handle=Plant()).run(intent)
    recording = feel.recording
    touching, body = recording.touching, demo.bodies[0]
    assert np.count_nonzero(touching) > 800
    assert np.all(recording.body[touching] == 0) and not touching[-1]
    assert np.count_nonzero(touching & (recording.flags & Flag.FORCE_LIMITED > 0)) < 0.05 * np.count_nonzero(touching)
    outward = recording.nhat_W[touching] @ (0.0, 0.0, 1.0)
    assert outward.min() > -0.1  # it never comes under the body
    assert np.linalg.norm(recording.p_WT_m[-1] - intent.target_W_m[-1]) < 0.01
    low_m, high_m = body.mesh.bounds_m + body.X_WB[:3, 3]
    assert np.all((recording.p_WT_m[touching, :2] > low_m[:2]) & (recording.p_WT_m[touching, :2] < high_m[:2]))
