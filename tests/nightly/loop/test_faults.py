"""Faults in operation: processes are killed and stopped, devices are unplugged. The clock of the board shows when the
force ended. The board is an emulated 2DIY, which holds its last torques indefinitely.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.compiled.native import INTERPRETED
from hapscene.loop import SessionLog
from tests.nightly.plugins.devices.conftest import Emulated
from tests.until import PATIENCE_S, until

if not hasattr(os, "openpty"):
    pytest.skip("the board is on a pseudo-terminal", allow_module_level=True)
if INTERPRETED:
    pytest.skip("an interpreted tick takes longer than a period", allow_module_level=True)

WITHIN_S = 0.02
"""Time within which the force ends if the application ends or is stopped, see `hapscene.device.safety` [s]."""


def slack_s() -> float:
    """Return the additional time for a loaded machine, on which the emulated board gets the processor late [s]."""
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


class Rig:
    """An emulated board, and an application that exerts a force with it."""

    def __init__(self, folder: Path) -> None:
        self.board = Emulated("haply2diy", folder)
        (folder / "application.py").write_text(APPLICATION)
        command = [sys.executable, str(folder / "application.py"), self.board.place, str(folder / "logs")]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.application = subprocess.Popen(command, **pipes, process_group=0)
        said = self.application.stdout.readline().strip()  # type: ignore[union-attr]
        assert said, self.application.communicate()[1]
        self.servo_pid, self.watchdog_pid = map(int, said.split())
        self.await_torque(lambda now: now > 0.99 * self.full())

    def full(self) -> float:
        """Return the largest torque so far, which is that of the full force; 1 before any [N·m]."""
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

    def force_ended_after(self, since_ns: int) -> float:
        """Wait until the torque is 0; return the time from `since_ns` to the last other torque [s]."""
        self.await_torque(lambda now: now == 0.0)
        return max(max(row[0] - since_ns, 0) for row in self.torques() if row[1] != 0.0 or row[2] != 0.0) * 1e-9

    def end(self) -> None:
        for stop in (lambda: os.kill(self.servo_pid, signal.SIGKILL), self.application.kill):
            with contextlib.suppress(ProcessLookupError):
                stop()
        self.application.communicate()
        self.board.end()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path)
    yield made
    made.end()


def log_in(folder: Path) -> SessionLog:
    """Wait for the session log in a folder and load it."""
    return SessionLog.load(until(lambda: [place for place in folder.glob("*") if not place.name.startswith(".")])[0])


def test_application_is_stopped_continued_and_killed(rig: Rig, tmp_path: Path) -> None:
    at_ns = time.monotonic_ns()
    os.kill(rig.application.pid, signal.SIGSTOP)
    assert rig.force_ended_after(at_ns) < WITHIN_S + slack_s()
    os.kill(rig.application.pid, signal.SIGCONT)
    rig.await_torque(lambda now: now > 0.99 * rig.full())
    at_ns = time.monotonic_ns()
    os.kill(rig.application.pid, signal.SIGKILL)
    assert rig.force_ended_after(at_ns) < WITHIN_S + slack_s()
    log = log_in(tmp_path / "logs")
    assert log.reason == "the application has ended" and log.rows.shape[1] > 1000
    assert len(log.replay().unlike) == 0


def test_suspend_and_resume_of_the_machine(rig: Rig) -> None:
    asleep = rig.application.pid, rig.servo_pid, rig.watchdog_pid
    for pid in asleep:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(0.5)
    at_ns = time.monotonic_ns()
    for pid in asleep:
        os.kill(pid, signal.SIGCONT)
    rig.await_torque(lambda now: now > 0.99 * rig.full())  # no process was killed
    after = [abs(row[1]) for row in rig.torques() if row[0] > at_ns + 5e7]
    assert min(after) == 0.0 and max(np.diff(after)) < 0.05 * rig.full()  # ramps up without a jump


def test_blocked_board_is_reported(rig: Rig) -> None:
    os.kill(rig.board.process.pid, signal.SIGSTOP)  # its pipe fills
    _, errors = rig.application.communicate(timeout=PATIENCE_S)
    assert f"haply2diy: {rig.board.place}" in errors
    os.kill(rig.board.process.pid, signal.SIGCONT)
    rig.await_torque(lambda now: now == 0.0)


def test_unplugged_device_is_reported_and_logged(rig: Rig, tmp_path: Path) -> None:
    rig.board.set(gone=1)
    _, errors = rig.application.communicate(timeout=PATIENCE_S)
    assert f"haply2diy: {rig.board.place}" in errors and "reconnect it" in errors
    log = log_in(tmp_path / "logs")
    assert "haply2diy" in log.reason and len(log.replay().unlike) == 0


@pytest.mark.parametrize("key", [signal.SIGTSTP, signal.SIGQUIT], ids=["ctrl-z", "ctrl-backslash"])
def test_terminal_signals_remove_the_force(rig: Rig, key: signal.Signals) -> None:
    at_ns = time.monotonic_ns()
    os.killpg(rig.application.pid, key)
    assert rig.force_ended_after(at_ns) < WITHIN_S + slack_s()
