"""Compiled functions with a bound argument, as C functions."""

import ctypes
import threading
from typing import Any, NamedTuple

import numpy as np
import pytest

from hapscene.compiled.bound_call import BoundCall, loaded
from hapscene.compiled.native import INTERPRETED, native
from hapscene.records import ROW, records


class Part(NamedTuple):
    numbers: Any
    row: Any
    weight: float


class Bound(NamedTuple):
    parts: Any
    count: Any


@native
def add(bound: Bound) -> None:
    for part in bound.parts:
        part.row[0].depth_m += part.numbers[0] * part.weight
    bound.count[0] += 1


def add_at(address: Any, kind: Any) -> None:
    add(loaded(address, kind))


def make(weight: float) -> Bound:
    return Bound(tuple(Part(np.full(3, k + 1.0), records(1, ROW), weight) for k in range(2)), np.zeros(1, np.int64))


def test_call_acts_on_its_argument() -> None:
    first, second = make(0.5), make(2.0)
    calls = BoundCall(add_at, first), BoundCall(add_at, second)  # one type: compiled once
    for _ in range(3):
        calls[0]()
    calls[1]()
    assert (first.count[0], second.count[0]) == (3, 1)
    assert [part.row.depth_m[0] for part in first.parts] == [1.5, 3.0]
    assert [part.row.depth_m[0] for part in second.parts] == [2.0, 4.0]


@pytest.mark.skipif(INTERPRETED, reason="interpreted code needs the GIL")
def test_any_thread_can_call_the_c_function() -> None:
    bound = make(1.0)
    call = BoundCall(add_at, bound)
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(call.address)
    threads = [threading.Thread(target=function, args=(call.context,)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert bound.count[0] == 8
