"""The block that application and servo share: one layout for both, zeroed, whose parts do not overlap."""

from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import pytest

from hapscene.loop.shared_memory import CHANNEL, Channel, open_channel

PARTS = ("channel", "aims", "rows", "loop_rows", "a_m_s2", "a_handle_m_s2", "frames", "moving", "impulse")


@pytest.fixture
def both() -> Iterator[tuple[Channel, Channel]]:
    """Who made the block, and who has opened it by its name."""
    ours = open_channel(5, 3, bodies=2, tools=4)
    theirs = open_channel(5, 3, ours.memory.name, bodies=2, tools=4)
    yield ours, theirs
    theirs.close(unlink=False)
    ours.close(unlink=True)


def test_a_new_block_is_zero_and_holds_as_many_ticks_as_were_asked_for(both: tuple[Channel, Channel]) -> None:
    ours, _ = both
    rings = [(4, 5)] * 2 + [(4, 5, 3)] * 2
    assert [getattr(ours, part).shape for part in PARTS] == [(1,), (4,), *rings, (2,), (2,), (4, 2, 6)]
    assert not any(getattr(ours, part).tobytes().strip(b"\0") for part in PARTS)


def test_what_one_writes_the_other_reads_and_no_part_lies_in_another(both: tuple[Channel, Channel]) -> None:
    ours, theirs = both
    for i, part in enumerate(PARTS):
        getattr(ours, part).view(np.ndarray).view(np.uint8)[:] = i + 1
    for i, part in enumerate(PARTS):
        assert set(getattr(theirs, part).tobytes()) == {i + 1}


@pytest.mark.parametrize("part", [*CHANNEL.names, *PARTS[1:]])
def test_every_number_of_8_bytes_is_written_whole(both: tuple[Channel, Channel], part: str) -> None:
    """So no lock is needed: it lies on a multiple of its size."""
    channel = both[0].channel
    place = channel[part] if part in CHANNEL.names else getattr(both[0], part)
    assert place.__array_interface__["data"][0] % 8 == 0


def test_a_closed_block_is_gone(both: tuple[Channel, Channel]) -> None:
    channel = open_channel(2, 1)
    name = channel.memory.name
    channel.close(unlink=True)
    assert all(getattr(channel, part) is None for part in PARTS)
    with pytest.raises(FileNotFoundError):
        SharedMemory(name)
