"""Recording from a scripted serial port, with a virtual clock."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture import recorder
from hapscene.capture.io.hsrec import load_record
from hapscene.capture.recorder import RecordingResult, record
from hapscene.errors import CaptureError
from hapscene.io.probe_protocol import Column, Header, sample_line
from tests.header_line import header_line
from tests.virtual_clock import VirtualClock

COLUMNS = (Column("acceleration", "m/s2", 0.001), Column("force", "N", 0.01))
RATE_HZ = 2000.0
HEADER = header_line(Header(RATE_HZ, COLUMNS))
LINES = 20
"""Lines that the port returns at once [count]."""


def lines(start: int, stop: int) -> list[bytes]:
    return [sample_line(n, ((n * 37) % 4001 - 2000, n % 300)) for n in range(start, stop)]


def truth(n: np.ndarray) -> np.ndarray:
    return np.stack([((n * 37) % 4001 - 2000) * 0.001, (n % 300) * 0.01])


Play = Callable[..., RecordingResult]


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Play:
    """Records lines, `LINES` at a time, in real time of a virtual clock; `last` is the error that ends the port."""

    def played(parts: list[bytes], last: str = "", out: str = "a.hsrec", **more: object) -> RecordingResult:
        clock = VirtualClock()
        batches: Iterator[list[bytes]] = iter([parts[i : i + LINES] for i in range(0, len(parts), LINES)])

        class ScriptedPort:
            def __init__(self, name: str, baud: int) -> None:
                pass

            def next(self) -> tuple[bytes, float] | str | None:
                batch = next(batches, None)
                clock.sleep_s(0.05 if batch is None else LINES / RATE_HZ)
                return (b"".join(batch), clock.now_s()) if batch is not None else last or None

            def close(self) -> None:
                pass

        monkeypatch.setattr(recorder, "Port", ScriptedPort)
        return record("COM7", tmp_path / out, clock=clock, **more)  # type: ignore[arg-type]

    return played


def test_a_clean_recording(play: Play, tmp_path: Path) -> None:
    made = play([HEADER, *lines(0, 3000)], duration_s=1.25)
    assert (made.length, made.ended, made.count.dropped, made.complete) == (2500, "the duration was reached", 0, True)
    kept = load_record(tmp_path / "a.hsrec")
    assert kept.rate_Hz == RATE_HZ and kept.ended == made.ended and made.rate_measured_Hz is None
    assert kept.units == {"acceleration": "m/s2", "force": "N"} and not kept.missing.any()
    np.testing.assert_allclose(list(kept.streams.values()), truth(np.arange(2500)), atol=1e-12)


def test_the_rate_is_measured_by_the_clock(play: Play) -> None:
    parts = lines(0, 12_000)
    made = play([HEADER, *(part for part in parts for part in (part, b""))], duration_s=6.0)
    assert made.rate_measured_Hz == pytest.approx(0.5 * RATE_HZ, rel=0.01)  # the probe is half as fast as announced


def test_dropped_torn_and_garbage(play: Play, tmp_path: Path) -> None:
    parts = lines(0, 3000)
    spoilt = np.random.default_rng(0).choice(np.arange(1, 2499), 90, replace=False)
    dropped, torn, joined = spoilt[:30], spoilt[30:60], spoilt[60:90]
    for n in dropped:
        parts[n] = b""
    for n in torn:
        parts[n] = parts[n][:4] + b"\n"
    for n in joined:
        parts[n] = b"\xfe\x00?" + parts[n]
    parts[1000] = HEADER + parts[1000]
    made = play([HEADER, *parts], duration_s=1.25)
    assert (made.count.dropped, made.count.torn, made.count.garbage) == (90, 30, 30)
    kept = load_record(tmp_path / "a.hsrec")
    assert set(np.flatnonzero(kept.missing)) == set(spoilt)
    there = np.flatnonzero(~kept.missing)
    np.testing.assert_allclose(np.stack(list(kept.streams.values()))[:, there], truth(there), atol=1e-12)


@pytest.mark.parametrize(
    ("more", "ended", "complete"),
    [
        ({"last": "unplugged"}, "the probe was disconnected: unplugged", False),
        ({"duration_s": 3.0}, "the probe sent too few samples in the requested time", False),
        ({"extra": header_line(Header(50.0, COLUMNS))}, "another rate", False),
        ({"stopped_after": 12}, "stopped", True),
    ],
)
def test_the_record_is_complete_however_the_recording_ends(
    play: Play, tmp_path: Path, more: dict[str, object], ended: str, complete: bool
) -> None:
    calls = iter(range(10**6))
    parts = [HEADER, *lines(0, 399), *([more.pop("extra")] if "extra" in more else [])]
    if most := more.pop("stopped_after", 0):
        more["stopped"] = lambda: next(calls) >= int(str(most))
    made = play(parts, **more)
    assert ended in made.ended and made.complete == complete
    kept = load_record(tmp_path / "a.hsrec")
    assert kept.ended == made.ended and len(kept.missing) == made.length > 0


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([], r"no data in 5 s.*#hapscene-probe 1"),
        ([b"\xf3\x80\n" * 50], r"150 bytes in 5 s at 921600 baud, but no line.*check --baud"),
        ([HEADER.replace(b"probe 1", b"probe 7")], "but no line"),  # its checksum does not match
        ([b"#hapscene-probe 2 x*A673\n"], "version 2"),
    ],
)
def test_a_port_without_a_probe_is_refused(play: Play, tmp_path: Path, parts: list[bytes], message: str) -> None:
    with pytest.raises(CaptureError, match=f"^COM7: .*{message}"):
        play(parts)
    assert not list(tmp_path.iterdir())


def test_a_port_that_closes_or_is_stopped_before_a_header(play: Play) -> None:
    with pytest.raises(CaptureError, match="port closed before"):
        play([], last="unplugged")
    with pytest.raises(KeyboardInterrupt):
        play([], stopped=lambda: True)


def test_a_probe_without_samples_leaves_no_file(play: Play, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="no samples"):
        play([HEADER], last="unplugged")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("out", "message"),
    [("a.wav", r"expected \.hsrec"), ("there.hsrec", "exists")],
)
def test_existing_files_are_not_overwritten(play: Play, tmp_path: Path, out: str, message: str) -> None:
    (tmp_path / "there.hsrec").write_bytes(b"dear")
    with pytest.raises(CaptureError, match=message):
        play([HEADER], out=out)
    assert (tmp_path / "there.hsrec").read_bytes() == b"dear"


def test_the_level_is_printed_each_second(play: Play) -> None:
    said: list[str] = []
    parts = [sample_line(n, (9810 + 1000 * (-1) ** n, 200 * (n % 2))) for n in range(5000)]
    parts[7:10] = [b"", b"", b""]
    play([HEADER, *parts], duration_s=2.5, say=said.append)
    assert said[0].startswith("recording acceleration") and len(said) == 3
    for line, second in zip(said[1:], "12", strict=True):
        assert re.match(rf" +{second}\.0 s  dropped 3, torn 0, garbage 0  rms", line)
        assert line.endswith("rms/peak:  acceleration 1/1 m/s2  force 1/1 N")
