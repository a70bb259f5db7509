"""Signals that ask a process to end: Ctrl-C, SIGTERM (a kill, a service that stops), SIGHUP (its terminal is gone)."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

__all__ = ["AGAIN_S", "ENDS", "heard", "insisting", "interrupt_noted", "interrupted_by_ends"]

ENDS: Final = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end as Ctrl-C does; Windows has no SIGHUP."""

AGAIN_S: Final = 0.01
"""How often it is looked whether an interrupt was swallowed [s]."""

IMPORTER: Final = "<frozen importlib._bootstrap>"

_TERMINALS: Final = tuple(number for number in (1, 2) if os.isatty(number))

_Handler = Callable[[int, FrameType | None], None]


@contextmanager
def interrupted_by_ends() -> Iterator[None]:
    """While it is open, Ctrl-C and the first of `ENDS` raise KeyboardInterrupt, with its number, in the main thread.

    Those of `ENDS` after it have no effect: `timeout` sends two, and what the first has put in order must not be torn.
    A signal that is ignored stays ignored (`nohup`). Outside the main thread nothing changes.

    Modules that are imported swallow an interrupt, as scipy, networkx and trimesh do ("except:" around what is
    optional). So it comes again where it was swallowed, until `heard` is called.
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
        if not _watch(kind) or _is_safe(frame):
            raise KeyboardInterrupt(kind)

    with _handled(dict.fromkeys(kinds, interrupt)):
        try:
            yield
        finally:
            heard()


@contextmanager
def insisting() -> Iterator[None]:
    """What leaves here with an error, after an interrupt that was swallowed, leaves with KeyboardInterrupt.

    The error is what the interrupt has broken: a module half imported. As it leaves, the interrupt is heard.
    """
    try:
        yield
    except Exception:
        if _watched is None:
            raise
        raise KeyboardInterrupt(_watched) from None
    finally:
        heard()


_watched: int | None = None
"""The signal that is raised again where its interrupt is swallowed."""


def heard() -> None:
    """Go on after an interrupt: it is not raised again. To be called where it is caught, in the except clause."""
    global _watched
    if _watched is not None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        _watched = None


def _watch(kind: int) -> bool:
    """Raise an interrupt again until it is heard; whether that begins: not for a second one, nor on Windows."""
    global _watched
    if not hasattr(signal, "setitimer") or signal.getsignal(signal.SIGALRM) != signal.SIG_DFL:
        return False

    def again(alarm: int, frame: FrameType | None) -> None:
        if _is_safe(frame) and not _in_flight():
            raise KeyboardInterrupt(kind)

    signal.signal(signal.SIGALRM, again)
    signal.setitimer(signal.ITIMER_REAL, AGAIN_S, AGAIN_S)
    _watched = kind
    return True


def _is_safe(frame: FrameType | None) -> bool:
    """Whether an interrupt may be raised in a frame: not within the importer, which tidies up where nobody catches."""
    return frame is None or frame.f_code.co_filename != IMPORTER


def _in_flight() -> bool:
    """Whether an interrupt is on its way: its `finally`s and exits run, or their own errors are handled."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


@contextmanager
def interrupt_noted(act: Callable[[], object] | None = None) -> Iterator[Callable[[], bool]]:
    """While it is open, the first Ctrl-C and any of `ENDS` are only noted; a second Ctrl-C raises KeyboardInterrupt.

    For work that has something to put in order first. Gives the function that returns whether one was noted. To be
    opened in the main thread. `act` is called by the signal handler itself: it must be short, and must not take a lock.
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
    """What is said goes nowhere once the terminal is gone, where it would fail with each line."""
    for number in _TERMINALS:
        if not os.isatty(number):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, number)
            os.close(nowhere)
