"""Memory that the application and the servo share. Each field has one writer.

The application writes the targets of the hand and the frames of bodies. The servo writes the number of complete ticks
and, to ring buffers, their rows. Numbers of 8 bytes are written atomically; longer fields have a counter that is odd
while the field is being written (sequence lock).
"""

import errno
import math
import os
import sys
from dataclasses import dataclass, fields
from multiprocessing.shared_memory import SharedMemory
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.contact.prediction import FRAME
from hapscene.device.driver import DEVICE_STATE
from hapscene.errors import HapsceneError
from hapscene.loop.driver import AIM, CHANNEL
from hapscene.loop.result import LOOP_ROW
from hapscene.records import ROW, Records

__all__ = ["Channel", "open_channel", "read_text", "write_text"]

CHECKPOINT_COUNT: Final = 8
"""Number of checkpoints in the ring buffer [count]: one minute, and one in progress."""

MEMORY_B: Final = 294_912
"""Size of a checkpoint for one tool [bytes]: 200 bodies, copied in 20 µs. With more bodies a log cannot be replayed."""

TEXT_MAX: Final = 512
"""Size of a message [bytes]."""


def write_text(room: NDArray[np.uint8], text: str) -> None:
    """Write a message (UTF-8) for `read_text`, truncated to the room."""
    raw = np.frombuffer(text.encode()[: len(room) - 1], np.uint8)
    room[len(raw) :] = 0
    room[: len(raw)] = raw


def read_text(room: NDArray[np.uint8]) -> str:
    """Return the message that `write_text` wrote."""
    return bytes(room).rstrip(b"\0").decode(errors="ignore")


@dataclass(frozen=True, eq=False)
class Channel:
    """The shared memory and views of its fields. The ring buffers hold `length` ticks."""

    channel: Records  # (1,) CHANNEL
    aims: Records  # (tools,) AIM, written by the application
    rows: Records  # (tools, length) ROW
    loop_rows: Records  # (tools, length) LOOP_ROW
    a_m_s2: NDArray[np.float64]  # (tools, length, block) desired acceleration
    a_handle_m_s2: NDArray[np.float64]  # (tools, length, block) acceleration of the handle
    frames: Records  # (bodies,) FRAME, written by the application
    moving: NDArray[np.int64]  # (bodies,) indices of moving bodies, written by the application
    impulse: NDArray[np.float64]  # (tools, bodies, 6) as `World.impulse`, written by the servo
    checkpoints: NDArray[np.uint8]  # (CHECKPOINT_COUNT, room) state of ticks, tool after tool
    checkpoint_ticks: NDArray[np.int64]  # (CHECKPOINT_COUNT,) tick of each checkpoint; −1: incomplete
    states: Records  # (tools,) DEVICE_STATE of real devices
    fault: NDArray[np.uint8]  # (TEXT_MAX,) why a device failed; empty without a fault
    notice: NDArray[np.uint8]  # (TEXT_MAX,) other messages of devices
    memory: SharedMemory  # last field, so that it is released after the views

    def close(self, unlink: bool) -> None:
        """Release the memory. The views must not be used afterwards."""
        for name in (field.name for field in fields(self) if field.name != "memory"):
            object.__setattr__(self, name, None)
        try:
            self.memory.close()
        except BufferError:  # a view is still in use: the memory is released with the process
            # otherwise its destructor would try again and warn
            self.memory._buf = self.memory._mmap = None  # type: ignore[attr-defined]
        if unlink:
            self.memory.unlink()


def open_channel(length: int, block: int, name: str | None = None, *, bodies: int = 0, tools: int = 1) -> Channel:
    """Create a zeroed block for this many ticks, samples, bodies and tools, or open an existing one by name.

    Raises:
        HapsceneError: the system has no room for a new block.
    """
    number = np.dtype("f8")
    parts: list[tuple[np.dtype[np.generic], tuple[int, ...]]] = [
        (CHANNEL, (1,)),
        (AIM, (tools,)),
        (ROW, (tools, length)),
        (LOOP_ROW, (tools, length)),
        (number, (tools, length, block)),
        (number, (tools, length, block)),
        (FRAME, (bodies,)),
        (np.dtype("i8"), (bodies,)),
        (number, (tools, bodies, 6)),
        (np.dtype("u1"), (CHECKPOINT_COUNT, tools * MEMORY_B)),
        (np.dtype("i8"), (CHECKPOINT_COUNT,)),
        (DEVICE_STATE, (tools,)),
        (np.dtype("u1"), (TEXT_MAX,)),
        (np.dtype("u1"), (TEXT_MAX,)),
    ]
    starts = np.cumsum([0, *(dtype.itemsize * math.prod(shape) for dtype, shape in parts)])
    memory = _reserved(int(starts[-1])) if name is None else SharedMemory(name)
    views: list[Any] = []
    for (dtype, shape), start in zip(parts, starts[:-1].tolist(), strict=True):
        flat = np.frombuffer(cast(memoryview, memory.buf), dtype, math.prod(shape), start)
        views.append((flat.view(np.recarray) if dtype.fields else flat).reshape(shape))
    names = [field.name for field in fields(Channel)]
    return Channel(**dict(zip(names, (*views, memory), strict=True)))


SYSTEM_FOLDER: Final = "/dev/shm"
"""Folder of shared memory on Linux."""


def _reserved(size: int) -> SharedMemory:
    """Create a block whose pages are allocated now: to touch a page that was only promised kills the process."""
    memory = None
    try:
        memory = SharedMemory(create=True, size=size)
        if sys.platform == "linux":
            os.posix_fallocate(memory._fd, 0, size)  # type: ignore[attr-defined]
    except OSError as error:
        if memory is not None:
            memory.close()
            memory.unlink()
        raise HapsceneError(f"the servo needs {size:,} bytes of shared memory: {_shortage(error)}") from None
    return memory


def _shortage(error: OSError) -> str:
    """Return why the system has no shared memory, and how to provide it."""
    if sys.platform == "linux" and error.errno == errno.ENOSPC:
        system = os.statvfs(SYSTEM_FOLDER)
        return (
            f"{SYSTEM_FOLDER} has {system.f_bavail * system.f_frsize:,} bytes free. Enlarge it (docker run "
            f"--shm-size=256m, or mount -o remount,size=256m {SYSTEM_FOLDER}), or end other programs that use it"
        )
    if sys.platform == "linux" and error.errno in (errno.EROFS, errno.ENOENT, errno.EACCES):
        return (
            f"{SYSTEM_FOLDER} must exist and be writable ({error.strerror}): run mount -t tmpfs tmpfs {SYSTEM_FOLDER}"
        )
    return f"the system provides none: {error.strerror}"
