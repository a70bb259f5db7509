"""What a hand means to do: where it wants the tool, how firmly it holds it and how hard it pushes, tick by tick."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.device.sim.hand import Grip, grip_named
from hapscene.errors import PathError
from hapscene.geometry import numbers

__all__ = ["Intent"]

NUMBER_MAX: Final = 1e12
"""Largest number of an intention, of whatever unit [1]: beyond any hand, and nothing made of it overflows."""


@dataclass(frozen=True, eq=False)
class Intent:
    """A hand's intention over n ticks. Between ticks its target moves on straight.

    Attributes:
        target_W_m: (n, 3) where the hand means the tool to be.
        grip: (n, 3) spring [N/m], damper [N·s/m] and mass [kg] of the hand.
        push_W_N: (n, 3) force of the hand beside its spring and damper.

    Raises:
        PathError: arrays of another shape, not finite, or with a negative grip.
    """

    target_W_m: NDArray[np.float64]
    grip: NDArray[np.float64]
    push_W_N: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = numbers(self.target_W_m).size // 3
        for name in ("target_W_m", "grip", "push_W_N"):
            array = numbers(getattr(self, name))
            if array.shape != (n, 3) or n == 0:
                raise PathError(f"intent: {name} must be ({max(n, 1)}, 3), a row per tick; it is {array.shape}")
            if not (np.abs(array) <= NUMBER_MAX).all():
                raise PathError(f"intent: {name} must be finite, and at most {NUMBER_MAX:g} in size")
            object.__setattr__(self, name, np.ascontiguousarray(array))
        if (self.grip < 0.0).any():
            raise PathError("intent: a grip's spring, damper and mass are at least 0")

    def __repr__(self) -> str:
        return f"<Intent: {len(self):,} ticks>"

    def __len__(self) -> int:
        return len(self.target_W_m)

    @classmethod
    def along(
        cls, target_W_m: ArrayLike, grip: str | Grip | ArrayLike = "light", push_W_N: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> "Intent":
        """Follow a path (n, 3) [m] with one grip, its name or a row per tick, and a constant push (3,) [N].

        Raises:
            HapsceneError: no grip of this name.
            PathError: a path that is not (n, 3) finite numbers.
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
    ) -> "Intent":
        """Mean one place (3,) [m] for `count` ticks.

        Raises:
            HapsceneError: no grip of this name.
            PathError: not three finite numbers, or a count that is not a whole number above 0.
        """
        if not isinstance(count, int | np.integer) or count < 1:
            raise PathError(f"intent: count must be a whole number of ticks above 0, is {count!r}")
        return cls.along(_rows(numbers(target_W_m), int(count)), grip, push_W_N)

    def then(self, other: "Intent") -> "Intent":
        """This, and after it another."""
        return Intent(
            np.concatenate((self.target_W_m, other.target_W_m)),
            np.concatenate((self.grip, other.grip)),
            np.concatenate((self.push_W_N, other.push_W_N)),
        )


def _rows(row: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """One row (3,) as (count, 3); what has rows of its own stays as it is."""
    return np.tile(row, (count, 1)) if row.ndim == 1 else row
