"""The time inside a tick, from compiled code: the operating system's monotonic clock, called by its symbol."""

import ctypes
import sys
import time
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapscene.native import INTERPRETED, native

_MONOTONIC = 6 if sys.platform == "darwin" else 1

now_ns: Any
"""`now_ns(clock)`: nanoseconds of the monotonic clock; `clock` is a buffer from `new_clock`."""

if INTERPRETED:

    def now_ns(clock: NDArray[np.int64]) -> int:
        return time.perf_counter_ns()

elif sys.platform == "win32":
    _query: Any = types.ExternalFunction("QueryPerformanceCounter", types.int32(types.uintp))

    @native
    def now_ns(clock: NDArray[np.int64]) -> int:
        _query(clock.ctypes.data)
        return int(clock[0] * 1_000_000_000 // clock[2])

else:
    _gettime: Any = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.uintp))

    @native
    def now_ns(clock: NDArray[np.int64]) -> int:
        _gettime(np.int32(_MONOTONIC), clock.ctypes.data)
        return int(clock[0] * 1_000_000_000 + clock[1])


def new_clock() -> NDArray[np.int64]:
    """A buffer (3,) for `now_ns`: two words of scratch and, on Windows, the counter's frequency [Hz]."""
    clock = np.zeros(3, np.int64)
    if sys.platform == "win32":
        frequency = ctypes.c_int64()
        ctypes.windll.kernel32.QueryPerformanceFrequency(ctypes.byref(frequency))
        clock[2] = frequency.value
    return clock
