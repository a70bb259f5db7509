"""Small arrays are packed into one buffer, which lives as long as any of the arrays."""

import gc
import weakref

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.records import BLOCK_MAX, OUTPUT, SMALL_B, block_of, pack_small_arrays, records


def test_a_tick_has_an_integer_number_of_samples() -> None:
    assert [block_of(*given) for given in ((1e-3, 1e4), (1e-3, 1e3), (1e-3, 1e3 * BLOCK_MAX), (1 / 44.1, 44.1))] == [
        *(10, 1, BLOCK_MAX, 1)
    ]
    wrong = (0.0, 1e4), (1e-3, -1e4), (1e-3, np.inf), (np.nan, 1e4), (1e-3, 1e3 * BLOCK_MAX + 1e3), (1e-3, 400.0)
    for given in (*wrong, (1e-3, 1e4 + 0.02)):
        with pytest.raises(HapsceneError):
            block_of(*given)


class _Owner:
    pass


def test_packed_arrays_are_equal_adjacent_and_keep_their_owner_alive() -> None:
    record, large = records(1, OUTPUT), np.arange(SMALL_B, dtype=np.float64)
    record.f_W_N = 1.0, 2.0, 3.0
    given = [np.arange(6.0).reshape(2, 3), record, np.zeros(0, np.int64), np.array([7], np.uint8), large]
    owner = _Owner()
    gone = weakref.ref(owner)
    found = pack_small_arrays(given, owner)
    for one, was in zip(found, given, strict=True):
        assert type(one) is type(was) and one.dtype == was.dtype and np.array_equal(one, was)
        assert one.flags.c_contiguous and one.flags.aligned and one.flags.writeable
    assert found[-1] is large
    moved = [one for one in found[:-1] if one.nbytes]  # empty arrays have no address
    assert not any(np.shares_memory(one, was) for one in moved for was in given)
    starts = [one.ctypes.data for one in moved]
    assert starts[0] % 64 == starts[1] % 64 == 0 and starts == sorted(starts)
    assert starts[-1] - starts[0] < sum(one.nbytes + 64 for one in moved)
    found[1].f_W_N[0, 0] = 5.0
    assert record.f_W_N[0, 0] == 1.0
    del owner, given
    kept = found.pop(0)
    del found, one, moved
    gc.collect()
    assert gone() is not None and kept[1, 2] == 5.0
    del kept, was
    gc.collect()
    assert gone() is None
