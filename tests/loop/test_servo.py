"""The interface of the servo, with its loop on a virtual clock; `test_servo_process.py` tests the real process."""

import warnings
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.sim.omni import stand
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError, PathError, SceneError, UsageWarning
from hapscene.flags import Flag
from hapscene.loop import Servo, servo_process
from hapscene.loop.timing import LATE_MAX
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from tests.virtual_servo import VirtualServo

MASS = PointMass(0.045, 0.1, 0.26, 5.5e-5)


def make_scene() -> Scene:
    """A plate whose top is z = 0."""
    scene = Scene()
    X_WB = np.eye(4)
    X_WB[2, 3] = -0.01
    box = Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m")
    scene.add(box, name="plate", pose=X_WB, swatch=hapscene.load_swatch("wood"))
    return scene


@pytest.fixture(scope="module")
def servo() -> Iterator[VirtualServo]:
    with VirtualServo(make_scene(), MASS) as running:
        yield running


def test_tick_rate_and_target(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    first, start_s = servo.state().tick, servo.clock.now_s()
    servo.aim((0.01, 0.0, -0.003), "medium")
    servo.advance(1500)
    state = servo.state()
    assert state.tick == first + 1500 and servo.clock.now_s() - start_s == pytest.approx(1.5, abs=2e-3)
    assert state.touching and state.f_W_N[2] > 0.2
    assert state.p_WP_m == pytest.approx((0.01, 0.0, 0.0), abs=2e-3)


def test_ring_buffer_holds_a_stroke_without_gaps(servo: VirtualServo) -> None:
    servo.start((-0.03, 0.0, 0.002))
    since = servo.state().tick + 1
    for x_m in np.linspace(-0.03, 0.03, 60):
        servo.aim((x_m, 0.0, -0.004), "medium")
        servo.advance(10)
    log = servo.read(since)
    assert log.first == since and len(log.rows) == 600
    assert np.abs(log.a_m_s2).max() > 0.1
    assert np.array_equal(log.a_m_s2, log.a_handle_m_s2)  # as desired, without a handle
    later = servo.read(log.first + len(log.rows))
    assert later.first == log.first + len(log.rows)


def test_tune_while_running(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    servo.until(lambda: servo.state().touching)
    servo.advance(500)  # equilibrium with the spring
    before = servo.state()
    assert servo.contact() is not None
    servo.tune("wood", stiffness_N_m=100.0)
    servo.until(lambda: servo.state().depth_m > 1.2 * before.depth_m)


def test_repaint_while_running(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    servo.until(lambda: servo.state().touching)
    scene = make_scene()
    scene.paint("plate", hapscene.load_swatch("leather"), range(12))
    servo.repaint(scene)
    names = [swatch.name for swatch in scene.swatches]
    servo.until(lambda: servo.state().swatch == names.index("leather"))
    scene.paint("plate", hapscene.load_swatch("paper"), hapscene.scene.Sphere((0.0, 0.0, 0.01), 0.004))
    assert "paper" not in [
        scene.swatches[i].name for i in scene.body("plate").face_swatch
    ]  # the region is smaller than a face
    servo.repaint(scene)
    servo.until(lambda: servo.state().swatch == len(names))
    servo.repaint(make_scene())
    with pytest.raises(HapsceneError, match="bodies"):
        servo.repaint(Scene())


def test_pushed_body_receives_the_impulse(servo: VirtualServo) -> None:
    """A plate on a slide, simulated at 60 Hz: its momentum equals the reported impulse."""
    servo.start((0.0, 0.0, 0.005))
    rounded = np.diag([1e-3, 2e-3, 4e-3])
    rounded[0, 1] = 1e-12
    servo.set_mass("plate", 0.3, inertia_B_kg_m2=rounded, com_B_m=(0.0, 0.0, 1e-3))
    frame = servo._frames[0]
    assert frame["inverse_mass"] == pytest.approx(1.0 / 0.3) and frame["com_B_m"].tolist() == [0.0, 0.0, 1e-3]
    np.testing.assert_allclose(frame["inverse_inertia_B"], np.diag([1e3, 500.0, 250.0]), atol=1e-6)
    z, v, last = -0.01, 0.0, np.zeros(3)
    servo.aim((0.0, 0.0, -0.02), "medium")
    since = servo.state().tick + 1
    for k in range(40):
        servo.advance(16 + (k % 3 > 0))
        given = servo.impulse("plate").linear_N_s
        v += (given[2] - last[2]) / 0.3
        z, last = z + v / 60, given
        X_WB = np.eye(4)
        X_WB[2, 3] = z
        servo.move("plate", X_WB, v_W_m_s=(0.0, 0.0, v))
    log = servo.read(since)
    assert v < -0.01 and 0.3 * v == pytest.approx(last[2], rel=1e-12)
    assert np.abs(np.diff(log.rows["f_W_N"], axis=0)).max() < 0.5  # tests/contact/test_prediction.py has the figure
    impulse = 1e-3 * np.cumsum(log.rows["f_body_W_N"][:, 2])
    assert impulse[-1] == pytest.approx(servo.impulse("plate").linear_N_s[2], rel=0.1)
    events, after = servo.events(since)
    began = next(event for event in events if event.kind == "began")
    assert (began.body, began.swatch) == ("plate", "wood") and began.approach_m_s > 0.01
    assert after >= log.first + len(log.rows)
    servo.start((0.0, 0.0, 0.005))
    assert not np.any(servo.impulse("plate"))
    servo.set_mass("plate", np.inf, inertia_B_kg_m2=(1.0, 1.0, 1.0))
    assert servo._frames[0]["inverse_mass"] == 0.0 and not servo._frames[0]["inverse_inertia_B"].any()
    X_WB[2, 3] = 0.05
    servo.move("plate", X_WB, teleport=True)  # past the tool
    servo.advance(50)
    assert not servo.state().touching
    X_WB[2, 3] = -0.01
    servo.move("plate", X_WB, teleport=True)


def test_add_and_remove_bodies_in_contact(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.005))
    servo.aim((0.0, 0.0, -0.006), "medium")
    servo.advance(500)  # equilibrium
    first = servo.state().tick
    count = len(servo.scene.bodies)
    cube, up = trimesh.creation.box((0.02, 0.02, 0.02)), np.eye(4)
    up[:3, 3] = (0.03, 0.0, 0.01)
    servo.add(cube, name="cube", unit="m", swatch="epoxy", pose=up)
    servo.add(servo.scene.body("cube").mesh, name="twin", pose=np.eye(4))
    servo.advance(20)
    assert servo.read(first).rows["touching"].all()  # contact continued
    since = servo.state().tick
    servo.aim((0.03, 0.0, 0.03), "medium")
    servo.advance(400)
    servo.aim((0.03, 0.0, 0.015), "medium")
    servo.until(lambda: servo.state().touching)
    servo.advance(20)
    state = servo.state()
    assert (state.body, state.swatch) == (count, 2) and state.p_WP_m[2] == pytest.approx(0.02, abs=1e-6)
    assert ("cube", "epoxy") in {(event.body, event.swatch) for event in servo.events(since)[0]}
    assert servo.impulse("cube").linear_N_s[2] < 0.0
    servo.remove("cube")
    servo.until(lambda: not servo.state().touching)
    with pytest.raises(SceneError, match="cube"):
        servo.move("cube", up)
    servo.add(cube, name="cube", unit="m", pose=up)  # the name can be reused, the number cannot
    assert [body.name for body in servo.scene.bodies[count:]] == ["cube (removed)", "twin", "cube"]
    with pytest.raises(SceneError, match="plate"):
        servo.add(cube, name="plate", unit="m")
    swatches = len(servo.scene.swatches)
    servo.scene.paint("twin", "leather")
    servo.repaint(servo.scene)
    assert (servo.scene.body("twin").face_swatch == swatches).all()
    for name in ("twin", "cube"):
        servo.remove(name)


def test_deform_in_contact(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.005))
    servo.aim((0.0, 0.0, -0.006), "medium")
    servo.advance(500)
    since = servo.state().tick
    vertices = np.array(servo.scene.body("plate").mesh.vertices_m)
    for size in np.linspace(1.0, 0.8, 20):
        servo.deform("plate", vertices * (1.0, 1.0, size))
        servo.advance(16)
    servo.advance(60)
    assert servo.read(since).rows["touching"].all()
    assert servo.state().p_WP_m[2] == pytest.approx(-0.002, abs=1e-9)  # its top was 10 mm above its centre
    with pytest.raises(SceneError, match="plate"):
        servo.deform("plate", vertices[:5])
    servo.deform("plate", vertices)


def test_two_tools() -> None:
    with VirtualServo(make_scene(), [MASS, MASS]) as servo:
        servo.start([(-0.03, 0.0, 0.01), (0.03, 0.0, 0.01)])
        servo.aim((-0.03, 0.0, -0.003), "medium")
        servo.until(lambda: servo.state().touching)
        assert not servo.state(tool=1).touching
        servo.aim((0.03, 0.0, -0.006), "medium", tool=1)
        servo.until(lambda: servo.state(tool=1).touching)
        servo.advance(300)
        one, other = servo.state(), servo.state(tool=1)
        assert one.p_WP_m[0] == pytest.approx(-0.03, abs=2e-3) and other.p_WP_m[0] == pytest.approx(0.03, abs=2e-3)
        assert other.f_W_N[2] > 1.2 * one.f_W_N[2] > 0.0
        servo.pause()
        given = [servo.read(tool=tool).rows["f_body_W_N"].sum(axis=0) * servo.tick_s for tool in (0, 1)]
        assert servo.impulse("plate").linear_N_s == pytest.approx(given[0] + given[1], rel=1e-9)
        assert [len(servo.events(tool=tool)[0]) > 0 for tool in (0, 1)] == [True, True]
        with pytest.raises(HapsceneError, match="tool 2"):
            servo.state(tool=2)
        with pytest.raises(PathError, match="p_WT"):
            servo.start((0.0, 0.0, 0.05))
        servo.resume()
        before = servo.impulse("plate").linear_N_s
        given = servo.start((0.0, 0.0, 0.0), tool=1)  # its impulse starts from 0; the other goes on
        assert given[0, :3] == pytest.approx(before - servo.impulse("plate").linear_N_s) and given[0, 2] < 0.0
        servo.aim((0.03, 0.0, -0.006), "medium", tool=1)
        servo.advance(300)
        assert servo.state().f_W_N[2] > 0.0 and servo.state(tool=1).f_W_N[2] > 0.0
        servo.withdraw(tool=1)
        servo.advance(10)
        assert servo.state().f_W_N[2] > 0.0 and not servo.state(tool=1).f_W_N.any()
    with VirtualServo(make_scene(), [MASS, MASS]) as servo:
        servo.start((0.0, 0.0, 0.0), tool=1)
        for tool in (0, 1):
            servo.aim((0.0, 0.0, -0.006), "medium", tool=tool)
        servo.advance(100)
        assert [servo.state(tool=tool).f_W_N.any() for tool in (0, 1)] == [False, True]  # one was never started


def test_pause_and_resume_in_contact(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    servo.advance(20)
    servo.until(lambda: servo.state().touching)
    servo.pause()
    before = servo.state()
    assert servo.state().tick == before.tick
    servo.resume()
    servo.advance(50)
    assert servo.read(before.tick + 1).rows["touching"].all() and not servo.read(before.tick + 1).rows["began"].any()


def test_invalid_pose_is_flagged(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    bad = np.eye(4)
    bad[0, 3] = np.nan
    servo.move("plate", bad)
    with pytest.warns(UsageWarning, match="'plate'"):
        servo.until(lambda: Flag.POSE_REFUSED in servo.state().flags)
    good = np.eye(4)
    good[2, 3] = -0.01
    servo.move("plate", good)
    servo.until(lambda: Flag.POSE_REFUSED not in servo.state().flags)


def test_invalid_orders_are_rejected(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    with pytest.raises(HapsceneError, match="oka"):
        servo.tune("oka", stiffness_N_m=1.0)
    with pytest.raises(PathError):
        servo.aim((0.0, np.nan, 0.0))
    with pytest.raises(PathError, match="10000"):
        servo.aim((0.0, 0.0, 2e4))
    for push_N in ((0.0, 0.0, 2e4), (0.0, 0.0, np.nan), (0.0, 1.0)):
        with pytest.raises(PathError):
            servo.aim((0.0, 0.0, 0.0), "light", push_N)
    with pytest.raises(SceneError, match="lid"):
        servo.move("lid", np.eye(4))
    with pytest.raises(SceneError, match="plate"):
        servo.move("plate", np.eye(3))
    for wrong_motion in (
        {"v_W_m_s": (0.0, 1.0)},
        {"w_W_rad_s": 1.0},
        {"applied": [0.0] * 6},
        {"v_W_m_s": [np.nan] * 3},
    ):
        with pytest.raises(SceneError, match="plate"):
            servo.move("plate", np.eye(4), **wrong_motion)
    lopsided = [[1.0, 0.9, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for wrong in (
        (-1.0, (1.0, 1.0, 1.0)),
        (1.0, (1.0, 0.0, 1.0)),
        (1.0, 1.0),
        ([1, 2], (1, 1, 1)),
        (1.0, [np.nan] * 3),
        (1e-320, (1.0, 1.0, 1.0)),
        (1.0, lopsided),
    ):
        with pytest.raises(SceneError, match="plate"):
            servo.set_mass("plate", wrong[0], inertia_B_kg_m2=wrong[1])
    for com in ((0.0, 0.0), (0.0, np.nan, 0.0), (0.0, 0.0, 2e4)):
        with pytest.raises(SceneError, match="com_B_m"):
            servo.set_mass("plate", 1.0, inertia_B_kg_m2=(1.0, 1.0, 1.0), com_B_m=com)
    with pytest.raises(HapsceneError, match="fist"):
        servo.aim((0.0, 0.0, 0.0), "fist")
    with pytest.raises(HapsceneError, match="now"):
        servo.events("now")
    for wrong in ("hard", None, [1.0], 10**400):
        with pytest.raises(HapsceneError, match="stiffness_N_m"):
            servo.tune("wood", stiffness_N_m=wrong)
    more = servo.scene.copy()
    more.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="more", unit="m")
    with pytest.raises(SceneError, match="bodies"):
        servo.repaint(more)
    tick = servo.state().tick
    servo.advance(1)
    assert servo.state().tick == tick + 1


def test_start_inside_a_body_is_reported() -> None:
    """Not for a body that moves: its first pose may be elsewhere."""
    with VirtualServo(make_scene(), MASS) as servo:
        with pytest.warns(UsageWarning, match="plate"):
            servo.start((0.0, 0.0, -0.01))
        servo.move("plate", np.eye(4))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            servo.start((0.0, 0.0, -0.01))


def test_start_out_of_reach_keeps_running() -> None:
    with VirtualServo(make_scene(), "omni", X_WD=stand((0.0, 0.0, 0.0))) as servo:
        servo.start((0.0, 0.0, 0.02))
        with pytest.raises(HapsceneError, match="reach"):
            servo.start((0.0, 0.0, 3.0))
        servo.advance(200)
        assert servo.state().p_WT_m == pytest.approx((0.0, 0.0, 0.02), abs=0.01)


def test_delays_are_counted(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    servo.advance(100)
    before = servo.timing()
    assert 0.0 < before.busy_us() <= before.busy_us(0.99)
    assert 0.0 < before.delay_us() <= before.delay_us(0.99)
    servo.clock.sleep_s(0.005)  # the processor was busy: five ticks are due
    servo.advance(100)
    since = servo.timing().since(before)
    assert since.delay.sum() == since.busy.sum() == 100 and since.missed == 0
    assert since.delay_us(1.0) == pytest.approx(4000.0, rel=0.1) and since.delay_us(0.94) < 2.0
    servo.clock.sleep_s(1e-3 * (LATE_MAX + 10))
    servo.advance(1)
    assert servo.timing().since(before).missed > LATE_MAX


def test_binding_time_delays_no_tick(servo: VirtualServo, monkeypatch: pytest.MonkeyPatch) -> None:
    before, bind = servo.timing(), servo_process.bound
    monkeypatch.setattr(servo_process, "bound", lambda loop: (servo.clock.sleep_s(1.0), bind(loop))[1])
    servo.start((0.0, 0.0, 0.01))
    servo.advance(10)
    servo.pause()
    servo.resume()
    servo.advance(10)
    since = servo.timing().since(before)
    assert since.missed == 0 and since.delay_us(1.0) < 1000.0


@pytest.mark.parametrize(
    "order",
    [
        lambda servo: servo.repaint(make_scene()),
        lambda servo: servo.add(trimesh.creation.box((0.02, 0.02, 0.02)), name="cube", unit="m", pose=np.eye(4)),
        lambda servo: servo.remove("plate"),
    ],
    ids=["repaint", "add", "remove"],
)
def test_order_counts_the_ticks_that_it_costs(
    servo: VirtualServo, monkeypatch: pytest.MonkeyPatch, order: Callable[[VirtualServo], object]
) -> None:
    bind = servo_process.bound
    servo.start((0.0, 0.0, 0.01))
    servo.advance(10)
    before = servo.timing()
    monkeypatch.setattr(servo_process, "bound", lambda loop: (servo.clock.sleep_s(0.012), bind(loop))[1])
    order(servo)
    servo.advance(10)
    assert servo.timing().since(before).missed == pytest.approx(12, abs=1)


def test_age_of_the_state_grows_while_paused(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    servo.advance(3)
    for _ in range(2):
        before = servo.state()
        servo.clock.sleep_s(0.05)
        after = servo.state()
        assert after.tick == before.tick and after.age_s == pytest.approx(before.age_s + 0.05)
        assert after[:1] == (after.tick,) and after[11:13] == (after.flags, after.age_s)
        servo.pause()


def test_invalid_scene_is_rejected_at_the_start() -> None:
    with pytest.raises(HapsceneError, match="bodies"):
        Servo(Scene(), MASS).__enter__()


ASKED: dict[str, Callable[[Servo], object]] = {
    "state": lambda servo: servo.state(),
    "read": lambda servo: servo.read(),
    "aim": lambda servo: servo.aim((0.0, 0.0, 0.0)),
    "timing": lambda servo: servo.timing(),
    "tune": lambda servo: servo.tune("wood", stiffness_N_m=100.0),
    "pause": lambda servo: servo.pause(),
}


@pytest.mark.parametrize("name", ASKED)
def test_servo_not_entered_rejects_calls(name: str) -> None:
    servo = Servo(make_scene(), MASS)
    with pytest.raises(HapsceneError, match="context"):
        ASKED[name](servo)


def test_age_before_the_first_tick_is_infinite() -> None:
    with VirtualServo(make_scene(), MASS) as servo:
        assert servo.state().tick == -1 and servo.state().age_s == np.inf and servo.contact() is None
        with pytest.raises(HapsceneError, match="entered"):
            servo.__enter__()
        assert servo.alive


def test_invalid_target_does_not_block_the_next(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    with pytest.raises(AttributeError):
        servo.aim((0.0, 0.0, 0.0), None)  # type: ignore[arg-type]
    servo.aim((0.0, 0.0, -0.004), "medium")
    servo.until(lambda: servo.state().touching)


def test_interrupted_target_does_not_block_the_next(servo: VirtualServo) -> None:
    servo.start((0.0, 0.0, 0.01))
    servo._channel.aims["count"] = 7  # Ctrl-C during a call
    servo.aim((0.0, 0.0, -0.004), "medium")
    assert servo._channel.aims["count"].tolist() == [8]
    servo.until(lambda: servo.state().touching)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tick_s", (0.0, -1.0, np.nan, np.inf)),
        ("patience_s", (0.0, np.nan)),
        ("ring_s", (0.0, np.nan, np.inf)),
        ("device", ([], "onmi")),
    ],
)
def test_invalid_arguments_are_rejected(name: str, values: tuple[Any, ...]) -> None:
    for value in values:
        with pytest.raises(HapsceneError, match=name):
            Servo(make_scene(), **{"device": MASS, name: value})


def test_a_real_handle_is_asked_and_turned(servo: VirtualServo, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HapsceneError, match="falcon"):  # it plays nothing
        Servo(make_scene(), MASS, handle="falcon")
    servo.turn_handle(0.5)
    assert servo.handle_report() == {}
    volumes = list[float]()
    played = SimpleNamespace(update_report=lambda: {"latency_s": 0.02}, set_volume=volumes.append)
    monkeypatch.setattr(servo, "_played", played)
    servo.turn_handle(0.5)
    assert servo.handle_report() == {"latency_s": 0.02} and volumes == [0.5]
