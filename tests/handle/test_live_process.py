"""A handle that plays live in its own process: fed by a real channel, on a board at a pseudo-terminal."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.device.safety import HEARTBEAT_AGE_S
from hapscene.errors import HandleError, HapsceneError
from hapscene.handle import live_process
from hapscene.handle.fit import Identification, IdentifiedGrip
from hapscene.handle.handle_file import save_handle
from hapscene.handle.live_process import ChannelSource, LiveHandle, compensator_of, open_output, play_recording
from hapscene.handle.live_stream import FADE_S
from hapscene.handle.plant import Plant
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.loop.watchdog import STILL_S
from tests.virtual_clock import PATIENCE_S, VirtualClock

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


class Output:
    """Levels at 5 kHz. It pulls 20 ms, or less once the stream ends, whenever it is asked for a fault."""

    name, takes_force, reads_back, rate_Hz, latency_s = "fake", False, False, 5000.0, 0.03
    gain, ceiling, highpass_Hz, lag_s = 0.5, 1.0, 0.0, 0.005

    def __init__(self) -> None:
        self.feed: Any = None
        self.error, self.closed, self.stuck = "", 0, False
        self.counts = {"underruns": 2}
        self.samples: list[float] = []

    def start(self, feed: Any) -> None:
        self.feed = feed

    @property
    def fault(self) -> str:
        if self.feed is not None and not self.closed and not self.stuck:
            out = np.zeros(25 if self.feed._state[0].ending else 100)
            self.feed.pull(out)
            self.samples += out.tolist()
        return self.error

    def close(self) -> None:
        self.closed += 1


def test_a_recording_is_played_to_its_end() -> None:
    output, clock, said = Output(), VirtualClock(), []
    begun_s = clock.now_s()
    stream = play_recording(np.full(1000, 0.8), 1e4, output, say=said.append, clock=clock)
    assert said == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0]) and stream.over and output.closed == 1
    assert output.samples[250] == pytest.approx(0.4) and output.samples[-1] == 0.0
    assert clock.now_s() - begun_s == pytest.approx(5 * 0.02 + FADE_S + output.latency_s + FADE_S)


def test_an_output_that_stands_still_or_is_torn_out_is_closed() -> None:
    output, clock = Output(), VirtualClock()

    def stop(share: float) -> None:
        output.stuck = True
        output.feed._state[0].whole += 1000  # as if it had played all

    begun_s = clock.now_s()
    play_recording(np.full(1000, 0.8), 1e4, output, say=stop, clock=clock)
    longest_s = 10.0 * FADE_S + output.latency_s
    assert clock.now_s() - begun_s == pytest.approx(0.02 + longest_s + output.latency_s + FADE_S, abs=0.006)
    assert output.closed == 1
    torn, clock = Output(), VirtualClock()
    with pytest.raises(HandleError, match="torn out"):
        play_recording(np.ones(1000), 1e4, torn, say=lambda share: setattr(torn, "error", "torn out"), clock=clock)
    assert torn.closed == 1 and clock.now_s() - begun_s == pytest.approx(0.02)


@pytest.fixture
def in_a_thread(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The process is a thread of the test. What it asks of the system, in order."""
    made = SimpleNamespace(output=Output(), asked=[])

    def process(target: Any, args: tuple[Any, ...], **named: Any) -> threading.Thread:
        wire = Connection(os.dup(args[0].fileno()))  # as a process has its own
        return threading.Thread(target=target, args=(wire, *args[1:]), **named)

    context = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=process)
    monkeypatch.setattr(multiprocessing, "get_context", lambda kind: context)
    monkeypatch.setattr(live_process, "open_output", lambda *chosen: made.asked.append(chosen) or made.output)
    monkeypatch.setattr(live_process, "ANSWER_S", PATIENCE_S)
    monkeypatch.setattr(live_process, "request_realtime_priority", lambda: made.asked.append("real time"))
    monkeypatch.setattr(signal, "signal", lambda *handler: made.asked.append(handler))
    return made


