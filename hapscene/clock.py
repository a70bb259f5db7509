"""Monotonic clock of the operating system for compiled code.

A test can use a buffer with a virtual time (`new_clock`): the same compiled loop then runs without waiting.
"""

import ctypes
import sys
import time
from typing import Any, Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapscene.compiled.native import INTERPRETED, native

__all__ = ["LOOK_NS", "VIRTUAL", "new_clock", "now_here_ns", "now_ns", "sleep_ns"]

_MONOTONIC = {"linux": 7, "darwin": 6}.get(sys.platform, 1)
"""Identifier of the clock that includes the time of system sleep, so that a loop detects it."""

VIRTUAL: Final = 3
"""Index of the virtual time in a buffer [ns]; 0 means that the clock of the system is read."""

LOOK_NS: Final = 1_000
"""Increment of a virtual clock with each reading [ns], so that a loop that polls it ends."""


def now_here_ns() -> int:
    """Time of the same clock, read from Python [ns]; comparable between processes."""
    return time.perf_counter_ns() if sys.platform == "win32" else time.clock_gettime_ns(_MONOTONIC)


if INTERPRETED:

    def _system_now_ns(clock: NDArray[np.int64]) -> int:
        return now_here_ns()

    def _system_sleep_ns(clock: NDArray[np.int64], span_ns: int) -> None:
        time.sleep(span_ns * 1e-9)

elif sys.platform == "win32":
    _query: Any = types.ExternalFunction("QueryPerformanceCounter", types.int32(types.uintp))

    @native
    def _system_now_ns(clock: NDArray[np.int64]) -> int:
        _query(clock.ctypes.data)
        whole, part = clock[0] // clock[2], clock[0] % clock[2]  # a single product would overflow within minutes
        return int(whole * 1_000_000_000 + part * 1_000_000_000 // clock[2])

    _sleep: Any = types.ExternalFunction("Sleep", types.void(types.uint32))

    @native
    def _system_sleep_ns(clock: NDArray[np.int64], span_ns: int) -> None:
        _sleep(np.uint32(span_ns // 1_000_000))

else:
    _gettime: Any = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.uintp))

    @native
    def _system_now_ns(clock: NDArray[np.int64]) -> int:
        _gettime(np.int32(_MONOTONIC), clock.ctypes.data)
        return int(clock[0] * 1_000_000_000 + clock[1])

    _nanosleep: Any = types.ExternalFunction("nanosleep", types.int32(types.uintp, types.uintp))

    @native
    def _system_sleep_ns(clock: NDArray[np.int64], span_ns: int) -> None:
        clock[0], clock[1] = span_ns // 1_000_000_000, span_ns % 1_000_000_000
        _nanosleep(clock.ctypes.data, 0)


@native
def now_ns(clock: NDArray[np.int64]) -> int:
    """Monotonic time, or the virtual time of the buffer [ns]; `clock` is a buffer from `new_clock`."""
    if clock[VIRTUAL] == 0:
        return int(_system_now_ns(clock))
    clock[VIRTUAL] += LOOK_NS
    return int(clock[VIRTUAL])


@native
def sleep_ns(clock: NDArray[np.int64], span_ns: int) -> None:
    """Sleep for a time span [ns] without the GIL.

    It may return later, or earlier by at most the resolution of the scheduler: read the clock again if necessary.
    """
    if clock[VIRTUAL] == 0:
        _system_sleep_ns(clock, span_ns)
    else:
        clock[VIRTUAL] += span_ns


def new_clock(virtual_ns: int = 0) -> NDArray[np.int64]:
    """A buffer (4,) for `now_ns`: two scratch values, the counter frequency on Windows [Hz], and the virtual time [ns].

    Each thread needs its own: a time that another thread writes would become the span of a sleep. With `virtual_ns`
    above 0, the virtual time starts there and advances only by readings, sleeping and the test.
    """
    clock = np.zeros(4, np.int64)
    clock[VIRTUAL] = virtual_ns
    if sys.platform == "win32":
        frequency = ctypes.c_int64()
        ctypes.windll.kernel32.QueryPerformanceFrequency(ctypes.byref(frequency))
        clock[2] = frequency.value
    return clock
