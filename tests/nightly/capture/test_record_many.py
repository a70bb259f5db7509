"""Several probes at once: simulated ones on pseudo-terminals, in processes of their own, recorded by the command."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.record_file import load_record
from hapscene.capture.record_many import record_many
from hapscene.capture.record_simulator import strokes
from hapscene.cli import main
from hapscene.errors import CaptureError
from tests.until import until

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")

LIMIT_S = 120.0
"""Longest that a test waits for another process [s]."""

MINUTES = float(os.environ.get("SOAK_MINUTES", "10"))


@contextmanager
def process(*words: str, limit_s: float = LIMIT_S, **more: object) -> Iterator[subprocess.Popen[str]]:
    """A process that is killed after a while, which ends whatever a test reads from it."""
    child = subprocess.Popen([sys.executable, "-m", *words], text=True, stdout=subprocess.PIPE, **more)
    watchdog = threading.Timer(limit_s, child.kill)
    watchdog.start()
    try:
        yield child
    finally:
        watchdog.cancel()
        child.kill()
        child.wait(LIMIT_S)
        assert child.stdout is not None
        child.stdout.close()


def simulated(stack: ExitStack, count: int, *more: str, limit_s: float = LIMIT_S) -> tuple[list[str], list[int]]:
    """The ports of so many simulated probes, and the numbers of their processes; seeds go up from 1."""
    module = "hapscene.capture.record_simulator"
    probes = [
        stack.enter_context(process(module, "--seed", str(seed), *more, limit_s=limit_s))
        for seed in range(1, count + 1)
    ]
    return [probe.stdout.readline().strip() for probe in probes if probe.stdout], [probe.pid for probe in probes]


def ports_of(ports: list[str]) -> list[str]:
    return [word for port in ports for word in ("--port", port)]


def begun(path: Path) -> bool:
    return path.exists() and path.stat().st_size > 20_000


def assert_is_of(path: Path, seed: int, rate_Hz: float) -> None:
    """Every sample of the record is the simulator's, in its place, from the first on."""
    kept = load_record(path)
    assert not kept.missing.any()
    rows = np.stack(list(kept.streams.values()), axis=1) / [1e-3, 1e-3, 1e-3, 1e-4]
    first, start = np.rint(rows[:50]).astype(int), None
    table: list[np.ndarray] = []
    count = 0
    for block in strokes(rate_Hz, seed):  # what was sent before the port was open is not there
        table.append(block)
        count += len(block)
        if start is None and len(table) > 6:
            long = np.concatenate(table)
            found = [
                i for i in range(len(long) - 50) if (long[i] == first[0]).all() and (long[i : i + 50] == first).all()
            ]
            start = found[0] if found else None
            assert len(long) < 20 * rate_Hz, "not a record of this probe"
            table = [long]
        if start is not None and count >= start + len(rows):
            break
    assert start is not None
    np.testing.assert_array_equal(np.rint(rows), np.concatenate(table)[start : start + len(rows)])


def test_two_sources_each_whole_and_their_clock_is_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as stack:
        ports, _ = simulated(stack, 2)
        assert main(["capture", "record", *ports_of(ports), "--seconds", "2.5", "-o", str(tmp_path / "a.hsrec")]) == 0
    said = capsys.readouterr().out
    one, two = (load_record(tmp_path / f"a-{number}.hsrec") for number in (1, 2))
    assert one.clock == two.clock != "" and re.search(r"\n1: .* s, 0 lost, .* m/s2  \|  2: ", said)
    for kept in (one, two):
        assert len(kept.clock_s) >= 2 and np.all(np.diff(kept.clock_s, axis=0) > 0.0)
        late_s = kept.clock_s[:, 1] - kept.clock_s[:, 0] / kept.rate_Hz
        assert np.ptp(late_s) < 1.0  # the simulator keeps the computer's time
    for number in (1, 2):
        assert_is_of(tmp_path / f"a-{number}.hsrec", number, 3200.0)


def test_a_source_that_dies_is_told_and_the_other_goes_on_until_ctrl_c(tmp_path: Path) -> None:
    with ExitStack() as stack:
        ports, pids = simulated(stack, 2)
        words = (
            "hapscene.cli",
            "capture",
            "record",
            *ports_of([*ports, "/dev/nothing"]),
            "-o",
            str(tmp_path / "a.hsrec"),
        )
        child = stack.enter_context(process(*words, stderr=subprocess.PIPE))
        assert child.stdout is not None
        until(lambda: all(begun(tmp_path / f"a-{number}.hsrec") for number in (1, 2)))
        os.kill(pids[1], signal.SIGKILL)
        lines = []
        while not lines or "the probe went away" not in lines[-1]:
            lines.append(child.stdout.readline())
            assert lines[-1], "it ended with the source"
        size_B = (tmp_path / "a-1.hsrec").stat().st_size
        until(lambda: (tmp_path / "a-1.hsrec").stat().st_size > size_B + 20_000)
        child.send_signal(signal.SIGINT)
        said, complained = child.communicate(timeout=LIMIT_S)
        assert child.returncode == 1 and complained == ""
    assert any(line.startswith("/dev/nothing: the port cannot be opened") for line in lines)
    assert ": stopped\n" in said and f"made:\n  {tmp_path}/a-1.hsrec" in said
    assert load_record(tmp_path / "a-1.hsrec").ended == "stopped"
    assert str(load_record(tmp_path / "a-2.hsrec").ended).startswith("the probe went away")
    assert_is_of(tmp_path / "a-1.hsrec", 1, 3200.0)


def test_processes_end_with_the_killed_one_that_began_them_and_their_records_are_readable(tmp_path: Path) -> None:
    with ExitStack() as stack:
        ports, _ = simulated(stack, 2)
        words = ("hapscene.cli", "capture", "record", *ports_of(ports), "-o", str(tmp_path / "a.hsrec"))
        child = stack.enter_context(process(*words))
        until(lambda: all(begun(tmp_path / f"a-{number}.hsrec") for number in (1, 2)))
        child.kill()
        assert child.stdout is not None
        child.stdout.read()  # its end comes when the last process that holds it has ended
    for number in (1, 2):
        assert load_record(tmp_path / f"a-{number}.hsrec").ended is None
        assert_is_of(tmp_path / f"a-{number}.hsrec", number, 3200.0)


def test_ports_stand_once_and_nothing_is_replaced(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="stands twice"):
        record_many(["a", "a"], tmp_path / "t.hsrec")
    (tmp_path / "t-2.hsrec").write_bytes(b"dear")
    with pytest.raises(CaptureError, match=r"t-2\.hsrec: is there already"):
        record_many(["a", "b"], tmp_path / "t.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["t-2.hsrec"]


@pytest.mark.soak
def test_three_sources_lose_no_sample(tmp_path: Path) -> None:
    limit_s = 60.0 * MINUTES + 300.0
    with ExitStack() as stack:
        ports, _ = simulated(stack, 3, limit_s=limit_s)
        words = ["capture", "record", *ports_of(ports), "--seconds", str(60.0 * MINUTES), "-o", "a.hsrec"]
        child = stack.enter_context(process("hapscene.cli", *words, limit_s=limit_s, cwd=tmp_path))
        said, _ = child.communicate(timeout=limit_s)
        print("\n".join(said.splitlines()[-8:]), f"load {os.getloadavg()}")
        assert child.returncode == 0
    for number in (1, 2, 3):
        assert len(load_record(tmp_path / f"a-{number}.hsrec").missing) == round(60.0 * MINUTES * 3200.0)
        assert_is_of(tmp_path / f"a-{number}.hsrec", number, 3200.0)
