"""A board that plays live, at the wire: the simulated one, wires that spoil what they carry, and the sketch itself."""

import re
import shutil
import subprocess
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene.handle.board import BUFFER, EMPTY, LIMITED, LINE_COUNT, LIVE, RUN, START, LiveBoard, live_start
from hapscene.handle.force_source import SimulatedSource
from hapscene.handle.plant import Plant
from hapscene.io.probe_protocol import Column, Header, sample_line, sealed
from tests.handle.serial_board import COLUMNS, Peer
from tests.header_line import header_line
from tests.virtual_clock import DrivenClock

ROOT = Path(__file__).resolve().parents[2]

RATE_HZ = 5000.0

MUTATED = 2000

pytestmark = pytest.mark.filterwarnings("error")


def peer(limit_N: float = 3.0) -> Peer:
    peer = Peer(SimulatedSource(Plant(force_limit_N=limit_N), RATE_HZ, noise_m_s2_rtHz=0.0, tremor_N=0.0))
    peer.give(1)  # compiled before anybody waits
    return peer


def rows(said: bytes) -> np.ndarray:
    """Number, force, acceleration, played and state of each sample, (n, 5)."""
    lines = [line.split(b"*")[0] for line in said.split(b"\n") if line and not line.startswith(b"#")]
    return np.array([[int(part) for part in line.split(b",")] for line in lines], dtype=np.int64).reshape(-1, 5)


class Wire:
    """A simulated board with its own clock, which advances 2 ms at each poll unless `stands` is set."""

    def __init__(self, peer: Peer) -> None:
        self.peer, self.closed, self.gone, self.silent = peer, False, "", False
        self.clock = DrivenClock()
        self.spoil = lambda data: data
        self.sent: list[bytes] = []
        self.received: deque[np.ndarray] = deque()

    def next(self) -> Any:
        self.clock.move(10 / RATE_HZ)
        if self.gone:
            return self.gone
        said = self.peer.give(10)
        self.received.append(rows(said))
        return None if self.silent else (self.spoil(said), self.clock.now_s())

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self.peer.take(data)

    def close(self) -> None:
        self.closed = True

    @property
    def force(self) -> np.ndarray:
        return np.concatenate(list(self.received))[:, 1]


