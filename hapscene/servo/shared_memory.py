"""What application and servo share: one block of memory, in which each field has one writer.

The application writes where the hand aims; the servo how many ticks are complete and, in rings, what they were. A
number (8 bytes) is written whole; what is longer carries a count that is odd while it is being written.
"""

from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.records import ROW
from hapscene.servo.servo_loop import BIN_COUNT
from hapscene.twin.twin_recording import FELT

CHANNEL: Final = np.dtype(
    [
        # by the application
        ("aim_count", "i8"),  # odd while the aim is being written
        ("aim_W_m", "f8", (3,)),
        ("grip", "f8", (3,)),  # k_N_m, b_Ns_m, mass_kg
        ("push_W_N", "f8", (3,)),
        ("pause", "i8"),  # 1: the loop shall return
        # by the servo
        ("done", "i8"),  # complete ticks
        ("missed", "i8"),  # ticks that were left out since the loop was too late for them
        ("late", "i8", (BIN_COUNT,)),  # histogram of how late ticks began
        ("busy", "i8", (BIN_COUNT,)),  # and of how long they took
    ],
    align=True,
)


@dataclass(frozen=True, eq=False)
class Channel:
    """The shared block, and views of its parts. `length` ticks fit into the rings, then they are written over."""

    memory: SharedMemory
    channel: Any  # (1,) CHANNEL
    rows: Any  # (length,) ROW
    felt: Any  # (length,) FELT
    a_m_s2: NDArray[np.float64]  # (length, block) asked for
    a_handle_m_s2: NDArray[np.float64]  # (length, block) of the handle

    def close(self, unlink: bool) -> None:
        """Let go of the memory. The views must not be used afterwards."""
        for name in ("channel", "rows", "felt", "a_m_s2", "a_handle_m_s2"):
            object.__setattr__(self, name, None)
        self.memory.close()
        if unlink:
            self.memory.unlink()


def open_channel(length: int, block: int, name: str | None = None) -> Channel:
    """A new block, or, by its name, one that is there."""
    sizes = [CHANNEL.itemsize, length * ROW.itemsize, length * FELT.itemsize, *[length * block * 8] * 2]
    starts = np.concatenate(([0], np.cumsum(sizes)))
    memory = SharedMemory(name=name, create=name is None, size=int(starts[-1]))
    dtypes = (CHANNEL, ROW, FELT, np.dtype("f8"), np.dtype("f8"))
    parts = [
        np.frombuffer(cast(memoryview, memory.buf), dtype, size // dtype.itemsize, int(start))
        for dtype, size, start in zip(dtypes, sizes, starts[:-1], strict=True)
    ]
    if name is None:
        for part in parts:
            part.view(np.uint8)[:] = 0
    records = [part.view(np.recarray) for part in parts[:3]]
    return Channel(memory, *records, *(part.reshape(length, block) for part in parts[3:]))
