"""The page beside a recording: nothing is lost for it, what it shows can be read, and it can end it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")

from hapscene.capture.record.coverage import Coverage, Wanted
from hapscene.capture.record.coverage_page import CoveragePage, CoverageProcess, LiveCoverage, blocks_of, table
from hapscene.cli import main
from hapscene.errors import HapsceneError
from hapscene.wire.protocol import Column, Count, Header, Run

PATIENCE_S = 120.0


def stroked(live: LiveCoverage, seconds: float) -> None:
    """A stroke over two cells."""
    count = round(seconds * 5000.0)
    force = np.where(np.arange(count) < count // 2, 0.5, 1.0)
    rows = {"acceleration": np.random.default_rng(0).normal(size=count), "force": force, "speed": np.full(count, 0.1)}
    live.coverage = Coverage(5000.0, tuple(rows))
    for first, block in blocks_of(rows, 5000.0):
        live.coverage.feed(first, block)


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
    live.tell(Count(torn=3, garbage=2))
    assert live.state()["lost"] == {"dropped": 0, "torn": 3, "garbage": 2, "clipped": 0}
    nothing = LiveCoverage(Wanted())
    nothing.begin(Header(5000.0, (Column("force", "N", 1.0),)))
    nothing.take(Run(0, counts[:, :1]))
    assert list(nothing.state()) == ["advice"] and "no acceleration" in nothing.state()["advice"]


def test_wrong_things_are_told_at_once_and_not_for_ever(live: LiveCoverage) -> None:
    coverage = live.coverage
    assert coverage is not None and live.state()["warnings"] == []
    rows = {name: np.full(500, 1.0) for name in ("acceleration", "force", "speed")}
    coverage.feed(round(coverage.seconds * 5000.0) + 7, rows)
    assert live.state()["warnings"] == ["samples are being lost"]
    live.skipped = 1
    assert len(live.state()["warnings"]) == 2
    for _ in range(20):
        coverage.feed(round(coverage.seconds * 5000.0), rows)
    assert live.state()["warnings"] == ["this computer is too slow for the page; the recording is complete"]


def test_table(live: LiveCoverage) -> None:
    assert live.coverage is not None
    told = table(live.coverage)
    assert told[0].startswith("seconds of sliding (4.0 s in all)")
    assert [line.split()[2] for line in told[2:5]] == ["0.0", "0.0", "0.0"] and "2.0*" in told[4]
    assert "lacks: lift and tap three times" in told and told[-1].startswith("record on: ")
    blind = Coverage(5000.0, ("acceleration",), Wanted(taps=0))
    assert "any force" in table(blind)[2] and table(blind)[-1].startswith("record on: 1 of 1")


def test_played_back_in_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = np.column_stack([np.random.default_rng(0).normal(size=10_000), np.full(10_000, 1.0), np.full(10_000, 100.0)])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="acceleration,force,speed", comments="")
    words = ["--rate", "5000", "--units", "acceleration=m/s2,force=N,speed=mm/s"]
    assert main(["capture", "coverage", str(tmp_path / "a.csv"), *words, "--force-range", "0.8", "1.2"]) == 0
    told = capsys.readouterr().out
    assert "0.8–1.2 N" in told and "2.0*" in told
    for wrong in (["--force-range", "2", "1"], ["--speed-range", "20"], ["--taps", "-1"]):
        assert main(["capture", "coverage", str(tmp_path / "a.csv"), *words, *wrong]) == 2
    assert main(["capture", "coverage", str(tmp_path / "b.csv")]) == 2


@pytest.mark.nightly  # a process
def test_a_port_that_is_taken_is_refused() -> None:
    with CoveragePage() as page:
        port = int(re.findall(r":(\d+)/", page.url)[0])
        with pytest.raises(HapsceneError, match="--page-port"):
            CoverageProcess(Wanted(), port)


def test_strangers_and_nonsense_do_nothing(live: LiveCoverage) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with CoveragePage() as page:
        page.send(live.state())
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
            line.send('"stop"')
            assert page.stopped.wait(PATIENCE_S)
