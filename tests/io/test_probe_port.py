"""Serial ports, tested with pseudo-terminals."""

import os
from collections.abc import Iterator

import pytest

from hapscene.errors import CaptureError
from hapscene.io.probe_port import BAUD, Port
from tests.virtual_clock import PATIENCE_S, VirtualClock

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")


@pytest.fixture
def wire() -> Iterator[tuple[int, Port]]:
    """One end of a pseudo-terminal, and a port on the other end."""
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = Port(os.ttyname(theirs), BAUD, VirtualClock())
    yield ours, port
    port.close()
    os.close(theirs)


def read_all(port: Port, count: int) -> list[tuple[bytes, float]]:
    """Read until there are `count` bytes."""
    pieces: list[tuple[bytes, float]] = []
    while sum(len(data) for data, _ in pieces) < count:
        piece = port._pieces.get(timeout=PATIENCE_S)
        assert not isinstance(piece, str), piece
        pieces.append(piece)
    return pieces


def test_data_has_order_and_time(wire: tuple[int, Port]) -> None:
    ours, port = wire
    sent = bytes(range(256)) * 8
    for _ in range(2):
        os.write(ours, sent)
        pieces = read_all(port, len(sent))
        assert b"".join(data for data, _ in pieces) == sent
        assert {at for _, at in pieces} == {port._clock.now_s()}
        assert len(pieces) < len(sent) / 16  # collected, not byte by byte
        port._clock.sleep_s(1.0)


def test_silence_and_lost_port(wire: tuple[int, Port]) -> None:
    ours, port = wire
    assert port.next() is None
    os.close(ours)
    reason = port._pieces.get(timeout=PATIENCE_S)
    assert reason == "input/output error" or "disconnected" in reason


def test_port_in_use_raises(wire: tuple[int, Port]) -> None:
    with pytest.raises(CaptureError, match="cannot open the port"):
        Port(wire[1]._serial.port, BAUD)
