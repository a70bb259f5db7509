"""Progress of compilation: one line on stderr, from the first function to the last.

compiling 148 functions (first run, about 18 s) … 63
"""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["advance", "begin", "compiling"]

FUNCTION_S = 0.12
"""Time to compile a function [s] that the estimate assumes: 0.09 s on an idle cloud machine with two cores, more on a
busy one."""

_SOON_S = 1.0
"""Compilation that is expected to take less is not reported [s]."""

_lock = threading.RLock()
_depth = 0
_expected = 0
_done = 0
_start_s = 0.0
_announced = False


@contextmanager
def compiling(expected: int = 0) -> Iterator[None]:
    """Report what is compiled in this context as one run in one line; `expected` functions are known in advance."""
    global _depth, _expected, _done, _announced
    with _lock:
        _depth += 1
        _expected = max(_expected, _done + expected)  # a nested run is part of the outer one
    try:
        yield
    finally:
        with _lock:
            _depth -= 1
            if _depth == 0:
                if _announced:
                    _write(f"{_line() if _rewrites() else ''} done in {time.perf_counter() - _start_s:.0f} s\n")
                _expected = _done = 0
                _announced = False


def begin(expected: int) -> None:
    """Report that a function with `expected` functions, including itself, is about to be compiled."""
    global _announced, _expected, _start_s
    with _lock:
        _expected = max(_expected, _done + expected)
        seconds = _expected * FUNCTION_S
        if not _announced and seconds >= _SOON_S:
            _announced, _start_s = True, time.perf_counter()
            _write(_line())


def advance() -> None:
    """Count a compiled function."""
    global _done, _expected
    with _lock:
        _done += 1
        _expected = max(_expected, _done)
        if _announced and _rewrites():
            _write(_line())


def _rewrites() -> bool:
    """Return whether the line can be overwritten."""
    return sys.stderr is not None and sys.stderr.isatty()


def _line() -> str:
    tail = f"{_done}" if _done else ""
    start = "\r" if _done and _rewrites() else ""
    functions = f"{_expected} function{'' if _expected == 1 else 's'}"
    return f"{start}compiling {functions} (first run, about {max(1, round(_expected * FUNCTION_S))} s) … {tail}"


def _write(text: str) -> None:
    if sys.stderr is not None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except (OSError, ValueError):  # stderr is closed
            pass
