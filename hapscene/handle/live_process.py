"""A handle that plays live, in a process of its own: neither the application's lock of Python nor the servo's is in it.

It takes what a tool's channel asks for out of the servo's shared memory, and gives it to an output. Where ticks stop,
the servo has died, or the application has, it fades to silence within 20 ms.
"""

import multiprocessing
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any, Final, Self

import numpy as np

from hapscene.device.driver_registry import DeviceChoice
from hapscene.errors import HandleError, HapsceneError
from hapscene.handle.compensator import find_compensator
from hapscene.handle.handle_file import load_handle
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.handle_record import new_handle
from hapscene.handle.live_stream import FADE_S, LiveStream
from hapscene.handle.plant import Array, Plant
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.loop.timing import request_realtime_priority
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["ChannelSource", "LiveHandle", "compensator_of", "open_output", "play_recording", "report"]

START_S: Final = 300.0
"""How long it may take to be ready [s]: on its first run ever it compiles, which took 100 on a busy machine."""

ANSWER_S: Final = 5.0
"""How long it may take to answer, and to end [s]."""

LOOK_S: Final = 0.02
"""How often it is looked whether the application is still there, and the output [s]."""


class ChannelSource:
    """What a tool's channel asks for, from now on, as the servo's ticks write it."""

    def __init__(self, channel: Channel, tool: int) -> None:
        """Begins with the next tick."""
        self._ring, self._shared = channel.a_m_s2[tool], channel.channel.view(np.ndarray)["done"]
        self._taken = int(self._shared[0])

    def fetch(self, wanted: int) -> Array:
        """The samples of the ticks that were complete since the last call; no more than half of what the ring holds."""
        done = int(self._shared[0])
        length = len(self._ring)
        first = max(min(self._taken, done), done - length // 2)
        self._taken = done
        return np.asarray(self._ring[np.arange(first, done) % length]).reshape(-1)  # a copy

    def close(self) -> None:
        """Look at the memory no more."""
        self._ring = self._shared = np.zeros((1, 1))


class RecordingSource:
    """What was recorded, as fast as an output takes it."""

    def __init__(self, samples: Array) -> None:
        self._samples, self.taken = samples, 0

    def fetch(self, wanted: int) -> Array:
        """The next so many samples, and fewer at the end."""
        first = self.taken
        self.taken = min(first + wanted, len(self._samples))
        return self._samples[first : self.taken].copy()


def open_output(name: str, options: Mapping[str, Any]) -> HandleOutput:
    """The handle that the driver `name` plays on, opened with its options, which may be texts.

    Raises:
        DeviceError: no such driver or option, an invalid value, or a device that has no handle.
        HandleError: nothing there that can be used.
    """
    driver, told = DeviceChoice(name, dict(options)).checked(handle=True)
    assert driver.open_handle is not None
    output: HandleOutput = driver.open_handle(**told)
    return output


def finish(stream: LiveStream, output: HandleOutput, clock: Clock = CLOCK) -> None:
    """Fade to silence, wait until it has been put out, and close."""
    stream.end()
    deadline_s = clock.now_s() + 10.0 * FADE_S + output.latency_s
    while not stream.over and not output.fault and clock.now_s() < deadline_s:
        clock.sleep_s(0.005)
    if not output.fault:
        clock.sleep_s(output.latency_s + FADE_S)  # not every system plays what it holds when it is told to stop
    output.close()


def compensator_of(output: HandleOutput, file: str | None, compensator: str | None = None) -> Any:
    """A record (1,) `HANDLE` that makes force of acceleration: for the identified handle of `file`, or the assumed one.

    None where no file is given, and the output takes levels. Unless one is named, the compensator is "adaptive" where
    a handle that was identified reads back, else "flat".

    Raises:
        HandleError: no such file or compensator, one that would have nothing to learn from, or a rate that it cannot
            have.
    """
    if file is None and not output.takes_force:
        return None
    learns = file is not None and output.reads_back
    chosen = compensator or ("adaptive" if learns else "flat")
    if find_compensator(chosen).adapts and not learns:
        lack = f"{output.name} reads nothing back in time" if file else "give the file of one"
        raise HandleError(f"{chosen!r} learns from what an identified handle reads back: {lack}, or take flat")
    nominal, sensor = Plant(), None
    if file is not None:
        found = replace(load_handle(file), rate_Hz=output.rate_Hz)
        # The amplifier that was identified stands behind the board's column `force`, whatever that measures.
        nominal, sensor = found.plant, replace(found.sensor, force_measured=False) if learns else None
    nominal = replace(nominal, force_limit_N=min(nominal.force_limit_N, output.ceiling / output.gain))
    return new_handle(nominal, nominal, chosen, output.rate_Hz, sensor=sensor)


def play_recording(
    samples: Array,
    rate_Hz: float,
    output: HandleOutput,
    handle: Any = None,
    say: Callable[[float], None] | None = None,
    clock: Clock = CLOCK,
) -> LiveStream:
    """Play accelerations (n,) [m/s²] to their end, from silence to silence; `say` is told the share that was played.

    Raises:
        HandleError: the output went away.
    """
    source = RecordingSource(np.asarray(samples, dtype=np.float64))
    stream = LiveStream(source.fetch, rate_Hz, output, handle=handle, steered=False)
    try:
        output.start(stream)
        while stream.played < len(samples) and not output.fault:
            clock.sleep_s(LOOK_S)
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
    output: str,
    options: Mapping[str, Any],
    handle: str | None,
    compensator: str | None,
) -> None:
    """The process's main function, with the arguments of `LiveHandle`; `channel` has those of `open_channel`.

    Answers (None, report) or (error text, None): once when it plays, then to every message but "stop".
    """
    with suppress(ValueError, AttributeError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the application's affair
        signal.signal(signal.SIGTERM, _end)
    opened: HandleOutput | None = None
    stream = shared = source = None
    try:
        shared = open_channel(**channel)
        opened = open_output(output, options)
        made = compensator_of(opened, handle, compensator)
        source = ChannelSource(shared, tool)
        stream = LiveStream(source.fetch, rate_Hz, opened, handle=made, steered=True)
        request_realtime_priority()  # also of the threads that the output starts
        opened.start(stream)
        wire.send((None, report(stream, opened)))
        while not opened.fault:
            if wire.poll(LOOK_S):
                said = wire.recv()
                if said == "stop":
                    break
                if isinstance(said, float):
                    stream.turn(said)
                wire.send((None, report(stream, opened)))
    except (EOFError, OSError):
        pass  # the application is gone
    except HapsceneError as error:
        with suppress(OSError):
            wire.send((str(error), None))
    finally:
        with suppress(ValueError, AttributeError):
            signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it is ending
        if opened is not None:
            fault = opened.fault
            if stream is not None:
                finish(stream, opened)
            opened.close()
            with suppress(OSError):
                if fault:
                    wire.send((fault, None))
        if source is not None:
            source.close()
        if shared is not None:
            shared.close(unlink=False)


def _end(kind: int, frame: Any) -> None:
    """What SIGTERM does: as if the application had gone."""
    raise EOFError


def report(stream: LiveStream, output: HandleOutput) -> dict[str, float]:
    """Latency [s], drift of the clocks [ppm], and all counts, by name."""
    told = {"latency_s": stream.latency_s + output.latency_s, "output_latency_s": output.latency_s}
    return told | {"drift_ppm": 1e6 * stream.drift} | stream.counts | output.counts


class LiveHandle:
    """A handle that plays a tool's channel: the application's end.

    Args:
        channel: arguments of `open_channel`, among them `name`; the memory must be there until this returns.
        rate_Hz: of the channel's samples.
        tool: whose channel it is.
        output: name of the handle to play on.
        options: of that, by name.
        handle: an identified handle's file, whose compensator makes force of acceleration.
        compensator: of that, as `compensator_of` has it.

    Raises:
        HandleError: what the handle refuses, or no answer.
    """

    def __init__(
        self,
        channel: Mapping[str, Any],
        rate_Hz: float,
        tool: int,
        output: str,
        options: Mapping[str, Any],
        handle: str | None = None,
        compensator: str | None = None,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._wire, theirs = context.Pipe()
        self._one_asks = threading.Lock()  # a page's threads turn it, and who watches asks
        arguments = (theirs, dict(channel), rate_Hz, tool, output, dict(options), handle, compensator)
        self._process = context.Process(target=serve_live, args=arguments, name="hapscene handle", daemon=True)
        self._process.start()
        theirs.close()
        try:
            self.report = self._answer(START_S)
        except BaseException:
            self.close()
            raise

    def _answer(self, patience_s: float) -> dict[str, float]:
        try:
            if not self._wire.poll(patience_s):
                raise HandleError(f"the handle's process does not answer for {patience_s:g} s")
            error, told = self._wire.recv()
        except (EOFError, OSError):
            raise HandleError("the handle's process has ended") from None
        if error is not None:
            raise HandleError(error)
        return dict(told)

    def look(self) -> dict[str, float]:
        """What `report` says now.

        Raises:
            HandleError: it plays no more, and why.
        """
        return self._tell("report")

    def turn(self, volume: float) -> None:
        """Play from now on at this share of the output's gain, 0 … 1.

        Raises:
            HandleError: it plays no more, and why.
        """
        self._tell(float(volume))

    def _tell(self, said: str | float) -> dict[str, float]:
        with self._one_asks:
            with suppress(OSError):
                self._wire.send(said)
            self.report = self._answer(ANSWER_S)
            return self.report

    def close(self) -> None:
        """Fade to silence, and end. Twice does no harm."""
        with suppress(OSError):
            self._wire.send("stop")
        self._process.join(ANSWER_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._wire.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
