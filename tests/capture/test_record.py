"""Recording over a pseudo-terminal, with a probe at the other end that a thread or a process of its own plays."""

import errno
import itertools
import os
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.record import Made, Meter, Watcher, record
from hapscene.capture.record_file import load_record
from hapscene.cli import main
from hapscene.errors import CaptureError
from hapscene.wire.port import Port
from hapscene.wire.protocol import Column, Count, Header, Run, header_line, sample_line

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system"),
    pytest.mark.nightly,
]

LIMIT_S = 120.0
"""Longest that a test waits for another process [s]."""

COLUMNS = (Column("acceleration", "m/s2", 0.001), Column("force", "N", 0.01))
HEADER = header_line(Header(2000.0, COLUMNS))


def row(n: int) -> tuple[int, int]:
    return (n * 37) % 4001 - 2000, n % 300


def lines(start: int, stop: int) -> list[bytes]:
    return [sample_line(n, row(n)) for n in range(start, stop)]


def truth(n: np.ndarray) -> np.ndarray:
    return np.stack([((n * 37) % 4001 - 2000) * 0.001, (n % 300) * 0.01])


class Probe:
    """The other end of a port, which a thread writes to."""

    def __init__(self) -> None:
        import tty

        self.ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self.ours, False)
        self.port = os.ttyname(self._theirs)
        self._thread: threading.Thread | None = None
        self._opened, self._over = threading.Event(), threading.Event()

    def record(
        self,
        path: Path,
        stopped: Callable[[], bool] = lambda: False,
        watch: Sequence[Watcher] = (),
        **more: float,
    ) -> Made:
        """Records here; the thread writes once the port is open, for opening it throws away what came before."""

        def asked() -> bool:
            self._opened.set()
            return stopped()

        return record(self.port, path, stopped=asked, watch=watch, **more)

    def play(self, parts: "Iterator[bytes] | list[bytes]", at_once: bool = False) -> None:
        """Writes the parts from a thread, once the port is open."""

        def write() -> None:
            if not at_once:
                self._opened.wait(LIMIT_S)
            try:
                for part in parts:
                    while part:
                        try:
                            part = part[os.write(self.ours, part) :]
                        except BlockingIOError:  # nobody reads, now or ever again
                            if self._over.wait(1e-3):
                                return
            except OSError as error:
                assert error.errno in (errno.EIO, errno.EBADF)

        self._thread = threading.Thread(target=write, daemon=True)
        self._thread.start()

    @property
    def writing(self) -> bool:
        """Whether not all parts are written yet."""
        return self._thread is not None and self._thread.is_alive()

    def unplug(self) -> None:
        os.close(self.ours)
        self.ours = -1

    def close(self) -> None:
        self._opened.set()
        self._over.set()
        if self._thread is not None:
            self._thread.join(LIMIT_S)
        os.close(self._theirs)
        if self.ours >= 0:
            os.close(self.ours)


@pytest.fixture
def probe() -> Iterator[Probe]:
    probe = Probe()
    yield probe
    probe.close()


def recorded(probe: Probe, parts: list[bytes], path: Path, seconds: float) -> Made:
    """Records `seconds` of what the parts give."""
    probe.play([HEADER, *parts])
    return probe.record(path, duration_s=seconds)


class Onlooker:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.heads: list[Header] = []
        self.runs: list[Run] = []
        self.positions: list[int] = []
        self.ends: list[str] = []

    def begin(self, header: Header) -> None:
        self.heads.append(header)

    def take(self, run: Run) -> None:
        assert self.heads and not self.ends
        self.runs.append(run)

    def tell(self, count: Count, position: int) -> None:
        assert self.heads and not self.ends
        self.positions.append(position)

    def end(self, why: str) -> None:
        self.ends.append(why)


