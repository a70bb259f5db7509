"""What is printed while something is compiled: one line on stderr, from the first function to the last.

compiling (first run, about 18 s) … 63 of 148 functions
"""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["advance", "begin", "compiling"]

FUNCTION_S = 0.12
"""Time that a function takes to compile [s], which the estimate assumes: 0.09 s on a quiet cloud machine of two cores,
more where other processes run."""

_SOON_S = 1.0
"""What is expected to take less is not announced [s]."""

_lock = threading.RLock()
_depth = 0
_expected = 0
_done = 0
_start_s = 0.0
_announced = False


@contextmanager
def compiling(expected: int = 0) -> Iterator[None]:
    """Meanwhile, what is compiled is one run with one line of progress; `expected` functions are known to come."""
    global _depth, _expected, _done, _announced
    with _lock:
        _depth += 1
        _expected = max(_expected, _done + expected)  # inside another run, it is a part of what that expects
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
    """A function with so many below it is about to be compiled."""
    global _announced, _expected, _start_s
    with _lock:
        _expected = max(_expected, _done + expected)
        seconds = _expected * FUNCTION_S
        if not _announced and seconds >= _SOON_S:
            _announced, _start_s = True, time.perf_counter()
            _write(_line())


def advance() -> None:
    """One more function is compiled."""
    global _done, _expected
    with _lock:
        _done += 1
        _expected = max(_expected, _done)
        if _announced and _rewrites():
            _write(_line())


def _rewrites() -> bool:
    """Whether what was printed can be overwritten."""
    return sys.stderr is not None and sys.stderr.isatty()


def _line() -> str:
    tail = f"{_done} of {_expected} functions" if _done else ""
    start = "\r" if _done and _rewrites() else ""
    return f"{start}compiling (first run, about {max(1, round(_expected * FUNCTION_S))} s) … {tail}"


def _write(text: str) -> None:
    if sys.stderr is not None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except (OSError, ValueError):  # closed
            pass