def test_a_handle_plays_until_it_is_closed(channel: Channel, in_a_thread: SimpleNamespace) -> None:
    output = in_a_thread.output
    handle = LiveHandle(where(channel), 1e4, 0, os.getpid(), "fake", {"port": "x"})
    shown = [handle.report[name] for name in ("output_latency_s", "latency_s", "drift_ppm", "gaps", "underruns")]
    assert shown == [0.03, pytest.approx(0.03 + output.feed.latency_s, abs=2e-3), 0.0, 0, 2]
    output.counts["underruns"] = 3
    handle.set_volume(0.25)
    assert output.feed._state[0].gain == 0.125 and output.feed._state[0].steered == 1 and output.feed.rate_Hz == 1e4
    assert handle.report["underruns"] == 3 == handle.update_report()["underruns"]
    handle.close()
    assert not handle._process.is_alive() and output.feed.over and output.closed
    with pytest.raises(HandleError, match="exited"):
        handle.update_report()
    handle.close()
    ignored = (signal.SIGTERM, signal.SIG_IGN)
    begin = [(signal.SIGINT, signal.SIG_IGN), (signal.SIGTERM, live_process._end), ("fake", {"port": "x"}), "real time"]
    assert in_a_thread.asked == [*begin, ignored]
    with pytest.raises(EOFError):
        live_process._end(signal.SIGTERM, None)
    open_channel(**where(channel)).close(unlink=False)  # the memory is that of the servo


def test_the_fault_of_an_output_reaches_the_application(channel: Channel, in_a_thread: SimpleNamespace) -> None:
    handle = LiveHandle(where(channel), 1e4, 0, os.getpid(), "fake", {})
    in_a_thread.output.error = "torn out"
    handle._process.join()
    with pytest.raises(HandleError, match="torn out"):
        handle.update_report()
    handle.close()
    assert in_a_thread.output.closed


def test_a_process_that_does_not_answer_is_killed(channel: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []

    def process(args: tuple[Any, ...], daemon: bool, **named: Any) -> SimpleNamespace:
        did = {name: lambda name=name: done.append(name) or True for name in ("start", "is_alive", "kill")}
        wire = Connection(os.dup(args[0].fileno()))
        return SimpleNamespace(join=lambda *limit_s: done.append((*limit_s, args[0].closed, daemon)), wire=wire, **did)

    context = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=process)
    monkeypatch.setattr(multiprocessing, "get_context", lambda kind: context)
    monkeypatch.setattr(live_process, "START_S", 0.0)
    with pytest.raises(HandleError, match="no answer from the handle's process for 0 s"):
        LiveHandle(where(channel), 1e4, 0, os.getpid(), "fake", {})
    assert done == ["start", (live_process.ANSWER_S, True, True), "is_alive", "kill", (True, True)]


@pytest.mark.parametrize(
    ("reads_back", "compensator", "kind"),
    [(True, None, 3), (True, "flat", 2), (False, None, 2), (False, "adaptive", 0)],
)
def test_identified_handle_with_a_sensor_adapts(
    reads_back: bool, compensator: str | None, kind: int, tmp_path: Path
) -> None:
    grip = IdentifiedGrip("normal", 500.0, 5.0, 0.99, 0.9)
    fields = ("ours", Plant(), (grip,), {}, {}, 0.12, (100.0, 200.0), 3e-4, 1600.0, 1e4, (10.0, 1000.0), 1.0)
    save_handle(Identification(*fields), tmp_path / "ours.handle")
    output: Any = SimpleNamespace(
        name="mine", takes_force=True, reads_back=reads_back, rate_Hz=5000.0, ceiling=2.0, gain=0.5
    )
    assert compensator_of(output, None)[0].kind == 2
    assert compensator_of(SimpleNamespace(**vars(output) | {"takes_force": False}), None) is None
    if kind == 0:
        with pytest.raises(HandleError, match=r"'adaptive'.*mine"):
            compensator_of(output, str(tmp_path / "ours.handle"), compensator)
        return
    h = compensator_of(output, str(tmp_path / "ours.handle"), compensator)[0]
    assert h.kind == kind and h.force_limit_N == 4.0 and h.rate_Hz == 5000.0
    if kind == 3:  # half a sample of the board's, and most of the accelerometer's pole
        assert 3e-4 + 1e-4 < h.assumed_delay_s < 3e-4 + 2e-4 and h.force_measured == 0
        with pytest.raises(HandleError, match="adaptive"):
            compensator_of(output, None, "adaptive")