class Sine:
    """A feed of which every sample differs from its neighbours, and the measurements that it receives."""

    def __init__(self) -> None:
        self.count, self.fades, self.halted = 0, 0, False
        self.received: list[np.ndarray] = []

    def pull(self, out: np.ndarray) -> bool:
        out[:] = 0.0 if self.halted else 2.0 * np.sin(0.3 * (self.count + np.arange(len(out))))
        self.count += len(out)
        return self.halted

    def fade_in(self) -> None:
        self.fades += 1

    def receive_feedback(self, numbers: np.ndarray, force: np.ndarray, acceleration: np.ndarray) -> None:
        self.received.append(np.stack([numbers, force, acceleration]))

    def check(self, lost: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Number, force and acceleration of what was put out: each force is that which was pulled under its number."""
        received = np.hstack(self.received)
        number, force, acceleration = received[:, np.isfinite(received[1])]
        wanted = 2.0 * np.sin(0.3 * number)
        assert number[0] == 0 and (np.diff(number) > 0).all() and number[-1] < self.count
        right = np.abs(force - wanted) < 1e-4
        assert right.all() if not lost else (right | (force == 0.0)).all() and right.mean() > 0.8
        return number, acceleration


def board(wire: Wire, **other: Any) -> LiveBoard:
    options = {"limit_N": 3.0, "ahead_s": 0.015, "watchdog_s": 0.02, "highpass_Hz": 0.0, "lag_s": 0.005}
    return LiveBoard("wire", wire, clock=wire.clock, **options | other)


def test_samples_are_put_out_in_order_and_measured() -> None:
    wire, feed = Wire(peer()), Sine()
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 3000)
    live.close()
    number, acceleration = feed.check()
    out = wire.force[wire.force != 0]
    wanted = np.rint(2e4 * np.sin(0.3 * np.arange(len(out) + 100))).astype(int)
    np.testing.assert_array_equal(out, wanted[wanted != 0][: len(out)])
    assert len(out) > 2500 and feed.fades == 1 and not any(live.counts.values()) and live.fault == ""
    assert wire.closed and not peer_force(wire.peer)
    assert number.tolist() == list(range(len(number))) and len(number) > 2500 and np.abs(acceleration).max() > 5.0
    assert 0.002 < live.latency_s < 0.016
    live.close()  # twice does no harm


def test_the_buffer_has_room_for_a_line_and_holds_two() -> None:
    for ahead_s, count in ((0.015, 75), (0.0, 2 * LINE_COUNT), (1.0, BUFFER - LINE_COUNT)):
        live = board(Wire(peer()), ahead_s=ahead_s)
        assert live.latency_s * live.rate_Hz == pytest.approx(count)
        live.close()


def peer_force(peer: Peer) -> bool:
    """Whether there is any force from now on."""
    return bool(rows(peer.give(200))[:, 1].any())


def test_bytes_on_the_wire_match_the_documented_protocol() -> None:
    text = (ROOT / "docs" / "reference" / "handle-protocol.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    [<>] (.*)\*[0-9A-F]{4}$", text, re.MULTILINE)
    assert len(lines) == 11 and all(sealed(line.encode()).decode().strip() in text for line in lines)
    assert sealed(live_start(0.02, 1)) == b"#hapscene-handle 2 start watchdog=20 run=1*53EC\n"
    handle = peer()
    handle.take(sealed(live_start(0.02, 1)) + sample_line(0, [12, 51, 31_000]))
    assert rows(handle.give(4))[:, [1, 3, 4]].tolist() == [
        [12, 1, RUN + LIVE],
        [51, 2, RUN + LIVE],
        [30_000, 3, RUN + LIVE + LIMITED],
        [0, 3, RUN + LIVE + EMPTY],
    ]


def test_the_force_ends_within_the_watchdog_time_when_the_computer_dies() -> None:
    wire, feed = Wire(peer()), Sine()
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 500)
    wire.write = lambda data: None  # type: ignore[method-assign]
    before = len(wire.received)
    wire.clock.until(lambda: len(wire.received) > before + 30)
    said = np.concatenate(list(wire.received)[before:])
    assert not said[int(0.021 * RATE_HZ) + 10 :, 1].any()
    live.close()


def test_the_board_discards_its_buffer_when_the_force_must_end() -> None:
    """The application has died. When the force may return, it is that of the samples that are pulled then."""
    wire, feed = Wire(peer()), Sine()
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 500)
    feed.halted, before = True, len(wire.received)
    wire.clock.until(lambda: len(wire.received) > before + 30)
    assert wire.received[before - 1][:, 1].any() and not np.concatenate(list(wire.received)[before + 2 :])[:, 1].any()
    feed.halted, count = False, feed.count
    wire.clock.until(lambda: feed.count > count + 500)
    live.close()
    assert feed.fades == 2 and live.fault == "" and not any(live.counts.values())
    received = np.hstack(feed.received)
    number, force, _ = received[:, np.isfinite(received[1])]
    np.testing.assert_allclose(force[-200:], 2.0 * np.sin(0.3 * number[-200:]), atol=1e-4)


def test_after_a_suspended_computer_the_force_fades_in() -> None:
    wire, feed = Wire(peer()), Sine()
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 500)
    wire.clock.move(0.04)
    wire.peer.give(200)
    wire.clock.until(lambda: live.counts["watchdog"] == 1)
    count = feed.count
    wire.clock.until(lambda: feed.count > count + 500)
    live.close()
    assert feed.fades == 2 and live.fault == ""
    number, _ = feed.check()
    assert number[-1] - number[0] >= len(number)  # what was lost has its numbers


def test_an_empty_buffer_and_limited_forces_are_counted() -> None:
    """The computer is late by more than the buffer holds, and by less than the watchdog's time; the board has 1 N."""
    wire, feed, late = Wire(peer(1.0)), Sine(), list[np.ndarray]()

    def busy(said: bytes) -> bytes:
        if feed.count > 500 and not late:
            late.append(rows(wire.peer.give(70)))
        return said

    wire.spoil = busy
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 1500)
    live.close()
    said = np.concatenate(list(wire.received))
    limited = np.count_nonzero(said[:, 4] & LIMITED)
    assert limited > 300 and late[0][-1, 4] & EMPTY and feed.fades == 2 and live.fault == ""
    counts = {"underruns": 1, "watchdog": 0, "restarts": 0, "lost": 70}
    assert abs(live.counts.pop("board_limited") - limited) <= 10 and live.counts == counts


def test_a_start_line_that_is_lost_is_repeated() -> None:
    wire, feed = Wire(peer()), Sine()
    take, lost = wire.peer.take, [sealed(live_start(0.02, 1))]
    wire.peer.take = lambda data: None if data in lost else take(data)  # type: ignore[method-assign]
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 100)
    live.close()
    assert feed.fades == 1 and not any(live.counts.values())
    starts = [data for data in wire.sent if b"start watchdog" in data]
    assert starts == [sealed(live_start(0.02, run)) for run in (1, 2)] and wire.sent[-1] == sealed(START)


@pytest.mark.parametrize("wrong", [{"watchdog_s": 0.0049}, {"watchdog_s": 1.1}, {"limit_N": 0.0}, {"limit_N": 1e3}])
def test_options_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    wire = Wire(peer())
    with pytest.raises(HandleError, match=next(iter(wrong))):
        board(wire, **wrong)
    assert wire.closed and not wire.sent


@pytest.mark.parametrize(("way", "words"), [("gone", "disconnected: torn out"), ("silent", "no data")])
def test_a_disconnected_or_silent_board_is_reported(way: str, words: str) -> None:
    wire, feed = Wire(peer()), Sine()
    live = board(wire)
    live.start(feed)
    wire.clock.until(lambda: feed.count > 200)
    thread = live._thread
    setattr(wire, way, "torn out")
    assert thread is not None
    thread.join()  # it ends by itself, and then no longer advances the clock
    live.close()
    assert words in live.fault and wire.closed


