"""Handling of the signals that end a process: Ctrl-C (SIGINT), SIGTERM, and SIGHUP (the terminal is closed)."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

__all__ = [
    "AGAIN_S",
    "ENDS",
    "clear_interrupt",
    "interrupt_noted",
    "interrupted_by_ends",
    "reraise_swallowed_interrupt",
]

ENDS: Final = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that are handled like Ctrl-C; Windows has no SIGHUP."""

AGAIN_S: Final = 0.01
"""Period of the check whether an interrupt was swallowed [s]."""

IMPORTER: Final = "<frozen importlib._bootstrap>"

_TERMINALS: Final = tuple(number for number in (1, 2) if os.isatty(number))

_Handler = Callable[[int, FrameType | None], None]


@contextmanager
def interrupted_by_ends() -> Iterator[None]:
    """Context in which Ctrl-C and the first of `ENDS` raise KeyboardInterrupt(signal) in the main thread.

    Further signals of `ENDS` have no effect, so that they do not disturb the cleanup: `timeout` sends two. An ignored
    signal remains ignored (`nohup`). Outside the main thread the context has no effect.

    Some modules, such as scipy, networkx and trimesh, swallow an interrupt while they are imported ("except:" around
    optional imports). The interrupt is therefore raised again until `clear_interrupt` is called.
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
            clear_interrupt()


@contextmanager
def reraise_swallowed_interrupt() -> Iterator[None]:
    """Context that replaces errors by KeyboardInterrupt after an interrupt was swallowed, then clears the interrupt.

    Such an error is a consequence of the interrupt, for example a partially imported module.
    """
    try:
        yield
    except Exception:
        if _watched is None:
            raise
        raise KeyboardInterrupt(_watched) from None
    finally:
        clear_interrupt()


_watched: int | None = None
"""Signal whose interrupt is raised again if it is swallowed; None if it does not exist."""


def clear_interrupt() -> None:
    """Stop raising the interrupt again. Call this in the except clause that handles the interrupt."""
    global _watched
    if _watched is not None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        _watched = None


def _watch(kind: int) -> bool:
    """Start to raise an interrupt again until it is cleared; False for a second interrupt, and on Windows."""
    global _watched
    if not hasattr(signal, "setitimer") or signal.getsignal(signal.SIGALRM) != signal.SIG_DFL:
        return False

    def again(alarm: int, frame: FrameType | None) -> None:
        if _is_safe(frame) and not _is_propagating():
            raise KeyboardInterrupt(kind)

    signal.signal(signal.SIGALRM, again)
    signal.setitimer(signal.ITIMER_REAL, AGAIN_S, AGAIN_S)
    _watched = kind
    return True


def _is_safe(frame: FrameType | None) -> bool:
    """Return whether an interrupt may be raised in a frame. The importer must not be interrupted."""
    return frame is None or frame.f_code.co_filename != IMPORTER


def _is_propagating() -> bool:
    """Whether an interrupt is being propagated, through `finally` clauses and context exits."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


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
