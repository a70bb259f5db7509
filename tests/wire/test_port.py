"""A port drained by a thread, over a pseudo-terminal."""

import argparse
import os
import threading
import time
from collections.abc import Iterator

import pytest

from hapscene.errors import CaptureError
from hapscene.wire.port import BAUD, POLL_S, Port, simulated_port, simulator_parser

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")

PATIENCE_S = 120.0


@pytest.fixture
def wire() -> Iterator[tuple[int, Port]]:
    """Our end, and the port at the other one."""
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = Port(os.ttyname(theirs), BAUD)
    yield ours, port
    port.close()
    os.close(theirs)


def drained(port: Port, count: int) -> list[tuple[bytes, float]]:
    """Pieces until they hold so many bytes."""
    pieces: list[tuple[bytes, float]] = []
    end = time.monotonic() + PATIENCE_S
    while sum(len(data) for data, _ in pieces) < count:
        assert time.monotonic() < end, "waited in vain"
        piece = port.next()
        assert not isinstance(piece, str), piece
        pieces += [piece] if piece is not None else []
    return pieces


def test_every_byte_comes_in_order_with_the_time_at_which_it_came(wire: tuple[int, Port]) -> None:
    ours, port = wire
    sent = bytes(range(256)) * 8
    before = time.monotonic()
    os.write(ours, sent)
    pieces = drained(port, len(sent))
    assert b"".join(data for data, _ in pieces) == sent
    times = [at for _, at in pieces]
    assert times == sorted(times) and before <= times[0] <= times[-1] <= time.monotonic()
    assert len(pieces) < len(sent) / 16  # lumps, not byte by byte


def test_silence_is_nothing_and_a_port_that_is_gone_is_a_reason(wire: tuple[int, Port]) -> None:
    ours, port = wire
    start = time.monotonic()
    assert port.next() is None and time.monotonic() - start > 0.5 * POLL_S
    os.close(ours)
    end, said = time.monotonic() + PATIENCE_S, None
    while not isinstance(said, str):
        assert time.monotonic() < end, "waited in vain"
        said = port.next()
    assert said == "input/output error" or "disconnected" in said


def test_closing_ends_the_thread() -> None:
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    before = set(threading.enumerate())
    port = Port(os.ttyname(theirs), BAUD)
    (thread,) = set(threading.enumerate()) - before
    assert thread.daemon
    port.close()
    assert not thread.is_alive()
    os.close(ours)
    os.close(theirs)


def test_a_port_belongs_to_one(wire: tuple[int, Port]) -> None:
    with pytest.raises(CaptureError, match="the port cannot be opened"):
        Port(wire[1]._serial.port, BAUD)


def test_a_simulated_board_has_a_port_that_does_not_block(capsys: pytest.CaptureFixture[str]) -> None:
    parser = simulator_parser("hapscene.a_board", None, 1234.0)
    options = parser.parse_args(["--seed", "3"])
    assert (options.rate, options.seconds, options.seed) == (1234.0, float("inf"), 3)
    ours = simulated_port(parser)
    name = capsys.readouterr().out.strip()
    port = Port(name, BAUD)
    try:
        with pytest.raises(BlockingIOError):
            os.read(ours, 1)
        os.write(ours, b"\n\r\x03\xff")  # raw: nothing is read into them
        assert b"".join(data for data, _ in drained(port, 4)) == b"\n\r\x03\xff"
    finally:
        port.close()
        os.close(ours)


def test_without_pseudo_terminals_a_simulator_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "openpty")
    with pytest.raises(SystemExit):
        simulated_port(argparse.ArgumentParser())
