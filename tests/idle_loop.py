"""An empty loop beside the servo's, which waits as it does and does nothing else; its process starts from this file."""

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
"""How long the process may take to be ready [s]."""


class IdleLoop:
    """The loop, as a context: its process starts on entry and ends on exit."""

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
        """Run, its period's phase by chance."""
        self._wire.send(True)
        self._answer()

    def rest(self) -> None:
        """Stop until the next `start`."""
        self._wire.send(False)
        self._answer()

    def timing(self) -> TimingStatistics:
        """As `Servo.timing`; no tick is ever busy."""
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
        self._wire.close()  # which ends it
        if self._process.pid is not None:
            self._process.join(_START_S)
            self._process.kill()
        self._channel.close(unlink=True)


def _run(wire: Connection, name: str) -> None:
    """The process: loops and rests as it is told, until the application is gone."""
    channel = open_channel(1, 1, name)
    channel.channel.pause = 1
    timer = Timer(channel.channel[0], new_clock(), records(1, TIMING)[0], round(TICK_S * 1e9))
    loop_empty(timer)  # has it compiled
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
