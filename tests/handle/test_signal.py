import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene.handle.signal import row_of


@pytest.mark.parametrize("values", [[], [1, 2], [True], (1.5, np.nan), np.float32([1.0, 2.0]), range(3)])
def test_a_row_of_numbers_is_a_signal(values: object) -> None:
    row = row_of(values, "a")  # type: ignore[arg-type]
    assert row.dtype == np.float64
    np.testing.assert_array_equal(row, np.asarray(values))


@pytest.mark.parametrize("values", ["12", ["1"], None, [None], 3.0, [[1.0]], [[1], [1, 2]], [1j], {"a": 1}, [{}]])
def test_nothing_else_is(values: object) -> None:
    with pytest.raises(HandleError, match="acceleration must"):
        row_of(values, "acceleration")  # type: ignore[arg-type]