def test_who_watches_sees_what_is_written(probe: Probe, tmp_path: Path) -> None:
    first, second = Onlooker(), Onlooker()
    told = threading.Event()
    first.tell = lambda count, position: told.set()  # type: ignore[method-assign]

    def parts() -> Iterator[bytes]:
        yield from (HEADER, *lines(0, 1000))
        told.wait(LIMIT_S)
        yield from lines(1010, 1500)

    probe.play(parts())
    probe.record(tmp_path / "a.hsrec", watch=(first, second), duration_s=0.7)
    kept = load_record(tmp_path / "a.hsrec")
    for onlooker in (first, second):
        assert [head.rate_Hz for head in onlooker.heads] == [2000.0] and onlooker.ends == [kept.ended]
        n = np.concatenate([run.first + np.arange(len(run.counts)) for run in onlooker.runs])
        counts = np.concatenate([run.counts for run in onlooker.runs])
        np.testing.assert_array_equal(n, [*range(1000), *range(1010, 1400)])  # nothing beyond the duration
        np.testing.assert_array_equal(counts[:, 0] * 0.001, kept.streams["acceleration"][n])
    assert second.positions == sorted(second.positions) and second.positions[-1] <= 1400


def test_clean(probe: Probe, tmp_path: Path) -> None:
    made = recorded(probe, lines(0, 3000), tmp_path / "a.hsrec", 1.25)
    assert (made.length, made.ended, made.count.dropped) == (2500, "the duration was reached", 0)
    kept = load_record(tmp_path / "a.hsrec")
    assert kept.rate_Hz == 2000.0 and kept.ended == made.ended
    assert kept.units == {"acceleration": "m/s2", "force": "N"} and not kept.missing.any()
    np.testing.assert_allclose(list(kept.streams.values()), truth(np.arange(2500)), atol=1e-12)


def test_dropped_torn_and_garbage(probe: Probe, tmp_path: Path) -> None:
    parts = lines(0, 3000)
    rng = np.random.default_rng(0)
    spoilt = rng.choice(np.arange(1, 2499), 90, replace=False)
    dropped, torn, joined = spoilt[:30], spoilt[30:60], spoilt[60:90]
    for n in dropped:
        parts[n] = b""
    for n in torn:
        parts[n] = parts[n][:4] + b"\n"
    for n in joined:
        parts[n] = b"\xfe\x00?" + parts[n]
    parts[1000] = HEADER + parts[1000]
    made = recorded(probe, parts, tmp_path / "a.hsrec", 1.25)
    assert (made.count.dropped, made.count.torn, made.count.garbage) == (90, 30, 30)
    kept = load_record(tmp_path / "a.hsrec")
    assert set(np.flatnonzero(kept.missing)) == set(spoilt)
    there = np.flatnonzero(~kept.missing)
    np.testing.assert_allclose(np.stack(list(kept.streams.values()))[:, there], truth(there), atol=1e-12)


def test_npz_holds_the_same_and_the_record_beside_it_is_gone(probe: Probe, tmp_path: Path) -> None:
    parts = lines(0, 600)
    parts[5] = b""
    made = recorded(probe, parts, tmp_path / "a.npz", 0.25)
    assert made.path == tmp_path / "a.npz" and [f.name for f in tmp_path.iterdir()] == ["a.npz"]
    with np.load(tmp_path / "a.npz", allow_pickle=False) as kept:
        assert kept["rate_Hz"] == 2000.0 and set(kept["units"]) == {"acceleration=m/s2", "force=N"}
        assert np.flatnonzero(np.isnan(kept["force"])).tolist() == [5]
        there = np.delete(np.arange(500), 5)
        np.testing.assert_allclose(kept["acceleration"][there], truth(there)[0], atol=1e-12)


def test_a_slow_probe_ends_when_it_is_stopped(probe: Probe, tmp_path: Path) -> None:
    """Bytes that trickle in, a few at a time; the recording is stopped from outside after the last."""
    text = HEADER + b"".join(lines(0, 40))
    gate = threading.Semaphore(0)
    sent = threading.Event()

    def trickle() -> Iterator[bytes]:
        for i in range(0, len(text), 9):
            gate.acquire()
            yield text[i : i + 9]
        sent.set()

    def stopped() -> bool:
        gate.release()
        return sent.is_set() and next(after) > 10

    after = itertools.count()
    probe.play(trickle())
    made = probe.record(tmp_path / "a.hsrec", stopped)
    assert made.ended == "stopped" and made.count.received == 40
    assert load_record(tmp_path / "a.hsrec").ended == "stopped"


