"""How fast the slowest-dying mode of a small motion grows, read from the motion itself.

A linear loop moves as a sum of modes, y_k = Σ c_i z_i^k. The shifts of such a signal span a space that one step forward
maps onto itself; the map's eigenvalues are the z_i (Kung 1978; Roy & Kailath 1989, ESPRIT). Taken from motion that is
exact to rounding, they are exact to about ten digits.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

NOISE: Final = 1e-9
"""Parts of the signal weaker than this, over its strongest, are rounding [1]."""


def growth(y: NDArray[np.float64], order: int) -> float:
    """Natural logarithm of the largest |z_i|, per sample.

    Args:
        y: (n,) the motion about its rest, n > 2 order.
        order: most modes that there are.
    """
    rows = len(y) // 2
    shifts = np.lib.stride_tricks.sliding_window_view(y, rows).T
    left, weight, _ = np.linalg.svd(shifts, full_matrices=False)
    kept = min(order, int(np.count_nonzero(weight > NOISE * weight[0])))
    space = left[:, :kept]
    step, *_ = np.linalg.lstsq(space[:-1], space[1:], rcond=None)
    return float(np.log(np.abs(np.linalg.eigvals(step)).max()))
