"""A serial port, drained by a thread that does nothing else: a slow disk or terminal costs no samples."""

import errno
import os
import queue
import threading
from contextlib import suppress
from typing import Any, Final

from hapscene.errors import CaptureError
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["BAUD", "LUMP_S", "POLL_S", "DrainedPort", "Port"]

BAUD: Final = 921_600
"""Default speed of a port [bit/s]: the highest that all common USB bridges do; 5 kHz of one column fit through."""

POLL_S: Final = 0.05
"""Longest wait for bytes [s]: half the period of the level meter."""

LUMP_S: Final = 2e-3
"""How long bytes are let gather once the first is there [s]. Without it every byte wakes the thread; the 4 kB that
Linux holds in front of a reader last for 2 MB/s."""


class DrainedPort:
    """What a thread of its own drains into a queue."""

    def __init__(self, clock: Clock = CLOCK) -> None:
        """Begins to drain; `clock` says when something came."""
        self._clock = clock
        self._pieces: queue.SimpleQueue[tuple[bytes, float] | str] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._drain, name="hapscene probe", daemon=True)
        self._thread.start()

    def _drain(self) -> None:
        """Puts what comes, and when, into the queue until it shall close; as its last the reason why it is gone."""
        raise NotImplementedError

    def next(self) -> tuple[bytes, float] | str | None:
        """What the port gave; None where it gave nothing for a while; a text, why, when it is gone."""
        with suppress(queue.Empty):
            return self._pieces.get(timeout=POLL_S)
        return None

    def close(self) -> None:
        """Stops the thread."""
        self._closing.set()
        self._thread.join()


class Port(DrainedPort):
    """A serial port that a thread of its own drains into a queue."""

    def __init__(self, name: str, baud: int, clock: Clock = CLOCK) -> None:
        """Opens the port.

        Raises:
            CaptureError: no such port, no permission, in use.
        """
        import serial

        alone = True if os.name == "posix" else None
        try:
            self._serial: Any = serial.Serial(name, baud, timeout=POLL_S, exclusive=alone)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise CaptureError(f"{name}: the port cannot be opened: {_reason(error)}{_ports()}") from None
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
        """Stops the thread, then closes the port."""
        super().close()
        self._serial.close()


def _reason(error: BaseException) -> str:
    """pyserial's reason without its wrapping."""
    if isinstance(error, OSError) and error.errno in (errno.EAGAIN, errno.EBUSY):
        return "another program has it open"
    if isinstance(error, OSError) and error.errno and error.strerror:
        return os.strerror(error.errno).lower()
    return " ".join(str(error).split())


def _ports() -> str:
    """The ports that are there, for a message."""
    from serial.tools.list_ports import comports

    names = sorted(port.device for port in comports())
    return f"; there are: {', '.join(names)}" if names else "; no serial port is there"
