"""Play a tool's acceleration channel on a handle, live, in its own process.

The separate process avoids the Python locks of the application and of the servo. It reads the channel from the servo's
shared memory and feeds an output. It fades out if the ticks stop. A board discards its buffer when the application
dies, hangs or is stopped, and on Linux also when the servo dies or is stopped.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np

from hapscene.device.driver import OptionValue
from hapscene.device.driver_registry import DeviceChoice
from hapscene.device.safety import HEARTBEAT_AGE_S
from hapscene.errors import HandleError, HapsceneError
from hapscene.handle.compensator import find_compensator
from hapscene.handle.handle_file import load_handle
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.handle_record import new_handle
from hapscene.handle.live_stream import FADE_S, LiveStream
from hapscene.handle.plant import Array, Plant
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.loop.timing import request_realtime_priority
from hapscene.loop.watchdog import STILL_S, state_of
from hapscene.records import Records
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["ChannelSource", "LiveHandle", "compensator_of", "open_output", "play_recording", "report"]

START_S: Final = 300.0
"""Longest time to start [s]. The first start ever compiles, which took 100 s on a busy machine."""

ANSWER_S: Final = 5.0
"""Longest time to answer a request, and to exit [s]."""

POLL_S: Final = 0.02
"""Interval at which application and output are checked [s]."""


class ChannelSource:
    """The samples of a tool's channel in the servo's shared memory, from now on.

    It returns none, so that the handle becomes silent, while the application or the servo has ended or was stopped,
    the application hangs, or no force is requested. `pids` are the process ids of application and servo.
    """

    def __init__(self, channel: Channel, tool: int, pids: tuple[int, int], clock: Clock = CLOCK) -> None:
        self._ring, self._row, self._clock = channel.a_m_s2[tool], channel.channel.view(np.ndarray), clock
        self._taken = int(self._row["done"][0])
        self._seen = [(name, pid, 0, 0.0) for name, pid in zip(("heartbeat", "done"), pids, strict=True)]

    def _silent(self) -> bool:
        now_s, silent = self._clock.now_s(), bool(self._row["stop_force"][0])
        for at, (name, pid, before, since_s) in enumerate(self._seen):
            count, age_s = int(self._row[name][0]), now_s - since_s
            if count != before:
                self._seen[at] = (name, pid, count, now_s)
            elif count > 0 and age_s > STILL_S:
                hangs = name == "heartbeat" and age_s > HEARTBEAT_AGE_S  # late ticks occur on a busy machine
                silent |= hangs or state_of(pid) != "running"
        return silent

    def fetch(self, wanted: int) -> Array | None:
        """The samples of the ticks since the last call, at most half of the ring buffer; None if the force must end."""
        done = int(self._row["done"][0])
        length = len(self._ring)
        first, self._taken = max(min(self._taken, done), done - length // 2), done
        return None if self._silent() else np.asarray(self._ring[np.arange(first, done) % length]).reshape(-1)  # a copy


def open_output(name: str, options: Mapping[str, OptionValue]) -> HandleOutput:
    """Open the output of the driver `name`. Values of `options` may be strings.

    Raises:
        DeviceError: unknown driver or option, invalid value, or a driver without a handle.
        HandleError: the output is not connected, or cannot be used.
    """
    driver, chosen = DeviceChoice(name, dict(options)).checked(handle=True)
    assert driver.open_handle is not None
    output: HandleOutput = driver.open_handle(**chosen)
    return output


def finish(stream: LiveStream, output: HandleOutput, clock: Clock = CLOCK) -> None:
    """Fade to silence, wait until the silence has been put out, and close the output."""
    stream.end()
    deadline_s = clock.now_s() + 10.0 * FADE_S + output.latency_s
    while not stream.over and not output.fault and clock.now_s() < deadline_s:
        clock.sleep_s(0.005)
    if not output.fault:
        clock.sleep_s(output.latency_s + FADE_S)  # some audio systems drop buffered samples when they are closed
    output.close()


def compensator_of(output: HandleOutput, file: str | None, compensator: str | None = None) -> "Records | None":
    """Create a record (1,) `HANDLE` that computes force from acceleration for an output.

    Args:
        output: the output.
        file: file of the identified handle; None for the assumed handle.
        compensator: a name of `COMPENSATORS`; by default "adaptive" for an identified handle with measurements, "flat"
            otherwise.

    Returns:
        The record; None without a file for an output of levels, which needs no compensator.

    Raises:
        HandleError: the file or compensator does not exist, the compensator needs measurements that are not available,
            or the rate is out of range.
    """
    if file is None and not output.takes_force:
        return None
    learns = file is not None and output.reads_back
    chosen = compensator or ("adaptive" if learns else "flat")
    if find_compensator(chosen).adapts and not learns:
        missing = f"{output.name} returns no measurements in time" if file else "no handle file was given"
        raise HandleError(
            f"compensator {chosen!r} needs measurements of an identified handle, but {missing}: use --compensator flat"
        )
    nominal, sensor = Plant(), None
    if file is not None:
        found = replace(load_handle(file), rate_Hz=output.rate_Hz)
        # The identified amplifier comes after the board's column `force`, whatever the column measures.
        nominal, sensor = found.plant, replace(found.sensor, force_measured=False) if learns else None
    nominal = replace(nominal, force_limit_N=min(nominal.force_limit_N, output.ceiling / output.gain))
    return new_handle(nominal, nominal, chosen, output.rate_Hz, sensor=sensor)


def play_recording(
    samples: Array,
    rate_Hz: float,
    output: HandleOutput,
    handle: "Records | None" = None,
    say: Callable[[float], None] | None = None,
    clock: Clock = CLOCK,
) -> LiveStream:
    """Play accelerations (n,) [m/s²] on an output to their end. `say` receives the share that was played, 0 … 1.

    Raises:
        HandleError: the output was disconnected.
    """
    left = np.array(samples, dtype=np.float64)

    def fetch(wanted: int) -> Array:
        nonlocal left
        taken, left = left[:wanted], left[wanted:]
        return taken

    stream = LiveStream(fetch, rate_Hz, output, handle=handle, steered=False)
    try:
        output.start(stream)
        while stream.played < len(samples) and not output.fault:
            clock.sleep_s(POLL_S)
            if say is not None:
                say(min(1.0, stream.played / max(1, len(samples))))
    finally:
        finish(stream, output, clock)
    if output.fault:
        raise HandleError(output.fault)
    return stream


def serve_live(
    wire: Connection,
    channel: Mapping[str, Any],
    rate_Hz: float,
    tool: int,
    servo_pid: int,
    output: str,
    options: Mapping[str, OptionValue],
    handle: str | None,
    compensator: str | None,
) -> None:
    """Main function of the process, with the arguments of `LiveHandle`.

    Sends (report, None) or (None, error text): once when it plays, then in answer to each message except "stop".
    """
    pids = os.getppid(), servo_pid  # now: the application may end while the output is opened
    with suppress(ValueError, AttributeError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the application handles Ctrl-C
        signal.signal(signal.SIGTERM, _end)
    opened: HandleOutput | None = None
    stream = shared = None
    try:
        shared = open_channel(**channel)
        opened = open_output(output, options)
        made = compensator_of(opened, handle, compensator)
        fetch = ChannelSource(shared, tool, pids).fetch
        stream = LiveStream(fetch, rate_Hz, opened, handle=made, steered=True)
        request_realtime_priority()  # the threads of the output inherit it
        opened.start(stream)
        wire.send((report(stream, opened), None))
        while not opened.fault:
            if wire.poll(POLL_S):
                message = wire.recv()
                if message == "stop":
                    break
                if isinstance(message, float):
                    stream.set_volume(message)
                wire.send((report(stream, opened), None))
    except (EOFError, OSError):
        pass  # the application has exited
    except HapsceneError as error:
        with suppress(OSError):
            wire.send((None, str(error)))
    finally:
        with suppress(ValueError, AttributeError):
            signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the process is already exiting
        if opened is not None:
            fault = opened.fault
            if stream is not None:
                finish(stream, opened)
            opened.close()
            with suppress(OSError):
                if fault:
                    wire.send((None, fault))
        if shared is not None:
            shared.close(unlink=False)


def _end(kind: int, frame: object) -> None:
    """Handler of SIGTERM: exit as if the application had exited."""
    raise EOFError


def report(stream: LiveStream, output: HandleOutput) -> dict[str, float]:
    """Latency [s], clock drift [ppm] and error counts, by name."""
    latency = {"latency_s": stream.latency_s + output.latency_s, "output_latency_s": output.latency_s}
    return latency | {"drift_ppm": 1e6 * stream.drift} | stream.counts | output.counts


class LiveHandle:
    """A handle that plays a tool's channel in its own process; this object is the application's end.

    Args:
        channel: arguments of `open_channel`. The shared memory must exist until the constructor returns.
        rate_Hz: sample rate of the channel.
        tool: index of the tool.
        servo_pid: process id of the servo.
        output: name of the handle's driver.
        options: options of the driver, by name.
        handle: file of an identified handle, whose compensator computes force from acceleration.
        compensator: name of the compensator, as in `compensator_of`.

    Raises:
        HandleError: error of the process, or no answer.
    """

    def __init__(
        self,
        channel: Mapping[str, Any],
        rate_Hz: float,
        tool: int,
        servo_pid: int,
        output: str,
        options: Mapping[str, OptionValue],
        handle: str | None = None,
        compensator: str | None = None,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._wire, theirs = context.Pipe()
        self._lock = threading.Lock()  # several threads of a page may send requests
        arguments = (theirs, dict(channel), rate_Hz, tool, servo_pid, output, dict(options), handle, compensator)
        self._process = context.Process(target=serve_live, args=arguments, name="hapscene handle", daemon=True)
        self._process.start()
        theirs.close()
        try:
            self.report = self._receive(START_S)
        except BaseException:
            self.close()
            raise

    def _receive(self, timeout_s: float) -> dict[str, float]:
        try:
            if not self._wire.poll(timeout_s):
                raise HandleError(f"no answer from the handle's process for {timeout_s:g} s")
            answer, error = self._wire.recv()
        except (EOFError, OSError):
            raise HandleError("the handle's process has exited") from None
        if error is not None:
            raise HandleError(error)
        return dict(answer)

    def update_report(self) -> dict[str, float]:
        """Request the current `report`. Raises HandleError: the handle has stopped; the message gives the reason."""
        return self._request("report")

    def set_volume(self, volume: float) -> None:
        """Set the share of the output's gain, 0 … 1.

        Raises:
            HandleError: the handle has stopped; the message gives the reason.
        """
        self._request(float(volume))

    def _request(self, message: str | float) -> dict[str, float]:
        with self._lock:
            with suppress(OSError):
                self._wire.send(message)
            self.report = self._receive(ANSWER_S)
            return self.report

    def close(self) -> None:
        """Fade to silence and end the process. May be called twice."""
        with suppress(OSError):
            self._wire.send("stop")
        self._process.join(ANSWER_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._wire.close()
