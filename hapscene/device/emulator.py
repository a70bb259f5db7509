"""Emulated devices with fault injection, to develop and check a driver without hardware.

Derive from `Emulator`: state the size of a message, its force, and the answer to it. `serve` runs the emulator in a
thread, behind a virtual serial port (a pseudo-terminal) or a UDP socket. The driver opens it like the real device.
"""

import math
import os
import random
import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final, Literal

from hapscene.errors import DeviceError
from hapscene.geometry import Vector

__all__ = ["FAULTS", "Emulator", "serve"]

FAULTS: Final = ("silence", "truncated", "nan", "random", "jump")
"""Faults of an emulator: no answers, answers cut in half, NaN as position, random bytes, jumps of the position by
10 cm."""

HAND_N_m: Final = 300.0
"""Stiffness of the hand that holds the emulated device [N/m]."""

JUMP_M: Final = 0.1

WAIT_S: Final = 0.02
"""Interval at which the thread checks for its end [s]."""


class Emulator:
    """Base class of an emulated device that answers each message with its position.

    A hand holds the device like a spring, so that its position is the force divided by 300 N/m.

    Attributes:
        transport: "serial" or "udp".
        fault: one of `FAULTS`; empty for a device that works.
        last_N: last force that was received (3,).
        largest_N: largest force magnitude since this attribute was set to 0; infinite after NaN.
        message_count: number of messages that were received.
    """

    transport: Literal["serial", "udp"] = "serial"

    def __init__(self) -> None:
        self.fault = ""
        self.last_N: Vector = (0.0, 0.0, 0.0)
        self.largest_N = 0.0
        self.message_count = 0
        self._unread, self._random = b"", random.Random(7)

    def message_size(self, data: bytes) -> int:
        """Number of bytes of the message at the start of `data`, which is not empty."""
        raise NotImplementedError

    def force_N(self, message: bytes) -> Vector | None:
        """Force that a message commands, in the device frame [N]; None for a message without a force."""
        raise NotImplementedError

    def answer(self, message: bytes, position_m: Vector) -> bytes:
        """Answer to a message. `position_m` is in the device frame, and NaN in the fault "nan"."""
        raise NotImplementedError

    def receive(self, data: bytes) -> bytes:
        """Process received bytes, which may contain parts of messages. Returns the answers."""
        self._unread += data
        answers = b""
        while self._unread and len(self._unread) >= (size := self.message_size(self._unread)):
            message, self._unread = self._unread[:size], self._unread[size:]
            self.message_count += 1
            force = self.force_N(message)
            if force is not None:
                self.last_N = force
                norm_N = math.hypot(*force)
                self.largest_N = max(self.largest_N, math.inf if math.isnan(norm_N) else norm_N)
            answers += self._answer(message)
        return answers

    def _answer(self, message: bytes) -> bytes:
        """The answer, as the fault changes it."""
        x, y, z = (part / HAND_N_m for part in self.last_N)
        if self.fault == "nan":
            x = y = z = math.nan
        if self.fault == "jump" and self.message_count % 20 < 10:
            x += JUMP_M
        try:
            answer = self.answer(message, (x, y, z))
        except (ValueError, OverflowError):  # integers cannot represent NaN
            answer = self._random.randbytes(8)
        if self.fault == "silence":
            return b""
        if self.fault == "truncated":
            return answer[: len(answer) // 2]
        return self._random.randbytes(len(answer)) if self.fault == "random" else answer


@contextmanager
def serve(emulator: Emulator) -> Iterator[dict[str, str | int]]:
    """Run an emulator in a thread for the duration of the block.

    Yields:
        The options with which a driver finds it: `port` of a serial device, `host` and `port` of a UDP device.

    Raises:
        DeviceError: the system has no pseudo-terminals (Windows).
    """
    end = threading.Event()
    if emulator.transport == "udp":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.bind(("127.0.0.1", 0))
            host, port = link.getsockname()
            with _running(lambda: _answer_packet(emulator, link), link.fileno(), end):
                yield {"host": host, "port": port}
        return
    if not hasattr(os, "openpty"):
        raise DeviceError("this system has no pseudo-terminals: check the driver on Linux or macOS, or emulate UDP")
    import tty

    ours, theirs = os.openpty()  # `theirs` stays open, so that the driver can open and close the port repeatedly
    tty.setraw(theirs)
    try:
        with _running(lambda: _write_all(ours, emulator.receive(os.read(ours, 4096))), ours, end):
            yield {"port": os.ttyname(theirs)}
    finally:
        os.close(theirs)
        os.close(ours)


@contextmanager
def _running(take: Callable[[], None], file: int, end: threading.Event) -> Iterator[None]:
    """Call `take` in a thread whenever the file has data."""

    def run() -> None:
        while not end.is_set():
            if select.select([file], [], [], WAIT_S)[0]:
                take()

    thread = threading.Thread(target=run, name="hapscene emulator", daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def _write_all(file: int, data: bytes) -> None:
    while data:
        data = data[os.write(file, data) :]


def _answer_packet(emulator: Emulator, link: socket.socket) -> None:
    with suppress(ConnectionError):  # on Windows, a driver that has closed its socket resets the connection
        data, sender = link.recvfrom(65_536)
        answer = emulator.receive(data)
        if answer:
            link.sendto(answer, sender)
