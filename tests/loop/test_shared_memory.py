"""Memory shared by application and servo: one layout for both, initially zero, without overlapping fields."""

from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import pytest

from hapscene.loop.shared_memory import CHANNEL, Channel, open_channel

PARTS = ("channel", "aims", "rows", "loop_rows", "a_m_s2", "a_handle_m_s2", "frames", "moving", "impulse")


@pytest.fixture
def both() -> Iterator[tuple[Channel, Channel]]:
    """The creator of the block, and a process that opened it by name."""
    ours = open_channel(5, 3, bodies=2, tools=4)
    theirs = open_channel(5, 3, ours.memory.name, bodies=2, tools=4)
    yield ours, theirs
    theirs.close(unlink=False)
    ours.close(unlink=True)


def test_fields_are_shared_and_do_not_overlap(both: tuple[Channel, Channel]) -> None:
    ours, theirs = both
    for i, part in enumerate(PARTS):
        getattr(ours, part).view(np.ndarray).view(np.uint8)[:] = i + 1
    for i, part in enumerate(PARTS):
        assert set(getattr(theirs, part).tobytes()) == {i + 1}


@pytest.mark.parametrize("part", [*CHANNEL.names, *PARTS[1:]])
def test_fields_are_aligned_to_8_bytes(both: tuple[Channel, Channel], part: str) -> None:
    """Aligned numbers are written atomically, so that no lock is needed."""
    channel = both[0].channel
    place = channel[part] if part in CHANNEL.names else getattr(both[0], part)
    assert place.__array_interface__["data"][0] % 8 == 0


def test_closed_block_is_released(both: tuple[Channel, Channel]) -> None:
    channel = open_channel(2, 1)
    name = channel.memory.name
    channel.close(unlink=True)
    assert all(getattr(channel, part) is None for part in PARTS)
    with pytest.raises(FileNotFoundError):
        SharedMemory(name)
