"""C functions called by address from compiled code."""

import ctypes
import ctypes.util
import math

import pytest
from numba import types

from hapscene.compiled.entry import c_caller
from hapscene.compiled.native import INTERPRETED, native

pytestmark = pytest.mark.skipif(INTERPRETED, reason="only compiled code calls by address")

call_two = c_caller(types.float64, types.float64, types.float64)


@native
def power(address: int, x: float, y: float) -> float:
    return float(call_two(address, (x, y)))


def test_a_function_of_the_c_library() -> None:
    name = ctypes.util.find_library("m")
    if name is None:
        pytest.skip("no mathematical library of C by that name")
    address = ctypes.cast(ctypes.CDLL(name).pow, ctypes.c_void_p).value
    assert power(address, 2.0, 0.5) == math.sqrt(2.0)
