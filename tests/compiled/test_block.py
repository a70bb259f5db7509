"""Arrays that compiled code receives by one pointer."""

import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from hapscene.compiled.block import by_pointer
from hapscene.compiled.native import INTERPRETED, native
from hapscene.errors import HapsceneError

pytestmark = pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT")


@by_pointer
class Arrays(NamedTuple):
    """A packed array, a table, and arrays with gaps."""

    packed: Any
    table: Any
    every: Any
    columns: Any
    small: Any


@native
def gather(arrays: Any, i: int, j: int) -> tuple[float, float, float, float, int, int]:
    sizes = arrays.packed.size + arrays.table.size + arrays.every.size + arrays.columns.size + arrays.small.itemsize
    row, column = arrays.table[i], arrays.columns[:, j]
    return arrays.packed[i], row[j], arrays.every[i], column[i] + arrays.columns[i, j], arrays.small[i], sizes


def test_each_element_is_found() -> None:
    table = np.arange(24.0).reshape(4, 6)
    arrays = Arrays(np.arange(4.0) + 0.5, table, np.arange(12.0)[::3], table[:, ::2], np.arange(5, dtype=np.int32))
    for i, j in ((0, 0), (1, 2), (3, 1)):
        assert gather(arrays, i, j) == (i + 0.5, 6.0 * i + j, 3.0 * i, 2.0 * (6 * i + 2 * j), i, 4 + 24 + 4 + 12 + 4)
    count = sys.getrefcount(arrays.address)
    gather(arrays, 0, 0)
    after = sys.getrefcount(arrays.address)
    assert after == count
    with pytest.raises(HapsceneError, match="Arrays: every field must be an array"):
        gather(arrays._replace(every=1.0), 0, 0)
