"""What breaks while a device is felt: real processes killed, stopped, torn out; the board's own clock says when no
force was left. The board is an emulated 2DIY, which keeps its last torques for ever.
"""

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hapscene.compiled.native import INTERPRETED
from hapscene.loop import SessionLog
from tests.until import PATIENCE_S, until

if not hasattr(os, "openpty"):
    pytest.skip("the board is on a pseudo-terminal", allow_module_level=True)
if INTERPRETED:
    pytest.skip("an interpreted tick takes longer than a period", allow_module_level=True)

WITHIN_S = 0.02
"""In which no force is left, where the application is gone or stopped: what `hapscene.device.safety` promises."""

GUARDED_S = 0.1
"""And where the servo is: the guard sees it after 50 ms, and opens the port."""


def slack_s() -> float:
    """How late this machine may be now: a loaded one gives the emulated board no time, and ticks that are late do not
    count the application's silence (`hapscene.device.safety`)."""
    return 0.05 if os.getloadavg()[0] < 0.5 * (os.cpu_count() or 1) else 1.5


APPLICATION = """
import signal, sys, time
import numpy as np, trimesh
from hapscene.device import choose
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.loop import Servo

if __name__ == "__main__":
    for key in (signal.SIGINT, signal.SIGQUIT):  # which a shell leaves ignored for what it starts in the background
        signal.signal(key, signal.default_int_handler if key == signal.SIGINT else signal.SIG_DFL)
    port, folder = sys.argv[1:]
    scene, pose = Scene(), np.eye(4)
    pose[2, 3] = -10.0
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.1, 0.1)), "m"), name="far", pose=pose)
    pull = {"weight": {"mass_kg": 0.1, "gravity_y_m_s2": -9.81, "gravity_z_m_s2": 0.0}}
    device = choose("haply2diy", port=port, homed=True)
    with Servo(scene, device, effects=["wall", "weight"], settings=pull, log_folder=folder) as servo:
        servo.start((0.0, 0.0, 0.0))
        print(servo._process.pid, servo._watchdog.pid, flush=True)
        while True:
            servo.state()
            time.sleep(0.01)
"""


