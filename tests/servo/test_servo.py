"""The servo as a real process."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.omni import Omni, stand
from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError, PathError, SceneError
from hapscene.flags import Flag
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.servo import Servo
from tests.until import until

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
def servo() -> Iterator[Servo]:
    with Servo(make_scene(), MASS) as running:
        yield running


def until_tick(servo: Servo, tick: int) -> None:
    until(lambda: servo.state().tick >= tick)


def test_it_ticks_at_its_rate_and_follows_the_aim(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    first, start_s = servo.state().tick, time.monotonic()
    servo.aim((0.01, 0.0, -0.003), "medium")
    until(lambda: servo.state().tick >= first + 1500)
    took_s = time.monotonic() - start_s
    assert took_s > 1.4  # 1.5 s of ticks: a busy machine may make it late, never early
    state = servo.state()
    assert state.touching and state.f_W_N[2] > 0.2
    assert state.p_WP_m == pytest.approx((0.01, 0.0, 0.0), abs=2e-3)


def test_a_stroke_is_heard_and_the_ring_holds_it_without_gaps(servo: Servo) -> None:
    servo.start((-0.03, 0.0, 0.002))
    since = servo.state().tick + 1
    for k, x_m in enumerate(np.linspace(-0.03, 0.03, 60)):
        servo.aim((x_m, 0.0, -0.004), "medium")
        until_tick(servo, since + 10 * k)
    felt = servo.read(since)
    assert felt.first == since and len(felt.rows) > 400
    assert np.abs(felt.a_m_s2).max() > 0.1
    assert np.array_equal(felt.a_m_s2, felt.a_handle_m_s2)  # no handle: as asked for
    later = servo.read(felt.first + len(felt.rows))
    assert later.first == felt.first + len(felt.rows)


def test_a_change_is_felt_while_it_runs(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    until(lambda: servo.state().touching)
    until_tick(servo, servo.state().tick + 500)  # it rests on the spring
    before = servo.state()
    servo.tune("wood", stiffness_N_m=100.0)
    until(lambda: servo.state().depth_m > 1.2 * before.depth_m)


def test_repainting_while_it_runs(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    until(lambda: servo.state().touching)
    scene = make_scene()
    scene.paint("plate", hapscene.load_swatch("leather"), range(12))
    servo.repaint(scene)
    names = [swatch.name for swatch in scene.swatches]
    until(lambda: servo.state().swatch == names.index("leather"))
    scene.paint("plate", hapscene.load_swatch("paper"), hapscene.scene.Sphere((0.0, 0.0, 0.01), 0.004))
    assert "paper" not in [scene.swatches[i].name for i in scene.body("plate").face_swatch]  # it is within faces
    servo.repaint(scene)
    until(lambda: servo.state().swatch == len(names))
    servo.repaint(make_scene())
    with pytest.raises(HapsceneError, match="give the bodies that the renderer was made with"):
        servo.repaint(Scene())


def test_a_body_is_pushed_by_the_hand_and_told_what_it_got(servo: Servo) -> None:
    """A plate on a slide, which an application steps 60 times a second: its momentum is the impulse it was told."""
    servo.start((0.0, 0.0, 0.005))
    servo.free("plate", 0.3, inertia_B_kg_m2=(1e-3, 1e-3, 1e-3))
    z, v, told = -0.01, 0.0, np.zeros(3)
    servo.aim((0.0, 0.0, -0.02), "medium")
    since = servo.state().tick + 1
    for k in range(40):
        until_tick(servo, since + round(k * 1000 / 60))
        given = servo.impulse("plate").linear_N_s
        v += (given[2] - told[2]) / 0.3
        z, told = z + v / 60, given
        X_WB = np.eye(4)
        X_WB[2, 3] = z
        servo.move("plate", X_WB, v_W_m_s=(0.0, 0.0, v))
    log = servo.read(since)
    assert v < -0.01 and 0.3 * v == pytest.approx(told[2], rel=1e-12)
    assert np.abs(np.diff(log.rows["f_W_N"], axis=0)).max() < 0.5  # tests/contact/test_prediction.py has the figure
    felt = 1e-3 * np.cumsum(log.rows["f_body_W_N"][:, 2])
    assert felt[-1] == pytest.approx(servo.impulse("plate").linear_N_s[2], rel=0.1)
    events, after = servo.events(since)
    began = next(event for event in events if event.kind == "began")
    assert (began.body, began.swatch) == ("plate", "wood") and began.approach_m_s > 0.01
    assert after >= log.first + len(log.rows)
    servo.start((0.0, 0.0, 0.005))
    assert not np.any(servo.impulse("plate"))
    servo.free("plate", np.inf, inertia_B_kg_m2=(1.0, 1.0, 1.0))
    X_WB[2, 3] = -0.01
    servo.move("plate", X_WB, teleport=True)


def test_a_body_comes_and_goes_while_the_hand_touches_another(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.005))
    servo.aim((0.0, 0.0, -0.006), "medium")
    until_tick(servo, servo.state().tick + 500)  # it has settled
    first = servo.state().tick
    count = len(servo.scene.bodies)
    cube, up = trimesh.creation.box((0.02, 0.02, 0.02)), np.eye(4)
    up[:3, 3] = (0.03, 0.0, 0.01)
    servo.add(cube, name="cube", unit="m", swatch="epoxy", pose=up)
    servo.add(servo.scene.body("cube").mesh, name="twin", pose=np.eye(4))
    assert servo.read(first).rows["touching"].all()  # contact went on
    since = servo.state().tick
    servo.aim((0.03, 0.0, 0.03), "medium")
    until_tick(servo, since + 400)
    servo.aim((0.03, 0.0, 0.015), "medium")
    until(lambda: servo.state().touching)
    state = servo.state()
    assert (state.body, state.swatch) == (count, 2) and state.p_WP_m[2] == pytest.approx(0.02, abs=1e-6)
    assert ("cube", "epoxy") in {(event.body, event.swatch) for event in servo.events(since)[0]}
    assert servo.impulse("cube").linear_N_s[2] < 0.0
    servo.remove("cube")
    until(lambda: not servo.state().touching)
    with pytest.raises(SceneError, match="no body 'cube'"):
        servo.move("cube", up)
    servo.add(cube, name="cube", unit="m", pose=up)  # its name is free again, its number is not
    assert [body.name for body in servo.scene.bodies[count:]] == ["cube (removed)", "twin", "cube"]
    with pytest.raises(SceneError, match="already"):
        servo.add(cube, name="plate", unit="m")
    swatches = len(servo.scene.swatches)
    servo.scene.paint("twin", "leather")
    servo.repaint(servo.scene)
    assert (servo.scene.body("twin").face_swatch == swatches).all()
    for name in ("twin", "cube"):
        servo.remove(name)


def test_a_body_that_is_pushed_may_be_added(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.03))
    X_WB = np.eye(4)
    X_WB[2, 3] = 0.5
    servo.add(trimesh.creation.box((0.02, 0.02, 0.02)), name="thrown", unit="m", pose=X_WB)
    servo.free("thrown", 0.1, inertia_B_kg_m2=(1e-5, 1e-5, 1e-5))
    X_WB[2, 3] = 0.01
    servo.move("thrown", X_WB, teleport=True)
    servo.aim((0.0, 0.0, 0.015), "medium")
    until(lambda: servo.state().body == len(servo.scene.bodies) - 1)
    servo.remove("thrown")


def test_a_shape_changes_under_the_hand(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.005))
    servo.aim((0.0, 0.0, -0.006), "medium")
    until_tick(servo, servo.state().tick + 500)
    since = servo.state().tick
    vertices = np.array(servo.scene.body("plate").mesh.vertices_m)
    for size in np.linspace(1.0, 0.8, 20):
        servo.deform("plate", vertices * (1.0, 1.0, size))
        until_tick(servo, servo.state().tick + 16)
    until_tick(servo, servo.state().tick + 60)
    assert servo.read(since).rows["touching"].all()
    assert servo.state().p_WP_m[2] == pytest.approx(-0.002, abs=1e-9)  # its top was 10 mm over its middle
    with pytest.raises(SceneError, match="8 vertices"):
        servo.deform("plate", vertices[:5])
    servo.deform("plate", vertices)


def test_two_tools_touch_in_one_loop() -> None:
    with Servo(make_scene(), [MASS, MASS]) as servo:
        servo.start([(-0.03, 0.0, 0.01), (0.03, 0.0, 0.01)])
        servo.aim((-0.03, 0.0, -0.003), "medium")
        until(lambda: servo.state().touching)
        assert not servo.state(tool=1).touching
        servo.aim((0.03, 0.0, -0.006), "medium", tool=1)
        until(lambda: servo.state(tool=1).touching)
        until_tick(servo, servo.state().tick + 300)
        one, other = servo.state(), servo.state(tool=1)
        assert one.p_WP_m[0] == pytest.approx(-0.03, abs=2e-3) and other.p_WP_m[0] == pytest.approx(0.03, abs=2e-3)
        assert other.f_W_N[2] > 1.2 * one.f_W_N[2] > 0.0
        servo.rest()
        given = [servo.read(tool=tool).rows["f_body_W_N"].sum(axis=0) * servo.tick_s for tool in (0, 1)]
        assert servo.impulse("plate").linear_N_s == pytest.approx(given[0] + given[1], rel=1e-9)
        assert [len(servo.events(tool=tool)[0]) > 0 for tool in (0, 1)] == [True, True]
        with pytest.raises(HapsceneError, match="no tool 2: this servo has 2"):
            servo.state(tool=2)
        with pytest.raises(PathError, match="2 tools start at as many places"):
            servo.start((0.0, 0.0, 0.05))


def test_paused_it_stands_and_goes_on_in_contact(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    until_tick(servo, servo.state().tick + 20)
    until(lambda: servo.state().touching)
    servo.pause()
    before = servo.state()
    assert servo.state().tick == before.tick
    servo.resume()
    until_tick(servo, before.tick + 50)
    assert servo.read(before.tick + 1).rows["touching"].all() and not servo.read(before.tick + 1).rows["began"].any()


def test_a_pose_that_is_none_is_flagged_and_the_body_stays(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    bad = np.eye(4)
    bad[0, 3] = np.nan
    servo.move("plate", bad)
    until(lambda: Flag.POSE_REFUSED in servo.state().flags)
    good = np.eye(4)
    good[2, 3] = -0.01
    servo.move("plate", good)
    until(lambda: Flag.POSE_REFUSED not in servo.state().flags)


def test_wrong_orders_are_answered_and_it_goes_on(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    with pytest.raises(HapsceneError, match="no swatch 'oka'"):
        servo.tune("oka", stiffness_N_m=1.0)
    with pytest.raises(PathError):
        servo.aim((0.0, np.nan, 0.0))
    with pytest.raises(PathError, match="at most 10000 m"):
        servo.aim((0.0, 0.0, 2e4))
    with pytest.raises(SceneError, match="no body 'lid'; there are: plate"):
        servo.move("lid", np.eye(4))
    with pytest.raises(SceneError, match="a pose is a matrix"):
        servo.move("plate", np.eye(3))
    for wrong_motion in ({"v_W_m_s": (0.0, 1.0)}, {"w_W_rad_s": 1.0}, {"seen": [0.0] * 6}, {"v_W_m_s": [np.nan] * 3}):
        with pytest.raises(SceneError, match="three finite numbers each"):
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
        with pytest.raises(SceneError, match="mass and inertia"):
            servo.free("plate", wrong[0], inertia_B_kg_m2=wrong[1])
    for com in ((0.0, 0.0), (0.0, np.nan, 0.0)):
        with pytest.raises(SceneError, match="its centre of mass is three finite numbers"):
            servo.free("plate", 1.0, inertia_B_kg_m2=(1.0, 1.0, 1.0), com_B_m=com)
    with pytest.raises(HapsceneError, match="no grip 'fist'"):
        servo.aim((0.0, 0.0, 0.0), "fist")
    with pytest.raises(HapsceneError, match="a tick is a whole number, not 'now'"):
        servo.events("now")
    for wrong in ("hard", None, [1.0], 10**400):
        with pytest.raises(HapsceneError, match="stiffness_N_m must be a number"):
            servo.tune("wood", stiffness_N_m=wrong)
    more = servo.scene.copy()
    more.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="more", unit="m")
    with pytest.raises(SceneError, match="give the bodies that the renderer was made with"):
        servo.repaint(more)
    tick = servo.state().tick
    until(lambda: servo.state().tick > tick)


def test_orders_of_several_threads_go_one_after_the_other(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.03))
    vertices, wrong = np.array(servo.scene.body("plate").mesh.vertices_m), []

    def shape() -> None:
        for _ in range(50):
            servo.deform("plate", vertices)

    thread = threading.Thread(target=shape)
    thread.start()
    for _ in range(50):
        try:
            servo.tune("nothing", stiffness_N_m=1.0)
        except HapsceneError as error:
            wrong += [str(error)] * ("no swatch 'nothing'" not in str(error))
        else:
            wrong.append("taken")
    thread.join()
    assert not wrong


def test_an_interrupted_order_is_done_to_its_end_and_the_next_gets_its_own_answer(servo: Servo) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    servo.start((0.0, 0.0, 0.03))
    ball = trimesh.creation.icosphere(6, radius=0.02)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        with pytest.raises(KeyboardInterrupt):
            servo.add(ball, name="heavy", unit="m")
            time.sleep(1.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    with pytest.raises(HapsceneError, match="no swatch 'nothing'"):
        servo.tune("nothing", stiffness_N_m=1.0)
    servo.remove("heavy")
    assert "heavy" in servo.body_names and servo.scene.bodies[-1].name == "heavy (removed)"


def test_a_start_out_of_reach_leaves_it_running_where_it_is() -> None:
    with Servo(make_scene(), "omni", X_WD=stand((0.0, 0.0, 0.0))) as servo:
        servo.start((0.0, 0.0, 0.02))
        with pytest.raises(HapsceneError, match="reach"):
            servo.start((0.0, 0.0, 3.0))
        since = servo.state().tick
        until_tick(servo, since + 200)
        assert servo.state().p_WT_m == pytest.approx((0.0, 0.0, 0.02), abs=0.01)


def test_lateness_is_counted(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    tick = servo.state().tick
    until(lambda: servo.state().tick > tick + 100)
    late = servo.lateness()
    assert 0.0 < late.busy_us() <= late.busy_us(0.99)
    assert 0.0 < late.late_us() <= late.late_us(0.99)
    tick = servo.state().tick
    until(lambda: servo.state().tick > tick + 100)
    since = servo.lateness().since(late)
    assert since.late.sum() > 100 and since.busy.sum() > 100
    assert (since.late >= 0).all() and since.missed >= 0


def test_what_the_twin_refuses_is_said_at_the_start() -> None:
    with pytest.raises(HapsceneError, match="the scene has no bodies"):
        Servo(Scene(), MASS).__enter__()


ASKED: dict[str, Callable[[Servo], object]] = {
    "state": lambda servo: servo.state(),
    "read": lambda servo: servo.read(),
    "aim": lambda servo: servo.aim((0.0, 0.0, 0.0)),
    "lateness": lambda servo: servo.lateness(),
    "tune": lambda servo: servo.tune("wood", stiffness_N_m=100.0),
    "rest": lambda servo: servo.rest(),
}


@pytest.mark.skipif(not hasattr(os, "waitid"), reason="no way to see a death without taking note of it")
def test_whatever_is_asked_of_a_killed_process_is_refused_and_what_it_felt_can_be_read() -> None:
    with Servo(make_scene(), MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        until_tick(servo, 50)
        os.kill(servo._process.pid, signal.SIGKILL)
        os.waitid(os.P_PID, servo._process.pid, os.WEXITED | os.WNOWAIT)  # from here on its death can be known
        took_s = []
        for asked in ASKED.values():
            start_s = time.monotonic()
            with pytest.raises(HapsceneError, match=r"the servo's process has ended \(exit code -9\)"):
                asked(servo)
            took_s.append(time.monotonic() - start_s)
        assert np.median(took_s) < 0.01  # a busy machine may hold up one of them
        assert "ended" in repr(servo)
        felt = servo.read(10, after_end=True)
        assert felt.first == 10 and len(felt.rows) > 40 and np.ptp(felt.rows["p_WT_m"][:, 2]) < 1e-6
    for asked in ASKED.values():
        with pytest.raises(HapsceneError, match="this servo is closed"):
            asked(servo)
    with pytest.raises(HapsceneError, match="this servo is closed"):
        servo.read(after_end=True)
    with pytest.raises(HapsceneError, match="entered once"):
        servo.__enter__()


@pytest.mark.parametrize("name", ASKED)
def test_whatever_is_asked_of_a_servo_that_was_not_entered_is_refused(name: str) -> None:
    servo = Servo(make_scene(), MASS)
    with pytest.raises(HapsceneError, match="use it as a context"):
        ASKED[name](servo)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGSTOP there")
def test_a_process_that_hangs_is_seen_by_the_age_of_its_state(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    tick = servo.state().tick
    until(lambda: servo.state().tick > tick and servo.state().age_s < 0.01)
    os.kill(servo._process.pid, signal.SIGSTOP)
    try:
        until(lambda: servo.state().age_s > 0.2)
        tick = servo.state().tick
        before_s, first, again = time.monotonic(), servo.state(), servo.state()
        assert first.tick == again.tick == tick  # it stands, and ages as the clock goes
        assert 0.0 < again.age_s - first.age_s <= time.monotonic() - before_s
    finally:
        os.kill(servo._process.pid, signal.SIGCONT)
    until(lambda: servo.state().tick > tick and servo.state().age_s < 0.01)
    servo.rest()
    rested = servo.state()
    until(lambda: servo.state().age_s > rested.age_s + 0.05)  # at rest too
    assert servo.state().tick == rested.tick
    assert rested[:1] == (rested.tick,) and rested[11:13] == (rested.flags, rested.age_s)  # older places as they were


def test_before_the_first_tick_the_age_is_without_end() -> None:
    with Servo(make_scene(), MASS) as servo:
        assert servo.state().tick == -1 and servo.state().age_s == np.inf
        with pytest.raises(HapsceneError, match="entered once"):
            servo.__enter__()
        assert servo.alive


def test_the_example_of_the_package_runs_as_a_script(tmp_path: Path) -> None:
    """Its process reads the script anew, as everywhere where processes are spawned."""
    assert hapscene.servo.__doc__ is not None
    script = tmp_path / "example.py"
    script.write_text(re.split(r"```(?:python)?\n", hapscene.servo.__doc__)[1])
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, script], cwd=root, capture_output=True, text=True, timeout=100.0)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert re.fullmatch(r"\[[-0-9. e]+\]\n", done.stdout)


def test_it_ends_with_an_application_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "application.py"
    script.write_text(
        "import os, sys\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n"
        "from tests.servo.test_servo import MASS, make_scene\n"
        "from hapscene.servo import Servo\n"
        "if __name__ == '__main__':\n"
        "    servo = Servo(make_scene(), MASS).__enter__()\n"
        "    servo.start((0.0, 0.0, 0.01))\n"
        "    print(servo._process.pid, flush=True)\n"
        "    sys.stdin.read()\n"
    )
    application = subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert application.stdout is not None
    pid = int(application.stdout.readline())
    application.kill()
    application.wait()

    def gone() -> bool:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        return state == "Z"

    if not Path("/proc").is_dir():
        pytest.skip("no /proc here to see the process end")
    until(gone)


def test_an_aim_that_is_none_does_not_spoil_the_next(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    with pytest.raises(AttributeError):
        servo.aim((0.0, 0.0, 0.0), None)  # type: ignore[arg-type]
    servo.aim((0.0, 0.0, -0.004), "medium")
    until(lambda: servo.state().touching)


def test_an_aim_that_was_interrupted_does_not_spoil_the_next(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    servo._channel.aims["count"] += 1  # Ctrl-C while it was written
    servo.aim((0.0, 0.0, -0.004), "medium")
    until(lambda: servo.state().touching)


@pytest.mark.parametrize("tick_s", [0.0, -1.0, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(tick_s: float) -> None:
    with pytest.raises(HapsceneError, match="must be finite and above 0"):
        Servo(make_scene(), MASS, tick_s=tick_s)


def test_what_the_process_refuses_is_told_in_a_line(capfd: pytest.CaptureFixture[str]) -> None:
    far = np.eye(4)
    far[0, 3] = 5.0
    with pytest.raises(HapsceneError, match="reach"), Servo(make_scene(), Omni(), X_WD=far):
        pass
    assert "Traceback" not in capfd.readouterr().err
