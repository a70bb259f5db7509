"""Bodies bound to slots, whose poses a program writes in place, tick by tick."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError, no_such

__all__ = ["MovingBodies"]


class MovingBodies:
    """The bodies that a program moves: made by `Renderer.moving`, given to `Renderer.step`.

    Attributes:
        names: of the bodies; body_names: of all bodies of their scene.
        X_WB: (n, 4, 4) their poses, in that order; write into it.
    """

    def __init__(
        self, names: Sequence[str], index_of: Mapping[str, int], X_WB: NDArray[np.float64], owner: object = None
    ) -> None:
        """`index_of` has the numbers of the scene's bodies, `X_WB` (b, 4, 4) their present poses; `owner` is a mark.

        Raises:
            SceneError: an unknown body, or one that is named twice.
        """
        self.names, self.body_names, self.owner = tuple(names), tuple(index_of), owner
        for name, count in Counter(self.names).items():
            if name not in index_of:
                raise SceneError(no_such("body", name, index_of))
            if count > 1:
                raise SceneError(f"body {name!r} is named twice; each has one slot")
        self.index = np.array([index_of[name] for name in self.names], np.int64)
        self.poses: NDArray[np.float64] = X_WB[self.index][None].copy()  # as the tick takes them: (1, n, 4, 4)
        self.teleported = np.zeros(len(self.names), np.int64)

    def __repr__(self) -> str:
        return f"<MovingBodies: {', '.join(self.names)}>"

    @property
    def X_WB(self) -> NDArray[np.float64]:
        slots: NDArray[np.float64] = self.poses[0]
        return slots

    @X_WB.setter
    def X_WB(self, poses: ArrayLike) -> None:
        self.poses[0] = poses

    def teleport(self, name: str) -> None:
        """In the next tick the body appears at its pose: on its way there it meets nothing, and takes nothing along.

        Raises:
            SceneError: no such body among these.
        """
        if name not in self.names:
            raise SceneError(no_such("body", name, self.names))
        self.teleported[self.names.index(name)] = 1

    def take(self, poses: Mapping[str, ArrayLike]) -> None:
        """Write poses (4, 4) of these bodies, in their order.

        Raises:
            SceneError: another shape.
        """
        for slot, (name, X_WB) in zip(self.poses[0], poses.items(), strict=True):
            if np.shape(X_WB) != (4, 4):
                raise SceneError(f"pose of body {name!r}: a pose is a matrix (4, 4), not {np.shape(X_WB)}")
            try:
                slot[:] = X_WB
            except (TypeError, ValueError, OverflowError):
                raise SceneError(f"pose of body {name!r}: a pose is a matrix (4, 4) of numbers") from None
