"""Serial ports for drivers: search, exclusive access, reads that never wait, and messages that stay complete."""

import errno
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from hapscene.device.driver import Found
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock

try:
    from termios import error as PortError
except ImportError:  # Windows has none
    PortError = OSError  # type: ignore[misc,assignment]

__all__ = ["SERIAL_MODULES", "SerialPort", "chosen_port", "find_ports"]

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


class SerialPort:
    """An open serial port. Every error is a `DeviceError` that starts with `name`.

    Attributes:
        name: name of the driver and of the port, for messages.
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
        try:
            exclusive = True if alone and os.name == "posix" else None
            self._serial: Any = serial.Serial(port, baud, timeout=0.0, write_timeout=WRITE_S, exclusive=exclusive)
        except (OSError, ValueError) as error:
            if getattr(error, "errno", None) == errno.EAGAIN:  # another process holds the lock
                raise DeviceError(f"{self.name}: in use; close the other program that uses it") from None
            remedy = f"; {PERMISSION}" if getattr(error, "errno", None) == errno.EACCES else ""
            raise DeviceError(f"{self.name}: cannot be opened: {error}{remedy}") from None

    def read(self) -> bytes:
        """All bytes that have arrived, possibly none. Does not wait."""
        try:
            return bytes(self._serial.read(max(1, self._serial.in_waiting)))  # reading 1 byte detects a disconnection
        except GONE as error:
            raise self._gone(error) from None

    def discard_input(self) -> None:
        """Discard all bytes that have arrived: those from before a pause, or after a lost synchronisation."""
        try:
            self._serial.reset_input_buffer()
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
            if self._serial.is_open and last:
                self._put(last, CLOSE_S)
        with suppress(*GONE):
            self._serial.close()

    def _put(self, data: bytes, timeout_s: float) -> None:
        self._unsent += data
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
