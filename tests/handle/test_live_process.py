"""A handle that plays live in its own process: fed by a real channel, on a board at a pseudo-terminal."""

import os
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest

from hapscene.device.safety import HEARTBEAT_AGE_S
from hapscene.errors import HandleError, HapsceneError
from hapscene.handle import live_process
from hapscene.handle.live_process import ChannelSource, LiveHandle, open_output
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.loop.watchdog import STILL_S
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
        LiveHandle(where(channel), 1e4, 0, 1, "serial", {"port": "/dev/none"})


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
    source = ChannelSource(channel, 0, (1, 2), VirtualClock())
    channel.a_m_s2[0, 3:5] = np.arange(20.0).reshape(2, 10)
    assert len(source.fetch(99)) == 0  # what is complete
    channel.channel[0].done = 5
    np.testing.assert_array_equal(source.fetch(0), np.arange(20.0))
    channel.channel[0].done = 5 + 2 * LENGTH  # it stood still
    assert len(source.fetch(0)) == LENGTH // 2 * BLOCK
    channel.channel[0].done = 0  # another servo's count
    assert len(source.fetch(0)) == 0


@pytest.mark.parametrize(
    ("sign", "state", "silent_s"),
    [
        ("heartbeat", "running", HEARTBEAT_AGE_S),  # it hangs
        ("heartbeat", "ending", STILL_S),
        ("done", "ending", STILL_S),
        ("done", "running", 0.05),  # late ticks are no end
    ],
)
def test_no_samples_without_heartbeat_or_ticks(
    channel: Channel, sign: str, state: str, silent_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, row, pids = VirtualClock(), channel.channel[0], {"heartbeat": 7, "done": 8}
    monkeypatch.setattr(live_process, "state_of", lambda pid: state if pid == pids[sign] else "running")
    source = ChannelSource(channel, 0, (7, 8), clock)

    def fetched(standing: str = "") -> int:
        """In how many of 50 ms there are samples."""
        count = 0
        for _ in range(50):
            row.heartbeat += standing != "heartbeat"
            row.done += standing != "done"
            clock.sleep_s(1e-3)
            count += source.fetch(0) is not None
        return count

    assert fetched() == 50 and 1e-3 * fetched(sign) == pytest.approx(silent_s, abs=1.1e-3)
    assert fetched() == 50  # it goes on
    row.stop_force = 1
    assert fetched() == 0
