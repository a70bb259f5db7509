"""Serial ports, on pseudo-terminals."""

import errno
import os
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("tty", reason="this system has no pseudo-terminals")
pytest.importorskip("serial", reason="no pyserial")

from hapscene.compiled.native import INTERPRETED
from hapscene.device.serial_port import CLOSE_S, PERMISSION, WRITE_S, SerialPort, chosen_port, find_ports
from hapscene.errors import DeviceError
from tests.virtual_clock import VirtualClock


class Wire:
    """The device's end of a port, and the port, on a virtual clock. Bytes may arrive in parts."""

    def __init__(self) -> None:
        self.clock, (self.end, theirs) = VirtualClock(), os.openpty()
        self.name = os.ttyname(theirs)
        self.port = SerialPort("toy", self.name, 115_200, clock=self.clock)
        os.close(theirs)

    def unplug(self) -> None:
        if self.end >= 0:
            os.close(self.end)
        self.end = -1

    def received(self, count: int) -> bytes:
        """The next bytes that arrive at the device."""
        data = b""
        while len(data) < count:
            data += os.read(self.end, count - len(data))
        return data


@pytest.fixture
def wire() -> Iterator[Wire]:
    wire = Wire()
    yield wire
    wire.port.close()
    wire.unplug()


def test_bytes_pass_both_ways_and_a_read_never_waits(wire: Wire) -> None:
    data = wire.port.read()
    assert data == b""
    os.write(wire.end, bytes(range(256)))
    reads = 0
    while len(data) < 256:
        data, reads = data + (piece := wire.port.read()), reads + (len(piece) > 0)
    assert data == bytes(range(256)) and wire.port.read() == b"" and reads < 256
    wire.port.write(b"\n\r\x03")
    wire.port.flush()
    assert wire.received(3) == b"\n\r\x03"


def test_a_port_is_exclusive_but_for_a_release(wire: Wire) -> None:
    with pytest.raises(DeviceError, match="in use"):
        SerialPort("other", wire.name, 115_200)
    other = SerialPort("other", wire.name, 115_200, alone=False)
    other.close(b"0")
    other.close(b"2")  # does nothing
    wire.port.close(b"1")
    assert wire.received(2) == b"01"
    assert not wire.port._serial.is_open and not other._serial.is_open


def test_a_message_in_parts_stays_complete_and_unsent_bytes_precede_the_next(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, room = os.write, [0]

    def limited(file: int, data: bytes) -> int:
        count = min(3, room[0])
        room[0] -= count
        if not count:
            raise BlockingIOError
        return write(file, data[:count])

    monkeypatch.setattr(os, "write", limited)
    line, begin_s = wire.port.line, wire.clock.now_s()
    line.output[:2], line.state.unsent, room[0] = (1, 2), 2, 5  # of compiled code
    with pytest.raises(DeviceError, match=f"^toy: {wire.name}: .*accepts no data"):
        wire.port.write(bytes(range(3, 13)))
    assert WRITE_S < wire.clock.now_s() - begin_s < WRITE_S + 2e-3 and line.state.unsent == 0
    room[0] = 10
    wire.port.write(bytes(range(13, 16)))
    assert wire.received(15) == bytes(range(1, 16))
    begin_s = wire.clock.now_s()
    wire.port.close(b"end")
    assert CLOSE_S < wire.clock.now_s() - begin_s < CLOSE_S + 2e-3


def test_python_moves_the_bytes_of_compiled_code_where_it_has_no_port(wire: Wire) -> None:
    line = wire.port.line
    assert line.state.file == (-1 if INTERPRETED else wire.port._serial.fileno())
    line.state.file = -1
    for sent, whole in ((b"abc", b"abc"), (b"de", b"abcde"), (b"f" * 300, b"abcde" + 251 * b"f")):
        os.write(wire.end, sent)
        while line.state.received < len(whole):
            wire.port.exchange()
        assert line.input[: line.state.received].tobytes() == whole
    wire.port.exchange()  # there is no room
    line.output[:2], line.state.unsent = (7, 8), 2
    wire.port.exchange()
    assert wire.received(2) == b"\x07\x08" and line.state.unsent == 0 and line.state.received == 256


def test_a_disconnected_port_is_an_error_of_each_call_but_close(wire: Wire) -> None:
    wire.unplug()
    for call in (wire.port.read, lambda: wire.port.write(b"x"), wire.port.flush):
        with pytest.raises(DeviceError, match="disconnected"):
            call()
    wire.port.close(b"x")


def ports(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    from serial.tools.list_ports_common import ListPortInfo

    found = [ListPortInfo(name) for name in names]
    for k, each in enumerate(found):
        each.vid = k or None  # the first one is on the mainboard
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)


def test_the_only_port_on_usb_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    assert chosen_port("toy", "COM3") == "COM3"
    ports(monkeypatch, "/dev/null", "/dev/zero")
    assert chosen_port("toy", None) == "/dev/zero"
    ports(monkeypatch, "/dev/null", "/dev/zero", "/dev/full")
    assert [found.options for found in find_ports()] == [{"port": "/dev/full"}, {"port": "/dev/zero"}]
    with pytest.raises(DeviceError, match=r"/dev/full .*, /dev/zero"):
        chosen_port("toy", None)
    ports(monkeypatch, "/dev/null")
    with pytest.raises(DeviceError, match="not found"):
        chosen_port("toy", None)


def test_missing_permission_has_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    (found,) = find_ports("/dev/null")
    assert (found.where, found.options, found.trouble) == ("/dev/null", {"port": "/dev/null"}, "")
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.R_OK | os.W_OK)
    (found,) = find_ports("/dev/null")
    assert "no permission" in found.trouble and found.remedy == PERMISSION
    for number, remedied in ((errno.EACCES, True), (errno.ENOENT, False)):

        def refuse(*given: Any, number: int = number, **more: Any) -> Any:
            raise OSError(number, "refused")

        monkeypatch.setattr("serial.Serial", refuse)
        with pytest.raises(DeviceError) as caught:
            SerialPort("toy", "/dev/null", 115_200)
        assert (PERMISSION in str(caught.value)) is remedied
