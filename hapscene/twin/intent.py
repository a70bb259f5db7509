"""What a hand means to do: where it wants the tool, how firmly it holds it and how hard it pushes, tick by tick."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.argument import numbers
from hapscene.device.hand import Grip, grip_named
from hapscene.errors import PathError


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
        n = len(self.target_W_m)
        for name in ("target_W_m", "grip", "push_W_N"):
            array = numbers(getattr(self, name))
            if array.shape != (n, 3) or n == 0 or not np.isfinite(array).all():
                raise PathError(f"intent: {name} must be ({n}, 3) finite numbers, a row per tick; it is {array.shape}")
            object.__setattr__(self, name, np.ascontiguousarray(array))
        if (self.grip < 0.0).any():
            raise PathError("intent: a grip's spring, damper and mass are at least 0")

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
        path = numbers(target_W_m).reshape(-1, 3)
        if isinstance(grip, str):
            grip = grip_named(grip)
        rows = grip.row() if isinstance(grip, Grip) else numbers(grip)
        return cls(path, np.broadcast_to(rows, path.shape), np.broadcast_to(numbers(push_W_N), path.shape))

    @classmethod
    def hold(
        cls,
        target_W_m: Sequence[float],
        count: int,
        grip: str | Grip = "light",
        push_W_N: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> "Intent":
        """Mean one place (3,) [m] for `count` ticks."""
        return cls.along(np.tile(numbers(target_W_m), (count, 1)), grip, push_W_N)

    def then(self, other: "Intent") -> "Intent":
        """This, and after it another."""
        return Intent(
            np.concatenate((self.target_W_m, other.target_W_m)),
            np.concatenate((self.grip, other.grip)),
            np.concatenate((self.push_W_N, other.push_W_N)),
        )
