"""Serial ports for drivers: search, exclusive access, reads that never wait, and messages that stay complete.

`SerialPort` is for Python, `SerialLine` for compiled code, which reads and writes the same port without Python.
"""

import errno
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapscene.compiled.native import INTERPRETED, native
from hapscene.device.driver import Found
from hapscene.errors import DeviceError
from hapscene.records import Record, records
from hapscene.wall_clock import CLOCK, Clock

try:
    from termios import error as PortError
except ImportError:  # Windows has none
    PortError = OSError  # type: ignore[misc,assignment]

__all__ = ["SERIAL_MODULES", "SerialLine", "SerialPort", "discard", "find_ports", "receive", "send"]

SERIAL_MODULES: Final = ("serial", "serial.tools.list_ports")
"""Modules that a driver of a serial device imports when it is opened (`Driver.imports`)."""

PERMISSION: Final = "run: sudo usermod -aG dialout $USER, and log in again"

WRITE_S: Final = 0.05
"""Longest time that a write may block [s]."""

CLOSE_S: Final = 1.0
"""Longest time that the last message may block [s]."""

GONE: Final = (OSError, TypeError, PortError)
"""Exceptions of pyserial after a disconnection."""


def find_ports(port: str | None = None) -> Sequence[Found]:
    """The given port, or all ports on USB. Does not open them, so what is connected to a port remains unknown."""
    if port:
        return [_found(port, port)]
    from serial.tools.list_ports import comports

    on_usb = sorted(each for each in comports() if each.vid is not None)  # ports on the mainboard have no device
    return [_found(each.device, f"{each.device} ({each.description})") for each in on_usb]


def _found(port: str, where: str) -> Found:
    trouble = remedy = ""
    if os.name == "posix" and not Path(port).exists():
        trouble, remedy = f"{port}: no such port", "connect the device, or name another port: --option port=NAME"
    elif os.name == "posix" and not os.access(port, os.R_OK | os.W_OK):
        trouble, remedy = f"{port}: no permission", PERMISSION
    return Found(where, {"port": port}, trouble, remedy)


def chosen_port(driver: str, port: str | None) -> str:
    """The given port, or the only one on USB.

    Raises:
        DeviceError: no port was named and the number of ports is not one.
    """
    if port is not None:
        return port
    found = find_ports()
    if len(found) != 1:
        names = ", ".join(each.where for each in found) or "not found"
        raise DeviceError(f"{driver}: name the serial port: --option port=NAME; connected ports: {names}")
    return str(found[0].options["port"])


LINE: Final = np.dtype(
    [
        ("file", "i8"),  # file descriptor; −1 if Python reads and writes the port (`SerialPort.exchange`)
        ("received", "i8"),  # number of bytes in `SerialLine.input`
        ("unsent", "i8"),  # number of bytes in `SerialLine.output`
        ("accepted_ns", "i8"),  # time at which the port last accepted all bytes
        ("problem", "i8"),  # DISCONNECTED or REFUSED; 0: no problem
    ],
    align=True,
)
"""State of a `SerialLine`."""

DISCONNECTED, REFUSED = 1, 2

GONE_EVENTS: Final = 0x38
"""POLLERR, POLLHUP and POLLNVAL in the result of `poll`."""


class SerialLine(NamedTuple):
    """An open serial port for compiled code. Its functions never wait."""

    state: Record  # LINE
    input: NDArray[np.uint8]  # (256,) received bytes, which the driver removes
    output: NDArray[np.uint8]  # (64,) bytes that the port has not accepted yet; they precede the next message
    poll: NDArray[np.int32]  # (2,) a `struct pollfd`


_read: Any
_write: Any
_poll: Any

if INTERPRETED or sys.platform == "win32":

    @native
    def _read(file: int, address: int, count: int) -> int:
        return 0

    _write = _poll = _read
else:
    _read = types.ExternalFunction("read", types.int64(types.int32, types.uintp, types.uintp))
    _write = types.ExternalFunction("write", types.int64(types.int32, types.uintp, types.uintp))
    _poll = types.ExternalFunction("poll", types.int32(types.uintp, types.uintp, types.int32))


@native
def receive(line: SerialLine) -> None:
    """Append the bytes that have arrived to `line.input`; what does not fit remains in the port."""
    state, room = line.state, len(line.input) - line.state.received
    count = _read(np.int32(state.file), np.uintp(line.input.ctypes.data + state.received), np.uintp(room))
    if count > 0:
        state.received += count
        return
    line.poll[0], line.poll[1] = state.file, 0  # a read cannot tell a disconnected port from one without data
    _poll(np.uintp(line.poll.ctypes.data), np.uintp(1), np.int32(0))
    if line.poll[1] >> 16 & GONE_EVENTS:
        state.problem = DISCONNECTED


@native
def discard(line: SerialLine) -> None:
    """Discard all bytes that have arrived."""
    for _ in range(16):  # the buffer of the system holds 4096 bytes
        line.state.received = 0
        receive(line)
        if line.state.received < len(line.input):
            break
    line.state.received = 0


