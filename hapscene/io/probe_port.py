"""A serial port that is read by a dedicated thread, so that a slow disk or terminal causes no lost samples."""

import errno
import os
import queue
import threading
from contextlib import suppress
from typing import Final

from hapscene.errors import CaptureError
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["BAUD", "LUMP_S", "POLL_S", "DrainedPort", "Port"]

BAUD: Final = 921_600
"""Default baud rate [bit/s]: the highest that all common USB bridges support; enough for one column at 5 kHz."""

POLL_S: Final = 0.05
"""Maximum time for a read [s], after which a stop is noticed."""

LUMP_S: Final = 2e-3
"""Time to collect bytes after the first one [s]. Without it every byte would wake the thread; the 4 kB buffer of Linux
suffices up to 2 MB/s."""


class DrainedPort:
    """Base class: a thread that reads data into a queue."""

    def __init__(self, clock: Clock = CLOCK) -> None:
        """Start the thread; `clock` provides the time stamps."""
        self._clock = clock
        self._pieces: queue.SimpleQueue[tuple[bytes, float] | str] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._drain, name="hapscene probe", daemon=True)
        self._thread.start()

    def _drain(self) -> None:
        """Read data with time stamps into the queue until closing; finally the reason if the port is lost."""
        raise NotImplementedError

    def next(self) -> tuple[bytes, float] | str | None:
        """Return data and arrival time; None if nothing arrived within `POLL_S`; a reason if the port is lost."""
        with suppress(queue.Empty):
            return self._pieces.get(timeout=POLL_S)
        return None

    def close(self) -> None:
        """Stop the thread."""
        self._closing.set()
        self._thread.join()


class Port(DrainedPort):
    """A serial port that a thread reads into a queue."""

    def __init__(self, name: str, baud: int, clock: Clock = CLOCK) -> None:
        """Open the port.

        Raises:
            CaptureError: no such port, no permission, or the port is in use.
        """
        import serial

        exclusive = True if os.name == "posix" else None
        try:
            self._serial = serial.Serial(name, baud, timeout=POLL_S, exclusive=exclusive)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise CaptureError(f"{name}: cannot open the port: {_reason(error)}{_ports()}") from None
        super().__init__(clock)

    def _drain(self) -> None:
        try:
            while not self._closing.is_set():
                data = self._serial.read(1)
                if not data:
                    continue
                self._closing.wait(LUMP_S)
                self._pieces.put((data + self._serial.read(self._serial.in_waiting), self._clock.now_s()))
        except (OSError, TypeError) as error:  # pyserial raises TypeError when the port closes under it
            self._pieces.put(_reason(error))

    def close(self) -> None:
        """Stop the thread and close the port."""
        super().close()
        self._serial.close()


def _reason(error: BaseException) -> str:
    """Return the reason of a pyserial error."""
    if isinstance(error, OSError) and error.errno in (errno.EAGAIN, errno.EBUSY):
        return "another program uses it"
    if isinstance(error, OSError) and error.errno and error.strerror:
        return os.strerror(error.errno).lower()
    return " ".join(str(error).split())


def _ports() -> str:
    """Return a list of the available ports for messages."""
    from serial.tools.list_ports import comports

    names = sorted(port.device for port in comports())
    return f"; available ports: {', '.join(names)}" if names else "; there is no serial port"