@pytest.fixture
def emulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The drivers' tests' way to start emulators."""
    place = Path(__file__).parents[1] / "plugins" / "devices" / "conftest.py"
    spec = importlib.util.spec_from_file_location("emulated_devices", place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module


class Desk:
    """A board, and an application that pulls at it."""

    def __init__(self, emulated: Any, folder: Path) -> None:
        self.board = emulated.Emulated("haply2diy", folder)
        (folder / "application.py").write_text(APPLICATION)
        command = [sys.executable, str(folder / "application.py"), self.board.place, str(folder / "logs")]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.application = subprocess.Popen(command, **pipes, process_group=0)
        said = self.application.stdout.readline().strip()  # type: ignore[union-attr]
        assert said, self.application.communicate()[1]
        self.servo_pid, self.guard_pid = map(int, said.split())
        self.await_torque(lambda now: now > 0.99 * self.full())

    def full(self) -> float:
        """The largest torque so far, that of the whole force [N·m]; something, before any."""
        return max((abs(row[1]) for row in self.torques()), default=1.0) or 1.0

    def torques(self) -> list[list[float]]:
        return [row for row in self.board.rows() if len(row) == 3]

    def await_torque(self, good: Callable[[float], bool]) -> None:
        end_s, steady = time.monotonic() + PATIENCE_S, 0.0
        while True:
            rows = self.torques()
            now = abs(rows[-1][1]) if rows else 0.0
            if good(now) and (now == 0.0 or now == steady):
                return
            assert time.monotonic() < end_s, f"the torque stays at {now}"
            steady = now
            time.sleep(0.1)

    def none_left_after(self, since_ns: int) -> float:
        """How long after that the last torque that is not 0 was sent [s]; from then on there is none."""
        self.await_torque(lambda now: now == 0.0)
        return max(max(row[0] - since_ns, 0) for row in self.torques() if row[1] != 0.0 or row[2] != 0.0) * 1e-9

    def end(self) -> None:
        for stop in (lambda: os.kill(self.servo_pid, signal.SIGKILL), self.application.kill):
            with contextlib.suppress(ProcessLookupError):
                stop()
        self.application.communicate()
        self.board.end()


@pytest.fixture
def desk(emulated: Any, tmp_path: Path) -> Iterator[Desk]:
    made = Desk(emulated, tmp_path)
    yield made
    made.end()


def log_in(folder: Path) -> SessionLog:
    """The session log that is written there, sooner or later."""
    return SessionLog.load(until(lambda: [place for place in folder.glob("*") if not place.name.startswith(".")])[0])


def test_an_application_stopped_gone_on_and_killed(desk: Desk, tmp_path: Path) -> None:
    at_ns = time.monotonic_ns()
    os.kill(desk.application.pid, signal.SIGSTOP)
    assert desk.none_left_after(at_ns) < WITHIN_S + slack_s()
    os.kill(desk.application.pid, signal.SIGCONT)
    desk.await_torque(lambda now: now > 0.99 * desk.full())
    at_ns = time.monotonic_ns()
    os.kill(desk.application.pid, signal.SIGKILL)
    assert desk.none_left_after(at_ns) < WITHIN_S + slack_s()
    log = log_in(tmp_path / "logs")
    assert log.reason == "the application was gone" and log.rows.shape[1] > 1000
    assert len(log.replay().unlike) == 0


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_a_servo_that_dies_or_stands_still(desk: Desk, by: signal.Signals) -> None:
    at_ns = time.monotonic_ns()
    os.kill(desk.servo_pid, by)
    desk.await_torque(lambda now: now == 0.0)
    assert desk.none_left_after(at_ns) < GUARDED_S + slack_s()
    _, errors = desk.application.communicate(timeout=PATIENCE_S)
    assert "the servo's process has ended" in errors


def test_a_machine_that_sleeps_and_wakes_begins_anew(desk: Desk) -> None:
    asleep = desk.application.pid, desk.servo_pid, desk.guard_pid
    for pid in asleep:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(0.5)
    at_ns = time.monotonic_ns()
    for pid in asleep:
        os.kill(pid, signal.SIGCONT)
    desk.await_torque(lambda now: now > 0.99 * desk.full())  # nobody was ended
    after = [abs(row[1]) for row in desk.torques() if row[0] > at_ns + 5e7]
    assert min(after) == 0.0 and max(np.diff(after)) < 0.05 * desk.full()  # it rises, and does not jump


def test_a_board_that_takes_nothing_more_is_told_of_and_left_without_force(desk: Desk) -> None:
    os.kill(desk.board.process.pid, signal.SIGSTOP)  # its pipe fills
    _, errors = desk.application.communicate(timeout=PATIENCE_S)
    assert f"haply2diy: {desk.board.place}" in errors
    os.kill(desk.board.process.pid, signal.SIGCONT)
    desk.await_torque(lambda now: now == 0.0)


def test_a_device_torn_out_is_named_and_its_last_minute_kept(desk: Desk, tmp_path: Path) -> None:
    desk.board.tell(gone=1)
    _, errors = desk.application.communicate(timeout=PATIENCE_S)
    assert f"haply2diy: {desk.board.place}" in errors and "reconnect it" in errors
    log = log_in(tmp_path / "logs")
    assert "haply2diy" in log.reason and len(log.replay().unlike) == 0


def test_ctrl_c_leaves_no_force(desk: Desk) -> None:
    at_ns = time.monotonic_ns()
    os.kill(desk.application.pid, signal.SIGINT)
    assert desk.none_left_after(at_ns) < WITHIN_S + slack_s()


@pytest.mark.parametrize("key", [signal.SIGTSTP, signal.SIGQUIT], ids=["ctrl-z", "ctrl-backslash"])
def test_what_a_terminal_sends_to_all_processes_leaves_no_force(desk: Desk, key: signal.Signals) -> None:
    at_ns = time.monotonic_ns()
    os.killpg(desk.application.pid, key)
    assert desk.none_left_after(at_ns) < WITHIN_S + slack_s()


def test_a_servo_without_its_device_lives_to_say_so(desk: Desk) -> None:
    os.kill(desk.application.pid, signal.SIGSTOP)  # it looks late
    desk.board.tell(gone=1)
    time.sleep(2.0 * GUARDED_S)  # in which the guard would end what stands still
    os.kill(desk.application.pid, signal.SIGCONT)
    _, errors = desk.application.communicate(timeout=PATIENCE_S)
    assert "reconnect it" in errors
