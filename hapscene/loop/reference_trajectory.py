"""The reference trajectory of a simulated hand: target position, grip and push force in each tick."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.device.sim.hand import Grip, grip_named
from hapscene.errors import PathError
from hapscene.geometry import numbers

__all__ = ["ReferenceTrajectory"]

NUMBER_MAX: Final = 1e12
"""Largest number in a reference trajectory, in any unit [1]: beyond any hand, and safe from overflow."""


@dataclass(frozen=True, eq=False)
class ReferenceTrajectory:
    """Reference of a hand over n ticks. The target moves linearly between ticks.

    Attributes:
        target_W_m: (n, 3) target position of the hand.
        grip: (n, 3) stiffness [N/m], damping [N·s/m] and mass [kg] of the hand.
        push_W_N: (n, 3) force of the hand in addition to its spring and damper.

    Raises:
        PathError: an array has a wrong shape or is not finite, or a grip is negative.
    """

    target_W_m: NDArray[np.float64]
    grip: NDArray[np.float64]
    push_W_N: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = numbers(self.target_W_m).size // 3
        for name in ("target_W_m", "grip", "push_W_N"):
            array = numbers(getattr(self, name))
            if array.shape != (n, 3) or n == 0:
                raise PathError(f"{name} must have shape ({max(n, 1)}, 3), one row per tick; it has {array.shape}")
            if not (np.abs(array) <= NUMBER_MAX).all():
                raise PathError(f"{name} must be finite, with absolute values up to {NUMBER_MAX:g}")
            object.__setattr__(self, name, np.ascontiguousarray(array))
        if (self.grip < 0.0).any():
            raise PathError("grip must not be negative: stiffness, damping and mass of the hand are at least 0")

    def __repr__(self) -> str:
        return f"<ReferenceTrajectory: {len(self):,} ticks>"

    def __len__(self) -> int:
        return len(self.target_W_m)

    @classmethod
    def along(
        cls, target_W_m: ArrayLike, grip: str | Grip | ArrayLike = "light", push_W_N: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> "ReferenceTrajectory":
        """Follow a path (n, 3) [m] with one grip, given by name or as a row per tick, and a constant push (3,) [N].

        Raises:
            HapsceneError: the grip is unknown.
            PathError: the path is not (n, 3) finite numbers.
        """
        path = np.atleast_2d(numbers(target_W_m))
        if isinstance(grip, str):
            grip = grip_named(grip)
        rows = grip.row() if isinstance(grip, Grip) else numbers(grip)
        return cls(path, _rows(rows, len(path)), _rows(numbers(push_W_N), len(path)))

    @classmethod
    def hold(
        cls,
        target_W_m: Sequence[float],
        count: int,
        grip: str | Grip = "light",
        *,
        push_W_N: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> "ReferenceTrajectory":
        """Stay at one position (3,) [m] for `count` ticks.

        Raises:
            HapsceneError: the grip is unknown.
            PathError: the position is not three finite numbers, or `count` is not a positive integer.
        """
        if not isinstance(count, int | np.integer) or count < 1:
            raise PathError(f"count must be a positive integer number of ticks, is {count!r}")
        return cls.along(_rows(numbers(target_W_m), int(count)), grip, push_W_N)


def _rows(row: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return one row (3,) as (count, 3); an array of rows is returned unchanged."""
    return np.tile(row, (count, 1)) if row.ndim == 1 else row
