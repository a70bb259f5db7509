"""A handle that plays live in its own process: fed by a real channel, on a board at a pseudo-terminal."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from hapscene.handle.force_source import SimulatedSource
from hapscene.handle.live_process import LiveHandle
from hapscene.handle.plant import Plant
from hapscene.loop.shared_memory import Channel
from tests.handle.serial_board import Peer, serve
from tests.handle.test_live_process import channel, where
from tests.until import until

__all__ = ["channel"]  # fixtures

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")


LENGTH, BLOCK = 4000, 10


APPLICATION = """
import os, sys, time
from hapscene.handle.live_process import LiveHandle
if __name__ == "__main__":
    where = {"length": int(sys.argv[1]), "block": int(sys.argv[2]), "name": sys.argv[3]}
    handle = LiveHandle(where, 1e4, 0, os.getppid(), "serial", {"port": sys.argv[4]})
    print(handle._process.pid, flush=True)
    time.sleep(600.0)
"""


class Board:
    """A simulated board at a port; what force it put out, and when."""

    def __init__(self) -> None:
        import tty

        self.ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self.ours, False)
        self.port = os.ttyname(self._theirs)
        peer = Peer(SimulatedSource(Plant(), 5000.0))
        peer.give(1)  # compiled before anybody waits
        self.force: list[tuple[float, float]] = []
        step = peer._next

        def note() -> tuple[int, int, int]:
            row = step()
            self.force.append((time.monotonic(), 1e-4 * row[0]))
            return row

        peer._next = note  # type: ignore[method-assign]
        self._over = threading.Event()
        self._thread = threading.Thread(target=serve, args=(peer, self.ours, self._over.is_set), daemon=True)
        self._thread.start()

    def loud_since(self, t_s: float) -> float:
        """When it last put out force after that time [s after it]; 0 where it did not."""
        return max((at - t_s for at, force in self.force if at > t_s and abs(force) > 1e-3), default=0.0)

    def loud_count(self) -> int:
        """Samples of force so far: the board's own clock, which counts on a busy machine, too."""
        return sum(abs(force) > 1e-3 for _, force in list(self.force))

    def wait_for_force(self) -> None:
        until(lambda: self.force and abs(self.force[-1][1]) > 0.1, 300.0)  # the first time it compiles

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        os.close(self.ours)
        os.close(self._theirs)


class Ticks:
    """A servo's ticks, 1,000 a second, of a sine of 100 Hz."""

    def __init__(self, channel: Channel) -> None:
        self._channel, self._over = channel, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        began_s, done = time.monotonic(), 0
        while not self._over.is_set():
            for done in range(done + 1, int(1e3 * (time.monotonic() - began_s)) + 1):  # noqa: B020
                t_s = np.arange(BLOCK * (done - 1), BLOCK * done) / 1e4
                self._channel.a_m_s2[0, (done - 1) % LENGTH] = 5.0 * np.sin(2.0 * np.pi * 100.0 * t_s)
                self._channel.channel[0].done = done
            time.sleep(1e-3)

    def stop(self) -> None:
        self._over.set()
        self._thread.join()


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board()
    yield board
    board.close()


def test_ticks_become_force_and_silence_when_they_stop(board: Board, channel: Channel) -> None:
    ticks = Ticks(channel)
    with closing(LiveHandle(where(channel), 1e4, 0, os.getpid(), "serial", {"port": board.port})) as handle:
        board.wait_for_force()
        until(lambda: board.loud_count() > 10_000)
        report = handle.update_report()
        ticks.stop()
        stopped = board.loud_count()
        until(lambda: handle.update_report()["gaps"] >= 1 and abs(board.force[-1][1]) < 1e-3)
        assert board.loud_count() - stopped < 0.1 * 5000.0
    force = np.array([force for _, force in board.force])
    strong = force[np.abs(force) > 0.01][-8000:-1500]
    mass_kg = np.abs(Plant().response(100.0)) ** -1
    assert np.abs(strong).max() == pytest.approx(5.0 * mass_kg, rel=0.05)
    assert 0.01 < report["latency_s"] < 0.06 + 0.1 * (os.getloadavg()[0] > 1.0)  # a busy machine's ticks come in bursts
    assert not handle._process.is_alive()


def test_killed_application_stops_the_sound_and_leaves_no_process(
    board: Board, channel: Channel, tmp_path: Path, end_in_time: Callable[["subprocess.Popen[str]"], None]
) -> None:
    (tmp_path / "application.py").write_text(APPLICATION)
    ticks = Ticks(channel)  # of a servo that lives on for a while
    words = [str(tmp_path / "application.py"), str(LENGTH), str(BLOCK), channel.memory.name, board.port]
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True) as application:
        end_in_time(application)
        assert application.stdout is not None
        pid = int(application.stdout.readline())
        board.wait_for_force()
        application.send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        time.sleep(0.5)
        assert 0.0 < board.loud_since(killed_s) < 0.2
    until(lambda: not Path(f"/proc/{pid}").exists() or "Z" in Path(f"/proc/{pid}/stat").read_text().split()[2])
    ticks.stop()