@native
def send(line: SerialLine, message: NDArray[np.uint8], now: int) -> None:
    """Send a message at a time `now` [ns]. If the port has not accepted the one before completely, it is dropped."""
    state = line.state
    _send_unsent(line, now)
    if state.unsent == 0:
        for k in range(len(message)):
            line.output[k] = message[k]
        state.unsent = len(message)
        _send_unsent(line, now)


@native
def _send_unsent(line: SerialLine, now: int) -> None:
    state = line.state
    if state.unsent > 0:
        count = _write(np.int32(state.file), np.uintp(line.output.ctypes.data), np.uintp(state.unsent))
        if count > 0:
            for k in range(state.unsent - count):
                line.output[k] = line.output[count + k]
            state.unsent -= count
        if state.unsent > 0 and now - state.accepted_ns > WRITE_S * 1e9:
            state.problem = REFUSED
    if state.unsent == 0:
        state.accepted_ns = now


class SerialPort:
    """An open serial port. Every error is a `DeviceError` that starts with `name`.

    Attributes:
        name: name of the driver and of the port, for messages.
        line: the same port for compiled code.
    """

    def __init__(self, driver: str, port: str | None, baud: int, alone: bool = True, clock: Clock = CLOCK) -> None:
        """Open a port.

        Args:
            driver: name of the driver.
            port: name of the port; None for the only one that is connected.
            baud: speed [bit/s].
            alone: whether to refuse the port to other programs, if the system supports it. False to set the force of a
                device to zero (`Driver.release`).
            clock: clock of the timeouts.

        Raises:
            DeviceError: no port was named and the number of ports is not one; or the port does not exist, is in use, or
                its permissions do not allow it.
        """
        import serial

        port = chosen_port(driver, port)
        self.name, self._clock, self._unsent = f"{driver}: {port}", clock, b""
        self.line = SerialLine(
            records(1, LINE)[0], np.zeros(256, np.uint8), np.zeros(64, np.uint8), np.zeros(2, np.int32)
        )
        try:
            exclusive = True if alone and os.name == "posix" else None
            self._serial = serial.Serial(port, baud, timeout=0.0, write_timeout=WRITE_S, exclusive=exclusive)
        except (OSError, ValueError) as error:
            if getattr(error, "errno", None) == errno.EAGAIN:  # another process holds the lock
                raise DeviceError(f"{self.name}: in use; close the other program that uses it") from None
            remedy = f"; {PERMISSION}" if getattr(error, "errno", None) == errno.EACCES else ""
            raise DeviceError(f"{self.name}: cannot be opened: {error}{remedy}") from None
        self.line.state.file = self._serial.fileno() if os.name == "posix" and not INTERPRETED else -1

    def exchange(self) -> None:
        """Move bytes between the port and `line`, where compiled code cannot: on Windows, and when interpreted."""
        line = self.line
        if line.state.file < 0:
            data = self.read()[: len(line.input) - line.state.received]
            line.input[line.state.received :][: len(data)] = np.frombuffer(data, np.uint8)
            line.state.received += len(data)
            if line.state.unsent:
                self.write(b"")

    def check(self) -> None:
        """Raise the DeviceError of a problem that compiled code found."""
        if self.line.state.problem:
            disconnected = self.line.state.problem == DISCONNECTED
            raise self._gone(OSError("hung up") if disconnected else TimeoutError("it accepts no data"))

    def read(self) -> bytes:
        """All bytes that have arrived, possibly none. Does not wait."""
        try:
            return bytes(self._serial.read(max(1, self._serial.in_waiting)))  # reading 1 byte detects a disconnection
        except GONE as error:
            raise self._gone(error) from None

    def write(self, data: bytes) -> None:
        """Send a message. Messages stay complete: bytes that the port did not accept precede the next message.

        Raises:
            DeviceError: the port was disconnected, or accepted nothing for `WRITE_S`.
        """
        try:
            self._put(data, WRITE_S)
        except GONE as error:
            raise self._gone(error) from None

    def flush(self) -> None:
        """Wait until all bytes have been sent."""
        try:
            self._serial.flush()
        except GONE as error:
            raise self._gone(error) from None

    def close(self, last: bytes = b"") -> None:
        """Send a last message, and close the port. Raises nothing; may be called twice."""
        with suppress(*GONE):
            if last:
                self._put(last, CLOSE_S)
        with suppress(*GONE):
            self._serial.close()

    def _put(self, data: bytes, timeout_s: float) -> None:
        line = self.line
        self._unsent += line.output[: line.state.unsent].tobytes() + data
        line.state.unsent = 0
        end_s = self._clock.now_s() + timeout_s
        while self._unsent:
            if os.name == "posix":
                with suppress(BlockingIOError):
                    self._unsent = self._unsent[os.write(self._serial.fileno(), self._unsent) :]
            else:
                self._serial.write(self._unsent)
                self._unsent = b""
            if self._unsent:
                if self._clock.now_s() > end_s:
                    raise TimeoutError("it accepts no data")
                self._clock.sleep_s(5e-4)

    def _gone(self, error: BaseException) -> DeviceError:
        return DeviceError(f"{self.name}: disconnected ({error}); reconnect it")
