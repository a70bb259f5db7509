"""A handle that plays live in its own process: fed by a real channel, on a board at a pseudo-terminal."""

import os
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest

from hapscene.errors import HandleError, HapsceneError
from hapscene.handle.live_process import ChannelSource, LiveHandle, open_output
from hapscene.loop.shared_memory import Channel, open_channel
from tests.virtual_clock import VirtualClock

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")

LENGTH, BLOCK = 4000, 10


@pytest.fixture
def channel() -> Iterator[Channel]:
    channel = open_channel(LENGTH, BLOCK)
    yield channel
    channel.close(unlink=False)
    with suppress(FileNotFoundError):  # the tracker of a process that was killed has done so
        channel.memory.unlink()


def where(channel: Channel) -> dict[str, object]:
    return {"length": LENGTH, "block": BLOCK, "name": channel.memory.name}


def test_error_of_the_handle_reaches_the_application(channel: Channel) -> None:
    with pytest.raises(HandleError, match="/dev/none: cannot open the port"):
        LiveHandle(where(channel), 1e4, 0, "serial", {"port": "/dev/none"})


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("spoon", {}, "no device 'spoon'; there are: audio"),
        ("simulated", {}, "simulated"),
        ("serial", {"prot": "x"}, "no option 'prot'; there are: .*port"),
        ("serial", {"limit_N": "much"}, "limit_N=much"),
        ("serial", {}, "option port"),
        ("usb", {"id": "teensy"}, "id=teensy"),
    ],
)
def test_invalid_outputs_and_options_are_errors(name: str, options: dict[str, str], words: str) -> None:
    with pytest.raises(HapsceneError, match=words):
        open_output(name, options)


def test_each_new_tick_is_read_once(channel: Channel) -> None:
    channel.channel[0].done = 3
    source = ChannelSource(channel, 0)
    channel.a_m_s2[0, 3:5] = np.arange(20.0).reshape(2, 10)
    assert len(source.fetch(99)) == 0  # what is complete
    channel.channel[0].done = 5
    np.testing.assert_array_equal(source.fetch(0), np.arange(20.0))
    channel.channel[0].done = 5 + 2 * LENGTH  # it stood still
    assert len(source.fetch(0)) == LENGTH // 2 * BLOCK
    channel.channel[0].done = 0  # another servo's count
    assert len(source.fetch(0)) == 0
    source.close()


def test_no_samples_while_the_application_is_silent(channel: Channel) -> None:
    clock, row = VirtualClock(), channel.channel[0]
    source = ChannelSource(channel, 0, clock)

    def samples(ticks: int, beats: int) -> int | None:
        row.done += ticks
        row.heartbeat += beats
        clock.sleep_s(1e-3 * ticks)
        fetched = source.fetch(0)
        return None if fetched is None else len(fetched) // BLOCK

    assert [samples(5, 1) for _ in range(3)] == [5, 5, 5]
    assert [samples(5, 0) for _ in range(4)] == [5, 5, None, None]  # it was stopped: the heartbeat is older than 12 ms
    assert samples(5, 1) == 5
    row.stop_force = 1
    assert samples(5, 1) is None
    source.close()
