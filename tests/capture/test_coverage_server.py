"""The page beside a recording: nothing is lost for it, what it shows can be read, and it can end it."""

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")

from hapscene.capture.coverage import Coverage, Wanted
from hapscene.capture.coverage_server import BEAT_S, CoveragePage, CoverageProcess, LiveCoverage, blocks_of, table
from hapscene.capture.record import record
from hapscene.capture.record_file import load_record
from hapscene.capture.record_simulator import COLUMNS, lines
from hapscene.cli import main
from hapscene.errors import HapsceneError
from hapscene.wire.protocol import Column, Count, Header, Run
from tests.chromium import AXE, AXE_RUN, launched
from tests.until import until

PATIENCE_S = 120.0
RATE_HZ = 10_000.0


def stroked(live: LiveCoverage, seconds: float) -> None:
    """A stroke over two cells."""
    count = round(seconds * 5000.0)
    force = np.where(np.arange(count) < count // 2, 0.5, 1.0)
    rows = {"acceleration": np.random.default_rng(0).normal(size=count), "force": force, "speed": np.full(count, 0.1)}
    live.start(5000.0, tuple(rows))
    for first, block in blocks_of(rows, 5000.0):
        live.feed(first, block)
    live.publish()


@pytest.fixture
def live() -> LiveCoverage:
    live = LiveCoverage(Wanted())
    stroked(live, 4.0)
    return live


def test_columns_of_a_probe_become_quantities() -> None:
    header = Header(5000.0, (*(Column(f"acceleration_{a}", "g", 0.001) for a in "xyz"), Column("speed", "mm/s", 0.1),
                             Column("temperature", "K", 1.0), Column("force", "bar", 1.0)))  # fmt: skip
    live = LiveCoverage(Wanted())
    live.begin(header)
    coverage = live.coverage
    assert coverage is not None and not coverage.has_force and coverage.has_speed
    counts = np.random.default_rng(0).integers(-1000, 1000, (10_000, 6))
    counts[:, 3] = 1000
    live.take(Run(0, counts))
    assert coverage.now.speed_m_s == pytest.approx(0.1) and coverage.pieces.sum() == 20
    assert coverage.now.rms_m_s2 == pytest.approx(9.80665 * np.sqrt(3.0 / 3.0), rel=0.1)
    live.tell(Count(torn=3, garbage=2), 10_000)
    assert live.state()["lost"] == {"dropped": 0, "torn": 3, "garbage": 2, "cut off": 0, "knocks": 0}
    nothing = LiveCoverage(Wanted())
    nothing.begin(Header(5000.0, (Column("force", "N", 1.0),)))
    nothing.take(Run(0, counts[:, :1]))
    assert "no acceleration is recorded" in json.loads(nothing.said[0])["advice"] and not nothing.done


def test_wrong_things_are_told_at_once_and_not_for_ever(live: LiveCoverage) -> None:
    coverage = live.coverage
    assert coverage is not None and live.state()["wrong"] == []
    rows = {name: np.full(500, 1.0) for name in ("acceleration", "force", "speed")}
    coverage.feed(round(coverage.seconds * 5000.0) + 7, rows)
    assert live.state()["wrong"] == ["samples are lost on the way"]
    live.skipped = 1
    assert len(live.state()["wrong"]) == 2
    for _ in range(20):
        coverage.feed(round(coverage.seconds * 5000.0), rows)
    assert live.state()["wrong"] == ["this computer is too slow for the picture; the recording is whole"]


def test_table(live: LiveCoverage) -> None:
    assert live.coverage is not None
    told = table(live.coverage)
    assert told[0].startswith("seconds of sliding (4.0 s in all)")
    assert [line.split()[2] for line in told[2:5]] == ["0.0", "0.0", "0.0"] and "2.0*" in told[4]
    assert "lacks: lift and tap three times" in told and told[-1].startswith("record on: ")
    blind = Coverage(5000.0, ("acceleration",), Wanted(taps=0))
    assert "any force" in table(blind)[2] and table(blind)[-1] == "record on: a longer stroke"


def test_played_back_in_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = np.column_stack([np.random.default_rng(0).normal(size=10_000), np.full(10_000, 1.0), np.full(10_000, 100.0)])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="acceleration,force,speed", comments="")
    words = ["--rate", "5000", "--units", "acceleration=m/s2,force=N,speed=mm/s"]
    assert main(["capture", "coverage", str(tmp_path / "a.csv"), *words, "--force-range", "0.8:1.2"]) == 0
    told = capsys.readouterr().out
    assert "0.8–1.2 N" in told and "2.0*" in told
    for wrong in (["--force-range", "2:1"], ["--speed-range", "20"], ["--taps", "-1"], ["--full-scale", "force"]):
        with pytest.raises(SystemExit):
            main(["capture", "coverage", str(tmp_path / "a.csv"), *words, *wrong])
    assert main(["capture", "coverage", str(tmp_path / "a.csv"), *words, "--full-scale", "force=ten"]) == 2
    assert main(["capture", "coverage", str(tmp_path / "b.csv")]) == 2


