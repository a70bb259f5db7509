"""Vectors as tuples of three floats, compiled; and what a caller gives, checked: numbers, positions, rigid poses."""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import BLOCK_MAX, REACH_MAX_M
from hapscene.errors import HapsceneError, PathError, SceneError
from hapscene.native import native
from hapscene.scene.body import RIGID_TOLERANCE

Vector = tuple[float, float, float]


@native
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@native
def sub(a: Vector, b: Vector) -> Vector:
    """a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@native
def along(a: Vector, s: float, b: Vector) -> Vector:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@native
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@native
def norm(a: Vector) -> float:
    """Length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


# What a caller gives the renderer, checked: positions, poses, rates. Each answers in one sentence what is wrong.


_WHOLE: Final = 1e-6
"""How far a tick's samples may be from a whole number [1]: rates such as 44.1 kHz have no exact period."""


def block_of(tick_s: float, a_rate_Hz: float) -> int:
    """Acceleration samples in a tick."""
    if not (0.0 < tick_s < np.inf and 0.0 < a_rate_Hz < np.inf):
        raise HapsceneError(f"tick_s and a_rate_Hz must be finite and above 0, are {tick_s} and {a_rate_Hz}")
    exact = tick_s * a_rate_Hz
    block = round(exact)
    if not 1 <= block <= BLOCK_MAX or abs(exact - block) > _WHOLE * exact:
        raise HapsceneError(
            f"a tick of {tick_s:g} s holds {exact:g} samples at a_rate_Hz={a_rate_Hz:g}; it must be a whole number "
            f"from 1 to {BLOCK_MAX}, as 10 is at 0.001 s and 10000 Hz"
        )
    return block


def numbers(values: ArrayLike) -> NDArray[np.float64]:
    """An array of float64, or a readable error."""
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError):
        raise PathError(f"positions and poses are arrays of numbers, not {type(values).__name__}") from None


def positions(p_WT: NDArray[np.float64]) -> NDArray[np.float64]:
    """A path (n, 3), checked."""
    if p_WT.ndim != 2 or p_WT.shape[1] != 3 or len(p_WT) == 0:
        raise PathError(f"a path must be (n, 3) positions in metres, n ≥ 1; it is {p_WT.shape}")
    bad = ~np.isfinite(p_WT).all(axis=1)
    if bad.any():
        raise PathError(f"the path has {bad.sum()} positions that are not finite, the first at row {bad.argmax()}")
    far = np.abs(p_WT) > REACH_MAX_M
    if far.any():
        row, axis = np.argwhere(far)[0]
        raise PathError(
            f"the path is at {'xyz'[axis]} = {p_WT[row, axis]:g} m in row {row}; expected at most {REACH_MAX_M:g} m "
            "(is it in mm?)"
        )
    return p_WT


def rigid(X_WB: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Poses (n, 4, 4), checked: each a rotation and a translation."""
    R = X_WB[:, :3, :3]
    with np.errstate(invalid="ignore"):
        ok = np.isfinite(X_WB).all(axis=(1, 2)) & (np.linalg.det(R) > 0.0)
    ok &= (np.abs(X_WB[:, 3] - (0.0, 0.0, 0.0, 1.0)) < RIGID_TOLERANCE).all(axis=1)
    ok &= (np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)) < RIGID_TOLERANCE).all(axis=(1, 2))
    if not ok.all():
        raise SceneError(
            f"poses of body {name!r}: the one of tick {int(ok.argmin())} is not a rotation and a translation"
        )
    far = (np.abs(X_WB[:, :3, 3]) > REACH_MAX_M).any(axis=1)
    if far.any():
        raise SceneError(
            f"poses of body {name!r}: the one of tick {int(far.argmax())} is more than {REACH_MAX_M:g} m away "
            "(is it in mm?)"
        )
    return X_WB
