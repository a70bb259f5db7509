"""What application and servo share: one block of memory, in which each field has one writer.

The application writes where the hand aims; the servo how many ticks are complete and, in rings, what they were. A
number (8 bytes) is written whole; what is longer carries a count that is odd while it is being written.
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
from hapscene.loop.result import FELT
from hapscene.records import ROW

__all__ = ["Channel", "open_channel", "read_text", "write_text"]

CHECKPOINT_COUNT: Final = 8
"""Copies that are kept of what ticks remember [count]: the newest minute, and one more."""

MEMORY_B: Final = 294_912
"""Room in each for a tool [bytes]: 200 bodies. Copied in 20 µs; with more bodies a log cannot be replayed."""

TEXT_MAX: Final = 512
"""Room for a sentence [bytes]."""


def write_text(room: NDArray[np.uint8], text: str) -> None:
    """Write a sentence (UTF-8) where `read_text` finds it, cut where it is too long."""
    raw = np.frombuffer(text.encode()[: len(room) - 1], np.uint8)
    room[len(raw) :] = 0
    room[: len(raw)] = raw


def read_text(room: NDArray[np.uint8]) -> str:
    """The sentence that was written there."""
    return bytes(room).rstrip(b"\0").decode(errors="ignore")


@dataclass(frozen=True, eq=False)
class Channel:
    """The shared block, and views of its parts. `length` ticks fit into the rings, then they are written over."""

    channel: Any  # (1,) CHANNEL
    aims: Any  # (tools,) AIM, by the application
    rows: Any  # (tools, length) ROW
    felt: Any  # (tools, length) FELT
    a_m_s2: NDArray[np.float64]  # (tools, length, block) asked for
    a_handle_m_s2: NDArray[np.float64]  # (tools, length, block) of the handle
    frames: Any  # (bodies,) FRAME, by the application
    moving: NDArray[np.int64]  # (bodies,) indices of those it moves, likewise
    impulse: NDArray[np.float64]  # (tools, bodies, 6) as `World.impulse`, by the servo
    checkpoints: NDArray[np.uint8]  # (CHECKPOINT_COUNT, room) what ticks remembered, tool after tool
    checkpoint_ticks: NDArray[np.int64]  # (CHECKPOINT_COUNT,) before which tick; −1: nothing that is whole
    states: Any  # (tools,) DEVICE_STATE of real devices
    fault: NDArray[np.uint8]  # (TEXT_MAX,) why a device is gone, by the servo; empty where none is
    notice: NDArray[np.uint8]  # (TEXT_MAX,) what troubles it otherwise, likewise
    memory: SharedMemory  # the last: where nobody closes it, it goes after its views, or else complains of them

    def close(self, unlink: bool) -> None:
        """Let go of the memory. The views must not be used afterwards."""
        for name in (field.name for field in fields(self) if field.name != "memory"):
            object.__setattr__(self, name, None)
        try:
            self.memory.close()
        except BufferError:  # somebody still looks at it: it goes with the process
            self.memory._buf = self.memory._mmap = None  # type: ignore[attr-defined]  # else it tries again, and complains
        if unlink:
            self.memory.unlink()


def open_channel(length: int, block: int, name: str | None = None, *, bodies: int = 0, tools: int = 1) -> Channel:
    """A new block, all 0, for so many ticks, samples, bodies and tools; or, by its name, one that is there.

    Raises:
        HapsceneError: the system has no room for a new one, or no place.
    """
    number = np.dtype("f8")
    parts: list[tuple[np.dtype[Any], tuple[int, ...]]] = [
        (CHANNEL, (1,)),
        (AIM, (tools,)),
        (ROW, (tools, length)),
        (FELT, (tools, length)),
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
"""Where Linux keeps shared memory."""


def _reserved(size: int) -> SharedMemory:
    """A new block whose pages are there: where they are only promised, touching one too many kills the process."""
    memory = None
    try:
        memory = SharedMemory(create=True, size=size)
        if sys.platform == "linux":
            os.posix_fallocate(memory._fd, 0, size)  # type: ignore[attr-defined]
    except OSError as error:
        if memory is not None:
            memory.close()
            memory.unlink()
        raise HapsceneError(f"the servo needs {size:,} bytes of shared memory; {_lack(error)}") from None
    return memory


def _lack(error: OSError) -> str:
    """Why there is none, and what would have worked."""
    if sys.platform == "linux" and error.errno == errno.ENOSPC:
        system = os.statvfs(SYSTEM_FOLDER)
        return (
            f"{SYSTEM_FOLDER} has {system.f_bavail * system.f_frsize:,} left: make it larger (docker run "
            f"--shm-size=256m, mount -o remount,size=256m {SYSTEM_FOLDER}), or end what else uses it"
        )
    if sys.platform == "linux" and error.errno in (errno.EROFS, errno.ENOENT, errno.EACCES):
        return f"{SYSTEM_FOLDER} must be there and be writable (mount -t tmpfs tmpfs {SYSTEM_FOLDER}): {error.strerror}"
    return f"the system gives none: {error.strerror}"