def test_an_unplugged_probe_ends_the_record_properly(probe: Probe, tmp_path: Path) -> None:
    calls = itertools.count()

    def stopped() -> bool:
        if next(calls) == 20:
            probe.unplug()
        return False

    probe.play([HEADER, *lines(0, 400)])
    made = probe.record(tmp_path / "a.hsrec", stopped)
    assert made.ended.startswith("the probe went away: ")
    kept = load_record(tmp_path / "a.hsrec")
    assert kept.ended == made.ended and len(kept.missing) == made.length > 0


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([], r"silent for 0\.3 s.*#hapscene-probe 1"),
        ([b"\xf3\x80\n" * 50], r"150 bytes in 0\.3 s at 921600 baud, but no line.*check --baud"),
        ([HEADER.replace(b"probe 1", b"probe 7")], "but no line"),  # its checksum does not match
        ([b"#hapscene-probe 2 x*A673\n"], "speaks version 2 of the protocol, read here is 1"),
    ],
)
def test_what_is_no_probe_is_told(probe: Probe, tmp_path: Path, parts: list[bytes], message: str) -> None:
    probe.play(parts)
    with pytest.raises(CaptureError, match=f"^{probe.port}: .*{message}"):
        probe.record(tmp_path / "a.hsrec", silence_s=0.3)
    assert not list(tmp_path.iterdir())


def test_a_header_without_samples_leaves_no_file(probe: Probe, tmp_path: Path) -> None:
    probe.play([HEADER])
    calls = itertools.count()
    with pytest.raises(CaptureError, match="sent no samples"):
        probe.record(tmp_path / "a.npz", lambda: next(calls) > 15)
    assert not list(tmp_path.iterdir())


def test_another_header_in_the_middle_ends_it(probe: Probe, tmp_path: Path) -> None:
    probe.play([HEADER, *lines(0, 50)])
    calls = itertools.count()

    def stopped() -> bool:
        if next(calls) >= 3 and not probe.writing and not told:
            told.append(os.write(probe.ours, header_line(Header(50.0, COLUMNS))))
        return False

    told: list[int] = []
    made = probe.record(tmp_path / "a.hsrec", stopped)
    assert "announced another rate" in made.ended and made.count.received == 50


@pytest.mark.parametrize(
    ("out", "message"),
    [("a.wav", r"written as \.hsrec or \.npz"), ("there.hsrec", "never replaced"), ("there.npz", "never replaced")],
)
def test_no_recording_is_replaced(tmp_path: Path, out: str, message: str) -> None:
    (tmp_path / "there.hsrec").write_bytes(b"dear")
    with pytest.raises(CaptureError, match=message):
        record("no port", tmp_path / out)
    assert (tmp_path / "there.hsrec").read_bytes() == b"dear"


def test_a_port_that_is_not_there_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["capture", "record", "--port", "/dev/nothing", "-o", str(tmp_path / "a.hsrec")]) == 2
    told = capsys.readouterr().err
    assert told.startswith("hapscene: /dev/nothing: the port cannot be opened: no such file") and told.count("\n") == 1


class Terminal:
    """A stream that says it is a terminal."""

    def __init__(self, live: bool) -> None:
        self.live, self.text = live, ""

    def isatty(self) -> bool:
        return self.live

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


@pytest.mark.parametrize("live", [True, False])
def test_meter(live: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    stream = Terminal(live)
    meter = Meter(COLUMNS, 1000.0, stream)
    for k in range(41):
        meter.take(np.array([[9810 + 1000, 0], [9810 - 1000, 200]]))
        meter.show(62.5 * k, Count(dropped=3), k / 16)
    meter.close()
    if live:
        shown = stream.text.split("\r")[1:]
        assert 19 <= len(shown) <= 21 and all(len(line) <= 59 + len("\x1b[K\n") for line in shown)
        assert stream.text.endswith("\x1b[K\n")
    else:
        shown = stream.text.splitlines()
        assert len(shown) == 2 and shown[0].endswith("rms/peak:  acceleration 1/1 m/s2  force 1/1 N")
    assert re.match(r" +(0\.1|1\.0) s  dropped 3, torn 0, garbage 0  rms", shown[0])
    meter.line(0, Count())
    assert "silent" in meter.line(0, Count())


def test_a_port_that_another_has_open_is_called_so(probe: Probe, tmp_path: Path) -> None:
    with closing(Port(probe.port, 115_200)), pytest.raises(CaptureError, match="another program has it open"):
        record(probe.port, tmp_path / "a.hsrec")
