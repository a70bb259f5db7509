"""Moving bodies whose poses a program writes in place in every tick."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.contact.moving import ROTATION_TOLERANCE
from hapscene.errors import SceneError, UsageWarning, no_such, warn
from hapscene.geometry import rigid

__all__ = ["MovingBodies", "warn_of_refused"]

_FLOAT: Final = np.dtype(np.float64)


class MovingBodies:
    """Poses of the bodies that a program moves. Made by `Renderer.moving_bodies`, passed to `Renderer.step`.

    Attributes:
        names: names of the bodies.
        body_names: names of all bodies of the scene.
        X_WB: (n, 4, 4) poses in the order of `names`; write into this array.
    """

    def __init__(
        self, names: Sequence[str], index_of: Mapping[str, int], X_WB: NDArray[np.float64], owner: object = None
    ) -> None:
        """Select bodies by name.

        Args:
            names: names of the bodies that move.
            index_of: index of every body of the scene, by name.
            X_WB: (b, 4, 4) present poses of all bodies.
            owner: identifies the renderer.

        Raises:
            SceneError: a body is unknown or listed twice.
        """
        self.names, self.body_names, self.owner = tuple(names), tuple(index_of), owner
        for name, count in Counter(self.names).items():
            if name not in index_of:
                raise SceneError(no_such("body", name, index_of))
            if count > 1:
                raise SceneError(f"body {name!r} is listed twice; list it once")
        self.index = np.array([index_of[name] for name in self.names], np.int64)
        # with the leading axis that a tick expects: (1, n, 4, 4)
        self.poses: NDArray[np.float64] = X_WB[self.index][None].copy()
        self.teleported = np.zeros(len(self.names), np.int64)
        self._warned = False

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
        """Make the body jump to its pose in the next tick, without colliding with or carrying the proxy on the way.

        Raises:
            SceneError: the body is not one of these.
        """
        if name not in self.names:
            raise SceneError(no_such("body", name, self.names))
        self.teleported[self.names.index(name)] = 1

    def warn_of_refused(self) -> None:
        """Warn once if a tick has refused a pose."""
        self._warned = self._warned or warn_of_refused(zip(self.names, self.poses[0], strict=True))

    def set_poses(self, poses: Mapping[str, ArrayLike]) -> None:
        """Write the poses (4, 4) of these bodies, in the order of `names`.

        Raises:
            SceneError: a pose is not a numeric (4, 4) matrix.
        """
        values: list[Any] = list(poses.values())
        with suppress(AttributeError, TypeError, ValueError, BufferError):  # eight times as fast as one by one
            if {*map(len, values)} == {4} and [X.dtype for X in values].count(_FLOAT) == len(values):
                self.poses[0].ravel()[:] = np.frombuffer(b"".join(values))
                return
        for slot, (name, X_WB) in zip(self.poses[0], poses.items(), strict=True):
            if np.shape(X_WB) != (4, 4):
                raise SceneError(f"pose of body {name!r} has shape {np.shape(X_WB)}, expected a (4, 4) matrix")
            try:
                slot[:] = X_WB
            except (TypeError, ValueError, OverflowError):
                raise SceneError(f"pose of body {name!r} is not numeric, expected a (4, 4) matrix") from None


def warn_of_refused(poses: Iterable[tuple[str, NDArray[np.float64]]]) -> bool:
    """Warn of the first pose (4, 4) that a tick would refuse, given with the names of the bodies; return whether one
    was found."""
    for name, X_WB in poses:
        try:
            rigid(X_WB, f"body {name!r}", tolerance=ROTATION_TOLERANCE)
        except SceneError as error:
            warn(f"{error}. The body stays at its last valid pose (Flag.POSE_REFUSED)", UsageWarning)
            return True
    return False
