"""Connection to a device that compiled code reads and writes, and the time that it has not answered. Not a driver.

`ResponseTimeout` counts that time for drivers in Python.
"""

from collections.abc import Callable
from typing import Any, Final

from hapscene.clock import new_clock, now_ns
from hapscene.compiled.bound_call import BoundCall
from hapscene.compiled.native import native
from hapscene.device.driver import Connection
from hapscene.device.response_timeout import GONE_S, PAUSE_S, POLL_MAX_S, no_answer
from hapscene.records import Records

__all__ = ["SILENCE", "CompiledConnection", "note_poll"]

SILENCE: Final = [
    ("polled_ns", "i8"),  # time of the last poll
    ("silent_ns", "i8"),  # time without a valid answer, pauses not counted
    ("paused", "i8"),  # 1: there was no valid answer since a pause
]
"""Fields in the state of a compiled driver, which sets the last two to 0 after a valid answer."""


@native
def note_poll(state: Any, now: int) -> bool:
    """Count the silence before a poll, at a time `now` [ns]; return whether the device was not polled for `PAUSE_S`.

    `state` has the fields `SILENCE`.
    """
    since = now - state.polled_ns
    state.silent_ns += min(since, int(POLL_MAX_S * 1e9))
    state.polled_ns = now
    if since > PAUSE_S * 1e9:
        state.paused = 1
        return True
    return False


class CompiledConnection(Connection):
    """Base class of an open device that compiled code reads and writes."""

    _name, _remedy = "", ""

    def __init__(self, board: Any, reads: Callable[[Any], None], writes: Callable[[Any], None]) -> None:
        """`board` is a record with the fields `SILENCE`; the compiled functions take the result of `_argument`."""
        super().__init__()
        self._board, self._functions, self._clock = board, (reads, writes), new_clock()
        self._board.polled_ns = now_ns(self._clock)
        self._bound: tuple[Records, tuple[BoundCall, BoundCall]] | None = None

    def _argument(self) -> tuple[Any, ...]:
        """The argument of the compiled functions, with the present state."""
        raise NotImplementedError

    def _calls(self) -> tuple[BoundCall, BoundCall]:
        """The functions with their argument, which is made again after the servo has moved the state."""
        if self._bound is None or self._bound[0] is not self.state:
            argument = self._argument()
            read, write = (BoundCall(function, argument) for function in self._functions)
            self._bound = self.state, (read, write)
        return self._bound[1]

    def check(self) -> None:
        if self._board.silent_ns > GONE_S * 1e9:
            raise no_answer(self._name, self._remedy)
