"""The connection of an application to the process of its servo: starts and ends processes, and sends orders.

Up to three processes belong to a servo: the servo itself, a watchdog if a device can exert a force, and one that plays
the acceleration on a real handle. They share the memory of `hapscene.loop.shared_memory` with the application.
"""

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection as Pipe
from multiprocessing.context import SpawnContext
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_here_ns
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.errors import DeviceError, HapsceneError
from hapscene.io.files import Json
from hapscene.loop.driver import ENDED
from hapscene.loop.heartbeat import Heartbeat
from hapscene.loop.shared_memory import Channel, open_channel, read_text

if TYPE_CHECKING:
    from hapscene.handle.live_process import LiveHandle

__all__ = ["ServoConnection"]

START_S: Final = 300.0
"""Longest time until the process is ready [s]. Its first run compiles, which may take two minutes."""

REPORT_S: Final = 5.0
"""Period at which the time of a long start is reported [s]."""

ANSWER_S: Final = 20.0
"""Longest time until an order is answered [s]."""

BUILD_S: Final = 120.0
"""Longest time until an order that builds a search structure is answered [s]: 3 s for 5 M faces on an idle machine."""


class ServoConnection:
    """A context manager that runs the process of a servo.

    Args:
        arguments: arguments of the process, see `hapscene.loop.servo_process.run`.
        choices: real devices, by driver.
        handle: real handle of the first tool, if there is one.
        handle_file: identified handle, whose compensator drives the real one.
        shape: length of the ring buffers, samples per tick, and numbers of bodies and tools.
        a_rate_Hz: sample rate of the acceleration channel.
        patience_s: time without a call of the application after which the heartbeat stops.
        progress: called with the stages of the start, and with the time that it has taken so far.
    """

    def __init__(
        self,
        arguments: dict[str, Any],
        choices: Sequence[DeviceChoice],
        handle: DeviceChoice | None,
        handle_file: str | None,
        *,
        shape: tuple[int, int, int, int],
        a_rate_Hz: float,
        patience_s: float,
        progress: Callable[[str], None],
    ) -> None:
        self._arguments, self._choices = arguments, list(choices)
        self._handle_choice, self._handle_file = handle, handle_file
        self._length, self._block, self._room, self._tools = shape
        self.a_rate_Hz, self._patience_s, self._progress = a_rate_Hz, patience_s, progress
        # views of the shared memory, which must be released before it
        self._aim: list[tuple[NDArray[np.float64], NDArray[np.int64]]] = []
        self._ticks: tuple[NDArray[Any], ...] = ()
        self._frames: Any = None
        self._opened: Channel | None = None
        self._closed = False
        self._process: Any = None
        self._watchdog: BaseProcess | None = None
        self._life: Pipe | None = None
        self._played: LiveHandle | None = None
        self._heartbeat: Heartbeat | None = None
        self._asked = np.zeros(1, np.int64)  # counts calls of the application, see `Heartbeat`
        self._now_ns = now_here_ns  # the clock of the loop
        self._wire: Any = None
        self._shared = False  # both processes have opened the memory, which no other process can
        # orders are executed one after the other in this thread, which Ctrl-C does not interrupt
        self._lane = ThreadPoolExecutor(1, "hapscene orders")
        self._cancelled = False
        self._renderer_arguments: Mapping[str, Json] = {}

    def __enter__(self) -> Self:
        if self._closed or self._opened is not None:
            raise HapsceneError("a servo can be entered once only: make a new one")
        try:
            with _terminal_signals_blocked():  # starts the resource tracker of Python
                self._opened = open_channel(self._length, self._block, bodies=self._room, tools=self._tools)
            self._opened.channel.pause, self._opened.channel.waiting = 1, ENDED
            self._make_views(self._opened)
            self._begin(self._opened)
            self._opened.memory.unlink()  # from now on the memory is freed with both processes, even if they are killed
            self._shared = True
        except BaseException:
            self.close()
            raise
        return self

    def _begin(self, shared: Channel) -> None:
        """Start the processes that run the loop and watch it, and the heartbeat of this process."""
        from hapscene.loop.servo_process import run

        context = multiprocessing.get_context("spawn")  # a fork would copy threads and locks of the application
        self._wire, theirs = context.Pipe()
        life, dying = context.Pipe(duplex=False)
        arguments = (theirs, dying, shared.memory.name, self._length)
        process = context.Process(target=run, args=arguments, name="hapscene servo", daemon=True)
        pickled = ForkingPickler.dumps(self._arguments)
        with _terminal_signals_blocked():
            process.start()
        self._process = process
        if self._cancelled:
            raise HapsceneError("the start of the servo was cancelled")
        theirs.close()
        dying.close()
        if any(DRIVERS.load(choice.name).force for choice in self._choices):
            self._start_watchdog(context, life)
            life.close()
        else:
            self._life = life  # stays open, because the servo takes its end for that of a watchdog
        self._send(pickled)  # not as an argument of the process: if it ended at once, the start would block for ever
        self._renderer_arguments = self._started()
        self._heartbeat = Heartbeat(shared.channel["heartbeat"].view(np.ndarray), self._patience_s)
        self._asked = self._heartbeat.asked
        if self._handle_choice is not None:
            self._start_handle(self._handle_choice)

    def _started(self) -> Mapping[str, Json]:
        """Report the stages of the start that the process sends, as texts; return its last message."""
        waited_s, stage = 0.0, "a new process"
        while isinstance(stage, str):
            self._progress(f"{stage} … ")
            while waited_s < START_S and not self._wire.poll(REPORT_S):
                waited_s += REPORT_S
                self._progress(f"{waited_s:.0f} s … ")
            stage = self._answer(START_S - waited_s)
        return stage

    def _start_watchdog(self, context: SpawnContext, life: Pipe) -> None:
        """Start the process that removes the force if the servo dies or stops ticking."""
        from hapscene.loop.watchdog import watch

        assert self._opened is not None
        here, there = context.Pipe(duplex=False)
        shape = self._length, self._block, self._room, self._tools
        arguments = (life, there, self._opened.memory.name, shape, self._process.pid, self._choices)
        self._watchdog = context.Process(target=watch, args=arguments, name="hapscene watchdog", daemon=True)
        with _terminal_signals_blocked():
            self._watchdog.start()
        there.close()
        if not here.poll(START_S):
            raise HapsceneError(f"the watchdog of the servo did not start within {START_S:g} s; no device is driven")
        try:
            here.recv()
        except EOFError:
            raise HapsceneError("the watchdog of the servo ended at its start; no device is driven") from None

    def _start_handle(self, choice: DeviceChoice) -> None:
        """Start the process that plays the acceleration of the first tool on a real handle."""
        from hapscene.handle.live_process import LiveHandle

        assert self._opened is not None
        shape = {"length": self._length, "block": self._block, "bodies": self._room, "tools": self._tools}
        where, file = shape | {"name": self._opened.memory.name}, self._handle_file
        pid, rate_Hz = self._process.pid, self.a_rate_Hz
        with _terminal_signals_blocked():
            self._played = LiveHandle(where, rate_Hz, 0, pid, choice.name, choice.options, handle=file)

    def _make_views(self, shared: Channel) -> None:
        """Keep views of fields that are used often: a look-up by name takes microseconds."""
        channel = shared.channel.view(np.ndarray)
        aims = shared.aims.view(np.ndarray)
        self._aim = [(aims["aim"][tool], aims["count"][tool : tool + 1]) for tool in range(self._tools)]
        numbers = (channel[name] for name in ("done", "done_ns"))
        self._ticks = shared.rows.view(np.ndarray), *numbers
        self._frames = shared.frames.view(np.ndarray)

    def __exit__(self, *error: object) -> None:
        self.close()

    def cancel(self) -> None:
        """Make a start that runs in another thread fail at once; it may otherwise take up to `START_S`."""
        self._cancelled = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """End the processes and release the memory. May be called more than once."""
        self._closed = True
        self._lane.shutdown(wait=False, cancel_futures=True)
        if self._opened is None:
            return
        if self._process is not None:
            if self._shared:  # otherwise the process may still be receiving its arguments
                try:
                    self._wire.send(("stop", ()))
                    self._process.join(ANSWER_S)
                except (OSError, ValueError):
                    pass
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
        if self._wire is not None:
            self._wire.close()
        if self._played is not None:
            self._played.close()
        if self._watchdog is not None:
            self._watchdog.join(ANSWER_S)
            if self._watchdog.is_alive():
                self._watchdog.kill()
        if self._heartbeat is not None:
            self._heartbeat.stop()
        self._aim, self._ticks, self._frames = [], (), None
        self._opened.close(unlink=not self._shared)
        self._opened = None

    @property
    def _channel(self) -> Channel:
        """The memory of a running process. Raises if the process has ended, whose last state would look current."""
        if self._closed:
            raise HapsceneError("this servo is closed: make a new one")
        if self._opened is None or self._process is None:
            raise HapsceneError("this servo does not run: use it as a context, `with Servo(…) as servo:`")
        if not self._process.is_alive():
            raise HapsceneError(self._ended())
        self._asked[0] += 1
        if self._opened.fault[0]:
            raise DeviceError(read_text(self._opened.fault))
        return self._opened

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.is_alive()

    def _order(self, order: str, *arguments: object) -> object:
        """Send an order after those before it are done; return its result."""
        return self._in_turn(lambda: self._talk(order, *arguments))

    def _in_turn(self, do: Callable[[], Any]) -> Any:
        """Call a function after the orders before it are done; return its result."""
        _ = self._channel  # raises if no process runs
        try:
            turn = self._lane.submit(do)
        except RuntimeError:  # closed meanwhile
            raise HapsceneError("this servo is closed: make a new one") from None
        return turn.result()

    def _talk(self, order: str, *arguments: object) -> object:
        """Send an order and wait for its answer."""
        _ = self._channel
        self._send(ForkingPickler.dumps((order, arguments)))
        return self._answer(BUILD_S if order in ("add", "repaint", "deform") else ANSWER_S)

    def _send(self, pickled: memoryview) -> None:
        try:
            self._wire.send_bytes(pickled)
        except (OSError, ValueError):
            raise HapsceneError(self._ended()) from None

    def _answer(self, timeout_s: float) -> Any:
        try:
            if not self._wire.poll(timeout_s):
                self._process.kill()  # a delayed answer would be taken for that of the next order
                raise HapsceneError(f"the process of the servo did not answer within {timeout_s:g} s and was ended")
            error, result = self._wire.recv()
        except (EOFError, OSError):
            raise HapsceneError(self._ended()) from None
        if error is not None:
            raise HapsceneError(error)
        return result

    def _ended(self) -> str:
        """Return the message about a process that has ended."""
        self._process.join(1.0)
        ended = f"the process of the servo has ended (exit code {self._process.exitcode})"
        if self._watchdog is not None and self._process.exitcode == -9:
            fault = "" if self._opened is None else read_text(self._opened.fault)
            why = "it was killed, or its watchdog ended it because it stopped ticking; is the computer overloaded?"
            ended += f": {fault or why}"
        return f"{ended}; start a new servo"


@contextmanager
def _terminal_signals_blocked() -> Iterator[None]:
    """Start processes in this context that ignore the signals of a terminal to its foreground job.

    Ctrl-Z then stops the application alone, whose heartbeat ends the force. It would otherwise also stop the servo and
    its watchdog.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    terminal = (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, terminal)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
