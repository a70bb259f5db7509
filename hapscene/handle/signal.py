"""What is given as a signal, checked."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import HandleError


def row_of(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """A signal (n,) of real numbers, which need not be finite.

    Raises:
        HandleError: something else, called `name`.
    """
    try:
        given = np.asarray(values)
        signal = given.astype(np.float64, casting="same_kind" if given.size else "unsafe")
    except (TypeError, ValueError):
        raise HandleError(f"{name} must be a row of real numbers, is {type(values).__name__}") from None
    if signal.ndim != 1:
        raise HandleError(f"{name} must have shape (n,), has {signal.shape}")
    return signal
