"""How long after a fault a device holds torque: `hapscene play` drives an emulated 2DIY, whose own clock decides.

The board holds its last torque indefinitely. It is pressed against a wall through the arms' angles, then a process or
the board fails. Run: python -m tests.nightly.loop.time_to_zero [BUSY [REPEATS]], with BUSY processes that load the
processor; it prints a table.
"""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
import trimesh
from scipy.optimize import brentq

import hapscene
from hapscene_plugins.devices.haply2diy import HARDWARE, MIDDLE_M, forward
from tests.nightly.plugins.devices.conftest import Emulated
from tests.until import until

FRONT_M: Final = -0.035
"""Place of the wall's front in D, along y [m]."""

PRESSED_M: Final = -0.030
"""Place of the tool that presses [m]: 5 mm deep."""

HELD_N_m: Final = 0.05
"""Torque from which the wall counts as pressed [N·m]."""


def arm_angle_deg(y_m: float) -> float:
    """The first arm's angle [°] at which the tool is at (0, y): the second arm mirrors it."""

    def off_m(angle: float) -> float:
        p = forward((math.radians(angle), math.radians(180.0 - angle)), HARDWARE["v3"].base_m)
        assert p is not None
        return MIDDLE_M - p[1] - y_m

    return float(brentq(off_m, 95.0, 165.0))


class Play:
    """`hapscene play` with the board, pressed against a wall."""

    def __init__(self, folder: Path) -> None:
        wall = trimesh.creation.box((0.1, 0.1, 0.1))
        wall.apply_translation((0.0, FRONT_M + 0.05, 0.0))
        scene = hapscene.Scene()
        scene.add(wall, name="wall", unit="m")
        scene.save(folder / "wall.scene.json")
        self.board = Emulated("haply2diy", folder)
        self._log, self._rows = self.board.log.open(), []
        self.board.set(**self.angles(FRONT_M - 0.005))
        words = ["play", str(folder / "wall.scene.json"), "--device", "haply2diy", "--at", "0", "0", "0"]
        words += ["--option", f"port={self.board.place},homed=yes", "--log", str(folder / "logs")]
        command = [sys.executable, "-m", "hapscene", *words]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            until(lambda: len(self.torques()) > 3500)  # the force rises within two seconds
            for y_m in np.linspace(FRONT_M - 0.004, PRESSED_M, 40):
                self.board.set(**self.angles(y_m))
                time.sleep(0.01)
            until(lambda: abs(self.torques()[-1][1]) > HELD_N_m)
        except AssertionError:
            self.process.kill()
            raise AssertionError(f"the wall is not pressed: {self.process.communicate()[0]!r}") from None
        self.servo_pid, self.watchdog_pid = self._children()[:2]

    @staticmethod
    def angles(y_m: float) -> dict[str, float]:
        first = arm_angle_deg(y_m)
        return {"first": first, "second": 180.0 - first}

    def _children(self) -> list[int]:
        """The processes that multiprocessing started, the oldest first: the servo, its watchdog."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return sorted(int(pid) for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes())

    def torques(self) -> list[list[float]]:
        """Time [ns] and torques [N·m] of all commands."""
        for line in self._log:
            numbers = [float(part) for part in line.split()]
            if len(numbers) == 3:
                self._rows.append(numbers)
        return self._rows

    def time_to_zero_ms(self, since_ns: int) -> float:
        """Time from a moment to the first command of zero that no other follows within 0.4 s [ms]; infinite: never."""
        time.sleep(0.6)
        after = [row for row in self.torques() if row[0] > since_ns]
        end_ns = since_ns + 400_000_000
        held = [row[0] for row in after if (row[1] != 0.0 or row[2] != 0.0) and row[0] < end_ns]
        zeros = [row[0] for row in after if row[1] == row[2] == 0.0 and row[0] > max(held, default=0)]
        return (zeros[0] - since_ns) * 1e-6 if zeros else float("inf")

    def end(self) -> None:
        for pid in (self.servo_pid, self.watchdog_pid, self.process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.communicate()
        self._log.close()
        self.board.end()


def killed(who: str, by: signal.Signals) -> Callable[[Play], None]:
    """A signal to one of the processes, or to the group."""

    def act(play: Play) -> None:
        if who == "group":
            os.killpg(play.process.pid, by)
        else:
            os.kill({"application": play.process.pid, "servo": play.servo_pid}[who], by)

    return act


def board_fault(number: int) -> Callable[[Play], None]:
    return lambda play: play.board.set(fault=number)


EVENTS: Final = {
    "application: SIGKILL": killed("application", signal.SIGKILL),
    "application: SIGSTOP": killed("application", signal.SIGSTOP),
    "application: SIGINT": killed("application", signal.SIGINT),
    "application: SIGTERM": killed("application", signal.SIGTERM),
    "servo: SIGKILL": killed("servo", signal.SIGKILL),
    "servo: SIGSEGV": killed("servo", signal.SIGSEGV),
    "servo: SIGSTOP": killed("servo", signal.SIGSTOP),
    "process group: SIGKILL": killed("group", signal.SIGKILL),
    "board: no answers": board_fault(1),
    "board: truncated answers": board_fault(2),
    "board: NaN": board_fault(3),
    "board: random bytes": board_fault(4),
    "board: position jumps": board_fault(5),
}
"""What happens, by name."""


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Processes that compute without end."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def measure(event: str, folder: Path) -> float:
    """Time to zero torque after an event [ms]."""
    play = Play(folder)
    try:
        at_ns = time.monotonic_ns()
        EVENTS[event](play)
        return play.time_to_zero_ms(at_ns)
    finally:
        play.end()


def main(busy: int = 0, repeats: int = 3) -> None:
    """Print the table."""
    table: dict[str, list[float]] = {}
    with busy_processes(busy):
        for event in EVENTS:
            for _ in range(repeats):
                with tempfile.TemporaryDirectory() as folder:
                    table.setdefault(event, []).append(round(measure(event, Path(folder)), 1))
            print(f"{event:28} {table[event]}", flush=True)
    print(json.dumps({"load": os.getloadavg()[0], "busy": busy, "ms": table}))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