class BlockingProbe:
    """A probe at 10 kHz on a pseudo-terminal that waits where nobody reads: what is lost then, the reader lost."""

    def __init__(self, seconds: float) -> None:
        import tty

        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._seconds = seconds
        self.opened = threading.Event()
        threading.Thread(target=self._write, daemon=True).start()

    def _write(self) -> None:
        self.opened.wait(PATIENCE_S)
        start_s = time.monotonic()
        try:
            for turn, text in enumerate(lines(RATE_HZ)):
                if 0.01 * turn >= self._seconds:
                    break
                time.sleep(max(0.0, start_s + 0.01 * turn - time.monotonic()))
                while text:
                    text = text[os.write(self._ours, text) :]
        except OSError:
            pass

    def stopped(self) -> bool:
        self.opened.set()
        return False


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with launched() as browser:
        yield browser


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
def test_nothing_is_lost_beside_the_page(tmp_path: Path, chromium: Any) -> None:
    probe = BlockingProbe(5.0)
    with CoverageProcess(Wanted()) as page:
        tab = chromium.new_page()
        tab.goto(page.url)
        made: list[Any] = []

        def make() -> None:
            made.append(record(probe.port, tmp_path / "a.hsrec", duration_s=4.0, stopped=probe.stopped, watch=(page,)))

        recorder = threading.Thread(target=make)
        recorder.start()
        until(lambda: tab.evaluate("hapscene.count >= 20"))
        recorder.join(PATIENCE_S)
        until(lambda: tab.evaluate("document.getElementById('stop').disabled"))
        assert "It has ended" in tab.inner_text("#advice")
        lines_told = page.lines
        tab.close()
    (one,) = made
    assert (one.length, one.count.dropped, one.count.torn) == (40_000, 0, 0)
    kept = load_record(tmp_path / "a.hsrec")
    assert not kept.missing.any()
    whole = Coverage(RATE_HZ, tuple(c.name for c in COLUMNS))
    whole.feed(0, kept.streams)
    assert lines_told == table(whole)  # the page's process saw each sample, too


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
def test_the_page_ends_a_recording(tmp_path: Path, chromium: Any) -> None:
    simulator = subprocess.Popen(
        [sys.executable, "-m", "hapscene.capture.record_simulator"], stdout=subprocess.PIPE, text=True
    )
    words = [sys.executable, "-m", "hapscene", "capture", "record", "--live", "-o", str(tmp_path / "a.hsrec"), "--port"]
    try:
        assert simulator.stdout is not None
        recorder = subprocess.Popen([*words, simulator.stdout.readline().strip()], stdout=subprocess.PIPE, text=True)
        assert recorder.stdout is not None
        url = re.search(r"http://\S+", recorder.stdout.readline())
        assert url is not None
        tab = chromium.new_page()
        tab.goto(url[0])
        until(lambda: tab.evaluate("hapscene.count >= 5"))
        tab.keyboard.press("Tab")
        tab.keyboard.press("Enter")  # the button is the first that is reached
        told = recorder.communicate(timeout=PATIENCE_S)[0]
        tab.close()
    finally:
        simulator.kill()
        simulator.communicate()
    assert recorder.returncode == 0 and "seconds of sliding" in told
    assert load_record(tmp_path / "a.hsrec").ended == "stopped"


def test_a_port_that_is_taken_is_told(live: LiveCoverage) -> None:
    with CoveragePage(live) as page:
        port = int(re.findall(r":(\d+)/", page.url)[0])
        with pytest.raises(HapsceneError, match="--page-port"):
            CoverageProcess(Wanted(), port)


