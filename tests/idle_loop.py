"""A loop with the timing of the servo and an empty tick, in a separate process. Measures the scheduler alone."""

import contextlib
import multiprocessing
import threading
from multiprocessing.connection import Connection
from typing import Any, Final

from hapscene.clock import new_clock
from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.loop.empty_loop import loop_empty, run_empty
from hapscene.loop.shared_memory import open_channel
from hapscene.loop.timing import TIMING, Timer, TimingStatistics
from hapscene.records import records

_START_S: Final = 60.0
"""Longest start of the process [s]."""


class IdleLoop:
    """Context manager of the process: it starts on entry and ends on exit."""

    def __enter__(self) -> "IdleLoop":
        self._channel = open_channel(1, 1)
        context = multiprocessing.get_context("spawn")
        self._wire, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(theirs, self._channel.memory.name), daemon=True)
        try:
            self._process.start()
            theirs.close()
            self._answer()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._close()

    def start(self) -> None:
        """Start the loop, at an arbitrary phase of its period."""
        self._wire.send(True)
        self._answer()

    def rest(self) -> None:
        """Stop the loop until the next `start`."""
        self._wire.send(False)
        self._answer()

    def timing(self) -> TimingStatistics:
        """Return the timing statistics, as `Servo.timing`; the busy times are 0."""
        channel = self._channel.channel[0]
        return TimingStatistics(channel.late.copy(), channel.busy.copy(), int(channel.missed))

    def _answer(self) -> None:
        try:
            if self._wire.poll(_START_S):
                self._wire.recv()
                return
        except (EOFError, OSError):
            pass
        raise HapsceneError("the empty loop's process does not answer")

    def _close(self) -> None:
        self._wire.close()  # ends the process
        if self._process.pid is not None:
            self._process.join(_START_S)
            self._process.kill()
        self._channel.close(unlink=True)


def _run(wire: Connection, name: str) -> None:
    """Main function of the process: starts and stops the loop on request, and ends when the pipe closes."""
    channel = open_channel(1, 1, name)
    channel.channel.pause = 1
    timer = Timer(channel.channel[0], new_clock(), records(1, TIMING)[0], round(TICK_S * 1e9))
    loop_empty(timer)  # compiles the loop
    wire.send(None)
    loop: threading.Thread | None = None
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            runs = wire.recv()
            _end(loop, channel)
            loop = None
            if runs:
                channel.channel.pause = 0
                loop = threading.Thread(target=run_empty, args=(timer,), daemon=True)
                loop.start()
            wire.send(None)
    _end(loop, channel)
    channel.close(unlink=False)


def _end(loop: threading.Thread | None, channel: Any) -> None:
    if loop is not None:
        channel.channel.pause = 1
        loop.join()
