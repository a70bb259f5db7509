"""The servo in a real process: orders, errors, and its end."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.clock import new_clock
from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError
from hapscene.loop import Servo
from hapscene.loop.driver import CHANNEL
from hapscene.loop.servo_process import OrderHandler
from hapscene.loop.timing import LATE_MAX, TIMING, Timer, start_timer, wait_for_tick
from hapscene.records import records
from tests.loop.test_driver import TICK_NS, handler  # noqa: F401  # a fixture
from tests.loop.test_servo import MASS, make_scene
from tests.until import until


@pytest.fixture(scope="module")
def servo() -> Iterator[Servo]:
    with Servo(make_scene(), MASS) as running:
        yield running


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGSTOP there")
def test_age_reveals_a_hanging_process(servo: Servo) -> None:
    servo.start((0.0, 0.0, 0.01))
    tick = servo.state().tick
    until(lambda: servo.state().tick > tick and servo.state().age_s < 0.01)
    os.kill(servo._process.pid, signal.SIGSTOP)
    try:
        until(lambda: servo.state().age_s > 0.2)
        tick = servo.state().tick
        before_s, first, again = time.monotonic(), servo.state(), servo.state()
        assert first.tick == again.tick == tick  # no ticks, but the age grows
        assert 0.0 < again.age_s - first.age_s <= time.monotonic() - before_s
    finally:
        os.kill(servo._process.pid, signal.SIGCONT)
    until(lambda: servo.state().tick > tick and servo.state().age_s < 0.01)
    servo.pause()
    rested = servo.state()
    until(lambda: servo.state().age_s > rested.age_s + 0.05)  # also while paused
    assert servo.state().tick == rested.tick
    assert rested[:1] == (rested.tick,) and rested[11:13] == (rested.flags, rested.age_s)


def test_the_example_of_the_package_runs_as_a_script(tmp_path: Path) -> None:
    """The spawned process imports the script again."""
    assert hapscene.loop.__doc__ is not None
    script = tmp_path / "example.py"
    script.write_text(re.split(r"```(?:python)?\n", hapscene.loop.__doc__)[1])
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run([sys.executable, script], cwd=root, capture_output=True, text=True, timeout=100.0)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert re.fullmatch(r"\[[-0-9. e]+\]\n", done.stdout)


def test_interrupted_order_is_completed(servo: Servo) -> None:
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
    with pytest.raises(HapsceneError, match="nothing"):
        servo.tune("nothing", stiffness_N_m=1.0)
    servo.remove("heavy")
    assert "heavy" in servo.body_names and servo.scene.bodies[-1].name == "heavy (removed)"


def test_orders_of_threads_are_serialised(servo: Servo) -> None:
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


# The loop on a real clock.


def test_wait_sleeps_until_shortly_before_the_tick() -> None:
    """A tick costs some microseconds of processor time, of which 50 are polling."""
    period_ns, count = 20 * TICK_NS, 10
    timer = Timer(records(1, CHANNEL)[0], new_clock(), records(1, TIMING)[0], period_ns)
    wait_for_tick(timer)  # compiled
    start_timer(timer)
    used_s = time.thread_time()
    for _ in range(count):
        wait_for_tick(timer)
    used_s = time.thread_time() - used_s
    assert used_s < 0.05 * count * period_ns * 1e-9  # also if a busy wait got only a tenth of a core


@pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes all there is")
@pytest.mark.parametrize("handler", [1e-3, 4e-3], indirect=True)
def test_loop_keeps_its_period_and_sleeps(handler: OrderHandler) -> None:  # noqa: F811
    channel, tick_s = handler._channel.channel[0], handler._twins[0].renderer.tick_s

    def live() -> tuple[float, float]:
        wall_s, used_s = time.monotonic(), time.thread_time()
        handler._bind()[0]()
        return time.monotonic() - wall_s, time.thread_time() - used_s

    channel.pause = 0
    with ThreadPoolExecutor(1) as lane:
        times = lane.submit(live)
        end_s = time.monotonic() + 60.0
        while channel.done < 100 and time.monotonic() < end_s:
            time.sleep(0.001)
        channel.pause = 1
        wall_s, used_s = times.result()
    ticks = channel.done + channel.missed
    assert channel.done >= 100 and ticks * tick_s <= wall_s  # no early ticks
    assert wall_s < (ticks + LATE_MAX + 2) * tick_s  # each tick is done, missed or being made up
    assert channel.late.sum() == channel.busy.sum() == channel.done
    assert used_s < 3e-4 * ticks
