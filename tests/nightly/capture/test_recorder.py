"""Recording over a pseudo-terminal; a thread or a separate process simulates the probe at the other end."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.io.hsrec import load_record
from hapscene.interrupt import ENDS
from tests.capture.test_recorder import HEADER, lines
from tests.until import until

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")


LIMIT_S = 120.0
"""Longest that a test waits for another process [s]."""


class Probe:
    """The probe's end of a port; a thread writes to it."""

    def __init__(self) -> None:
        import tty

        self.ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self.ours, False)
        self.port = os.ttyname(self._theirs)
        self._thread: threading.Thread | None = None
        self._over = threading.Event()

    def play(self, parts: Iterator[bytes]) -> None:
        """Writes the bytes from a thread."""

        def write() -> None:
            try:
                for part in parts:
                    while part:
                        try:
                            part = part[os.write(self.ours, part) :]
                        except BlockingIOError:  # the reader has stopped
                            if self._over.wait(1e-3):
                                return
            except OSError as error:
                assert error.errno in (errno.EIO, errno.EBADF)

        self._thread = threading.Thread(target=write, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join(LIMIT_S)
        os.close(self._theirs)
        os.close(self.ours)


@pytest.fixture
def probe() -> Iterator[Probe]:
    probe = Probe()
    yield probe
    probe.close()


@contextmanager
def process(*words: str, **more: object) -> Iterator[subprocess.Popen[str]]:
    """A process that is killed after `LIMIT_S`, so that a test never waits for its output without end."""
    child = subprocess.Popen([sys.executable, *words], text=True, **more)
    watchdog = threading.Timer(LIMIT_S, child.kill)
    watchdog.start()
    try:
        yield child
    finally:
        watchdog.cancel()
        child.kill()
        child.wait(LIMIT_S)
        for stream in (child.stdout, child.stderr):
            if stream is not None:
                stream.close()


def paced(stop: threading.Event, rate_Hz: float = 2000.0) -> Iterator[bytes]:
    """Samples at the speed of the clock, and a header each second."""
    start, sent = time.monotonic(), 0
    while not stop.wait(0.01):
        due = int((time.monotonic() - start) * rate_Hz)
        head = HEADER if sent // 2000 < due // 2000 or sent == 0 else b""
        yield head + b"".join(lines(sent, due))
        sent = due


def test_a_killed_recording_is_readable_up_to_its_last_second(probe: Probe, tmp_path: Path) -> None:
    """A process is killed with SIGKILL while it records: all but the last second is in the file."""
    path = tmp_path / "a.hsrec"
    stop = threading.Event()
    words = ("-m", "hapscene", "capture", "record", "--port", probe.port, "-o", str(path))
    with process(*words, stdout=subprocess.PIPE) as child:
        probe.play(paced(stop))
        assert child.stdout is not None
        assert "recording acceleration [m/s2], force [N] at 2000 Hz" in child.stdout.readline()
        shown = [child.stdout.readline() for _ in range(3)]  # a line of the meter each second
        child.send_signal(signal.SIGKILL)
        child.wait(LIMIT_S)
    stop.set()
    seconds = float(shown[-1].split()[0])
    assert seconds > 2.0 and "rms/peak:  acceleration" in shown[-1]
    kept = load_record(path)
    assert kept.ended is None
    assert len(kept.missing) / 2000.0 > seconds - 1.1
    there = np.flatnonzero(~kept.missing)
    first = np.rint(kept.streams["force"][0] / 0.01)
    assert first == pytest.approx(kept.streams["force"][0] / 0.01) and len(there) > 0.9 * len(kept.missing)


@pytest.mark.parametrize("kind", [signal.SIGINT, *ENDS])
def test_ctrl_c_ends_the_record_and_names_the_file(probe: Probe, tmp_path: Path, kind: signal.Signals) -> None:
    path = tmp_path / "a.hsrec"
    stop = threading.Event()
    words = ("-m", "hapscene", "capture", "record", "--port", probe.port, "-o", str(path))
    with process(*words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        probe.play(paced(stop))
        assert child.stdout is not None and child.stderr is not None
        child.stdout.readline()
        until(lambda: path.stat().st_size > 5000)
        child.send_signal(kind)
        said, complained = child.communicate(timeout=120.0)
        assert child.returncode == 0 and complained == ""
    stop.set()
    assert "torn 0, garbage 0: stopped" in said and f"made:\n  {path}  (" in said
    assert load_record(path).ended == "stopped"
