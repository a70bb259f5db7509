"""Handling of the signals that end a process: Ctrl-C (SIGINT), SIGTERM, and SIGHUP (the terminal is closed)."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

__all__ = ["ENDS", "interrupt_noted", "interrupted_by_ends"]

ENDS: Final = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that are handled like Ctrl-C; Windows has no SIGHUP."""

_TERMINALS: Final = tuple(number for number in (1, 2) if os.isatty(number))

_Handler = Callable[[int, FrameType | None], None]


@contextmanager
def interrupted_by_ends() -> Iterator[None]:
    """Context in which Ctrl-C and the first of `ENDS` raise KeyboardInterrupt(signal) in the main thread.

    Further signals of `ENDS` have no effect, so that they do not disturb the cleanup: `timeout` sends two. An ignored
    signal remains ignored (`nohup`). Outside the main thread the context has no effect.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kinds = [kind for kind in (signal.SIGINT, *ENDS) if signal.getsignal(kind) != signal.SIG_IGN]

    def interrupt(kind: int, frame: FrameType | None) -> None:
        for each in kinds:
            if each != signal.SIGINT:
                signal.signal(each, _pass)
        _leave_terminals()
        raise KeyboardInterrupt(kind)

    with _handled(dict.fromkeys(kinds, interrupt)):
        yield


@contextmanager
def interrupt_noted(act: Callable[[], object] | None = None) -> Iterator[Callable[[], bool]]:
    """Context in which the first Ctrl-C and all `ENDS` only set a flag; a second Ctrl-C raises KeyboardInterrupt.

    Use it for work that needs an orderly end. It yields a function that returns whether a signal was received, and must
    be used in the main thread. The signal handler calls `act`, which must be short and must not take a lock.
    """
    noted = threading.Event()

    def note(kind: int, frame: object) -> None:
        if act is not None:
            act()
        noted.set()
        _leave_terminals()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    with _handled({kind: note for kind in (signal.SIGINT, *ENDS) if signal.getsignal(kind) != signal.SIG_IGN}):
        yield noted.is_set


@contextmanager
def _handled(handlers: dict[signal.Signals, _Handler]) -> Iterator[None]:
    before = {kind: signal.signal(kind, handler) for kind, handler in handlers.items()}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler or signal.SIG_DFL)


def _pass(kind: int, frame: object) -> None:
    """No effect. Not SIG_IGN, which processes started afterwards would inherit."""


def _leave_terminals() -> None:
    """Redirect output to the null device if the terminal is closed, since writing to it would fail."""
    for number in _TERMINALS:
        if not os.isatty(number):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, number)
            os.close(nowhere)
