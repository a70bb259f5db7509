"""The page beside a recording: nothing is lost for it, what it shows can be read, and it can end it."""

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
from hapscene.capture.io.hsrec import load_record
from hapscene.capture.record.coverage import Coverage, Wanted
from hapscene.capture.record.coverage_page import CoveragePage, CoverageProcess, LiveCoverage, table
from hapscene.capture.record.recorder import record
from tests.capture.probe_simulator import COLUMNS, lines
from tests.capture.test_coverage_page import live
from tests.chromium import AXE, AXE_RUN
from tests.until import until

__all__ = ["live"]  # a fixture

PATIENCE_S = 120.0


RATE_HZ = 10_000.0


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


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
def test_nothing_is_lost_beside_the_page(tmp_path: Path, browser: Any) -> None:
    probe = BlockingProbe(5.0)
    with CoverageProcess(Wanted()) as page:
        tab = browser.new_page()
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
def test_the_page_ends_a_recording(tmp_path: Path, browser: Any) -> None:
    simulator = subprocess.Popen(
        [sys.executable, "-m", "tests.capture.probe_simulator"], stdout=subprocess.PIPE, text=True
    )
    words = [sys.executable, "-m", "hapscene", "capture", "record", "--live", "-o", str(tmp_path / "a.hsrec"), "--port"]
    try:
        assert simulator.stdout is not None
        recorder = subprocess.Popen([*words, simulator.stdout.readline().strip()], stdout=subprocess.PIPE, text=True)
        assert recorder.stdout is not None
        url = re.search(r"http://\S+", recorder.stdout.readline())
        assert url is not None
        tab = browser.new_page()
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


@pytest.mark.parametrize("look", ["light", "dark"])
@pytest.mark.parametrize("size", [(390, 844), (1280, 800)])
def test_the_page_can_be_read(live: LiveCoverage, browser: Any, look: str, size: tuple[int, int]) -> None:
    with CoveragePage() as page, browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=look, bypass_csp=True
    ) as context:  # fmt: skip
        tab = context.new_page()
        wrong: list[str] = []
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        page.send(live.state())
        tab.goto(page.url)
        until(lambda: tab.evaluate("hapscene.count >= 1"))
        assert tab.get_attribute("#plane", "aria-label") == "Force and speed: 2 of 12 cells are filled"
        assert tab.inner_text("#advice") == live.state()["advice"]
        assert tab.evaluate("document.documentElement.scrollWidth") <= size[0]
        if AXE.is_file():
            tab.evaluate(AXE.read_text(encoding="utf-8"))
            assert tab.evaluate(AXE_RUN) == []
        tab.click("#stop")
        until(page.stopped.is_set)
        assert not wrong