@pytest.mark.parametrize("look", ["light", "dark"])
@pytest.mark.parametrize("size", [(390, 844), (1280, 800)])
def test_the_page_can_be_read(live: LiveCoverage, chromium: Any, look: str, size: tuple[int, int]) -> None:
    with CoveragePage(live) as page, chromium.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=look, bypass_csp=True
    ) as context:  # fmt: skip
        tab = context.new_page()
        wrong: list[str] = []
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.goto(page.url)
        until(lambda: tab.evaluate("hapscene.count >= 1"))
        assert tab.get_attribute("#plane", "aria-label") == "Force and speed: 2 of 12 cells are filled"
        assert tab.inner_text("#advice") == json.loads(live.said[0])["advice"]
        assert tab.evaluate("document.documentElement.scrollWidth") <= size[0]
        if AXE.is_file():
            tab.evaluate(AXE.read_text(encoding="utf-8"))
            assert tab.evaluate(AXE_RUN) == []
        tab.click("#stop")
        until(live.stopped.is_set)
        assert not wrong


def test_strangers_and_nonsense_do_nothing(live: LiveCoverage) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with CoveragePage(live) as page:
        origin = page.url.rsplit("/", 2)[0]
        address = page.url.replace("http", "ws") + "socket"
        with pytest.raises(InvalidStatus):
            connect(address, origin="http://evil.example")  # type: ignore[arg-type]
        with pytest.raises(InvalidStatus):
            connect(address.replace(page.url.split("/")[3], "guess"), origin=origin)  # type: ignore[arg-type]
        with connect(address, origin=origin) as line:  # type: ignore[arg-type]
            line.send("{}")
            line.send("quit")
            assert json.loads(line.recv(timeout=PATIENCE_S))["share"]
        assert not live.stopped.is_set()


def test_a_recording_is_played_back_to_who_looks_and_as_long_as_they_do(tmp_path: Path) -> None:
    from websockets.sync.client import connect

    rows = np.c_[np.random.default_rng(0).normal(size=1200), np.full(1200, 1.0), np.full(1200, 0.1)]
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="acceleration,force,speed", comments="")
    words = [sys.executable, "-m", "hapscene.cli", "capture", "coverage", str(tmp_path / "a.csv"), "--rate", "2000"]
    words += ["--units", "acceleration=m/s2,force=N,speed=m/s", "--live"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        url = next(word for line in child.stdout for word in line.split() if word.startswith("http"))
        with connect(url.replace("http", "ws") + "socket", origin=url.rsplit("/", 2)[0]) as line:  # type: ignore[arg-type]
            while "the recording is over" not in line.recv(timeout=PATIENCE_S):
                pass
            assert child.poll() is None
        told = child.communicate(timeout=PATIENCE_S)[0]
        assert child.returncode == 0 and "seconds of sliding (0.6 s in all)" in told


@pytest.mark.soak
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
def test_a_minute_at_20_updates_a_second(tmp_path: Path, chromium: Any) -> None:
    """In real time: the simulator loses what is not read in time. For a quiet machine."""
    words = [sys.executable, "-m", "hapscene.capture.record_simulator", "--rate", f"{RATE_HZ:g}"]
    simulator = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert simulator.stdout is not None
    port = simulator.stdout.readline().strip()
    with CoverageProcess(Wanted()) as page:
        tab = chromium.new_page()
        tab.goto(page.url)
        made: list[Any] = []
        recorder = threading.Thread(
            target=lambda: made.append(record(port, tmp_path / "a.hsrec", duration_s=62.0, watch=(page,)))
        )
        recorder.start()
        until(lambda: tab.evaluate("hapscene.count >= 20"))
        before, begun_s = tab.evaluate("hapscene.count"), time.monotonic()
        tab.wait_for_timeout(55_000)
        rate_Hz = (tab.evaluate("hapscene.count") - before) / (time.monotonic() - begun_s)
        recorder.join(PATIENCE_S)
        tab.close()
    simulator.kill()
    simulator.communicate()
    print(f"{rate_Hz:.1f} updates a second; {made[0]}")
    assert made[0].count.dropped == 0 and made[0].count.torn == 0
    assert rate_Hz > 0.95 / BEAT_S
