"""The servo as a real process."""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.omni import Omni
from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError, PathError
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.servo import Servo

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


def until(true: Callable[[], bool], patience_s: float = 20.0) -> None:
    """Wait for something that the process does in its own time."""
    end_s = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < end_s, "it never came true"
        time.sleep(0.005)


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
    for x_m in np.linspace(-0.03, 0.03, 60):
        servo.aim((x_m, 0.0, -0.004), "medium")
        time.sleep(0.01)
    felt = servo.read(since)
    assert felt.first == since and len(felt.rows) > 400
    assert np.abs(felt.a_m_s2).max() > 0.1
    assert np.array_equal(felt.a_m_s2, felt.a_handle_m_s2)  # no handle: as asked for
    later = servo.read(felt.first + len(felt.rows))
    assert later.first == felt.first + len(felt.rows)


def test_a_change_is_felt_while_it_runs(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.0))
    servo.aim((0.0, 0.0, -0.006), "medium")
    until(lambda: servo.state().depth_m > 1e-3)
    time.sleep(0.5)
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
    servo.repaint(make_scene())
    with pytest.raises(HapsceneError, match="give the bodies that the renderer was made with"):
        servo.repaint(Scene())


def test_wrong_orders_are_answered_and_it_goes_on(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    with pytest.raises(HapsceneError, match="no swatch 'oka'"):
        servo.tune("oka", stiffness_N_m=1.0)
    with pytest.raises(PathError):
        servo.aim((0.0, np.nan, 0.0))
    with pytest.raises(HapsceneError, match="no grip 'fist'"):
        servo.aim((0.0, 0.0, 0.0), "fist")
    tick = servo.state().tick
    until(lambda: servo.state().tick > tick)


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


def test_a_killed_process_is_noticed_and_leaves_nothing() -> None:
    with Servo(make_scene(), MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        os.kill(servo._process.pid, signal.SIGKILL)
        until(lambda: not servo.alive)
        assert servo.state() is not None  # what was felt can still be read
        with pytest.raises(HapsceneError, match="has ended"):
            servo.tune("wood", stiffness_N_m=100.0)
    with pytest.raises(HapsceneError, match="closed"):
        servo.state()


def test_it_ends_with_an_application_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "application.py"
    script.write_text(
        "import os, sys\n"
        f"sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_servo import MASS, make_scene\n"
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
    servo._channel.channel[0].aim_count += 1  # Ctrl-C while it was written
    servo.aim((0.0, 0.0, -0.004), "medium")
    until(lambda: servo.state().touching)


@pytest.mark.parametrize("tick_s", [0.0, -1.0, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(tick_s: float) -> None:
    with pytest.raises(HapsceneError, match="must be finite and above 0"):
        Servo(make_scene(), MASS, tick_s=tick_s)


def test_what_cannot_be_sent_is_told_and_leaves_no_memory() -> None:
    servo = Servo(make_scene(), lambda: None)
    name = servo._channel.memory.name
    with pytest.raises((AttributeError, TypeError, pickle.PicklingError)), servo:
        pass
    with pytest.raises(FileNotFoundError):
        SharedMemory(name)


def test_what_the_process_refuses_is_told_in_a_line(capfd: pytest.CaptureFixture[str]) -> None:
    far = np.eye(4)
    far[0, 3] = 5.0
    with pytest.raises(HapsceneError, match="reach"), Servo(make_scene(), Omni(), X_WD=far):
        pass
    assert "Traceback" not in capfd.readouterr().err
