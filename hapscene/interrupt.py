"""Signals that ask a process to end: Ctrl-C, SIGTERM (a kill, a service that stops), SIGHUP (its terminal is gone)."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

ENDS: Final = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end as Ctrl-C does; Windows has no SIGHUP."""

_TERMINALS: Final = tuple(number for number in (1, 2) if os.isatty(number))


@contextmanager
def interrupted_by_ends() -> Iterator[None]:
    """While it is open, the first of `ENDS` raises KeyboardInterrupt, with its number, in the main thread.

    Those after it have no effect: `timeout` sends two, and what the first has put in order must not be torn. A signal
    that is ignored stays ignored (`nohup`). Outside the main thread nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {kind: handler for kind in ENDS if (handler := signal.getsignal(kind)) != signal.SIG_IGN}

    def interrupt(kind: int, frame: object) -> None:
        for each in before:
            signal.signal(each, _pass)
        _leave_terminals()
        raise KeyboardInterrupt(kind)

    with _handled(dict.fromkeys(before, interrupt)):
        yield


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """While it is open, the first Ctrl-C and any of `ENDS` are only noted; a second Ctrl-C raises KeyboardInterrupt.

    For work that has something to put in order first. Gives the function that says whether one was noted. To be opened
    in the main thread.
    """
    noted = threading.Event()

    def note(kind: int, frame: object) -> None:
        noted.set()
        _leave_terminals()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    with _handled({kind: note for kind in (signal.SIGINT, *ENDS) if signal.getsignal(kind) != signal.SIG_IGN}):
        yield noted.is_set


@contextmanager
def _handled(handlers: dict[signal.Signals, Callable[[int, object], None]]) -> Iterator[None]:
    before = {kind: signal.signal(kind, handler) for kind, handler in handlers.items()}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler or signal.SIG_DFL)


def _pass(kind: int, frame: object) -> None:
    """No effect. Not SIG_IGN, which processes started afterwards would inherit."""


def _leave_terminals() -> None:
    """What is said goes nowhere once the terminal is gone, where it would fail with each line."""
    for number in _TERMINALS:
        if not os.isatty(number):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, number)
            os.close(nowhere)
