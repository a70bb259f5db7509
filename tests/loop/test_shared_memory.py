"""Memory shared by application and servo: one layout for both, initially zero, without overlapping fields."""

import errno
import os
import sys
from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory
from types import SimpleNamespace

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.loop import shared_memory
from hapscene.loop.shared_memory import CHANNEL, Channel, open_channel, read_text, write_text

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


def test_a_message_is_truncated_to_its_room() -> None:
    room = np.zeros(8, np.uint8)
    for text, kept in (("0123456789", "0123456"), ("äöüß", "äöü"), ("ab", "ab"), ("", "")):
        write_text(room, text)
        assert read_text(room) == kept and room[-1] == 0


@pytest.mark.skipif(sys.platform != "linux", reason="only there is the memory allocated at once")
@pytest.mark.parametrize(
    ("number", "says"),
    [(errno.ENOSPC, "30 bytes free"), (errno.EROFS, "mount -t tmpfs"), (errno.EPERM, "the system provides none")],
)
def test_missing_memory_is_reported_and_returned(number: int, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    names, real = list[str](), SharedMemory

    def make(*, create: bool, size: int) -> SharedMemory:
        memory = real(create=create, size=size)
        names.append(memory.name)
        return memory

    def allocate(fd: int, start: int, size: int) -> None:
        assert (start, size) == (0, os.fstat(fd).st_size)
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(shared_memory, "SharedMemory", make)
    monkeypatch.setattr(os, "posix_fallocate", allocate)
    monkeypatch.setattr(os, "statvfs", lambda folder: SimpleNamespace(f_bavail=3, f_frsize=10))
    with pytest.raises(HapsceneError, match=says):
        open_channel(2, 1)
    with pytest.raises(FileNotFoundError):
        real(names[0])