def test_a_board_that_only_plays_sweeps_is_refused() -> None:
    wire = Wire(peer())
    wire.spoil = lambda data: header_line(Header(RATE_HZ, COLUMNS))
    with pytest.raises(HandleError, match="state"):
        board(wire)
    assert wire.closed


def mutated(rng: np.random.Generator, frame: bytes) -> bytes:
    """Return a damaged frame; one in ten gets a correct checksum."""
    data = bytearray(frame)
    for _ in range(rng.integers(1, 6)):
        at = int(rng.integers(0, len(data) + 1))
        how = rng.integers(0, 5)
        if how == 0 and at < len(data):
            data[at] ^= 1 << int(rng.integers(0, 8))
        elif how == 1:
            data[at : at + int(rng.integers(1, 9))] = b""
        elif how == 2:
            data[at:at] = rng.bytes(int(rng.integers(1, 9)))
        elif how == 3:
            data[at:at] = bytes(rng.choice(list(b"0123456789,-*#\n\r+. "), int(rng.integers(1, 9))))
        else:
            data[at:] = data[at : at + int(rng.integers(0, 400))] * int(rng.integers(1, 4))
    if rng.random() < 0.1:
        return sealed(bytes(data).replace(b"\n", b"").rpartition(b"*")[0])
    return bytes(data)


FRAMES = (
    sample_line(0, range(32)),
    sample_line(7, [-30_000, 30_000]),
    sealed(START),
    sealed(live_start(0.02, 9)),
    header_line(Header(RATE_HZ, (*COLUMNS, Column("state", "1", 1.0)))),
    sample_line(900, (12, -3, 4, 17)),
)


class Readings:
    """What the sketch's stand-in measures, in place of a handle."""

    def __init__(self) -> None:
        self.rate_Hz, self.plant, self.count = RATE_HZ, Plant(force_limit_N=3.0), 0

    def advance(self, force_N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        counts = np.arange(self.count, self.count + len(force_N))
        self.count += len(force_N)
        return 0.048 * ((counts * 37) % 101 - 50), np.zeros(len(force_N))


@pytest.fixture(scope="session")
def sketch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sketch, compiled for this computer."""
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no g++: .ci/system-packages installs it")
    program = tmp_path_factory.mktemp("sketch") / "sketch"
    source = ROOT / "examples" / "handle_firmware" / "handle_firmware.ino"
    words = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined", "-x", "c++"]
    subprocess.run(
        [compiler, *words, "-I", Path(__file__).parent / "firmware", source, "-o", program], check=True, timeout=120
    )
    return program


def both(sketch: Path, script: list[bytes | int]) -> tuple[bytes, bytes]:
    """Return the answers of the simulated board and of the sketch to received bytes or elapsed samples."""
    simulated = Peer(Readings(), grip_count=1)  # type: ignore[arg-type]
    simulated.source.plant = Plant(force_limit_N=3.0)
    said, lines = [], []
    for step in script:
        if isinstance(step, bytes):
            simulated.take(step)
            lines.append(b"F " + step.hex().encode())
        else:
            said += [simulated.give(1) for _ in range(step)]
            lines.append(b"S %d" % step)
    ran = subprocess.run([sketch], input=b"\n".join(lines) + b"\n", capture_output=True, timeout=60, check=True)
    return b"".join(said), ran.stdout


@pytest.mark.nightly
def test_firmware_and_simulated_board_send_the_same_bytes(sketch: Path) -> None:
    script: list[bytes | int] = [3, sealed(START), sample_line(0, [5, -7]), 4, sample_line(4, [1]), 1100]
    script += [sealed(live_start(0.02, 200)), sample_line(0, range(-16, 16)), sample_line(40, [40_000, -40_000]), 60]
    script += [
        sample_line(42, [9]),
        150,
        sample_line(43, [9]),
        3,
        sealed(live_start(0.005, 1)),
        sample_line(0, [3]),
        30,
    ]
    simulated, compiled = both(sketch, script)
    assert compiled == simulated
    assert {30_000, -30_000, 5, -7, 9, 3} <= set(rows(compiled)[:, 1].tolist())


@pytest.mark.nightly
def test_firmware_and_simulated_board_agree_on_invalid_frames(sketch: Path) -> None:
    rng = np.random.default_rng(7)
    script: list[bytes | int] = []
    for _ in range(MUTATED // 4):
        script += [mutated(rng, FRAMES[rng.integers(0, len(FRAMES))]), int(rng.integers(0, 4))]
        if rng.random() < 0.1:
            script += [b"\n" + sealed(live_start(0.02, 2)), sample_line(0, [1, 2, 3])]
    simulated, compiled = both(sketch, script)
    assert compiled == simulated and rows(compiled)[:, 1].any()
