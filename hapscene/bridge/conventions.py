"""A program's frame and unit, said once: which axis is up, which hand, how many metres a unit is."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.bridge.packets import PacketError
from hapscene.geometry import rotation_of

__all__ = ["Convention"]

_AXES: Final = {
    ("z", "right"): ((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # hapscene, MuJoCo, Blender
    ("y", "right"): ((1, 0, 0), (0, 0, -1), (0, 1, 0)),  # Godot, three.js, glTF
    ("y", "left"): ((1, 0, 0), (0, 0, 1), (0, 1, 0)),  # Unity
    ("z", "left"): ((1, 0, 0), (0, -1, 0), (0, 0, 1)),  # Unreal
}
"""Rows of C, by which p_W = C p."""


@dataclass(frozen=True)
class Convention:
    """A client's frame.

    Attributes:
        C: (3, 3) from the client's axes to those of W; a reflection for a left-handed one.
        metre: metres that its unit is.
    """

    C: NDArray[np.float64]
    metre: float

    @classmethod
    def of(cls, hello: dict[str, Any]) -> "Convention":
        """As a client's HELLO says it: `up` y or z, `handed` right or left, `metres` in a unit.

        Raises:
            PacketError: something else.
        """
        up, handed, metres = hello.get("up", "z"), hello.get("handed", "right"), hello.get("metres", 1.0)
        if (str(up), str(handed)) not in _AXES:
            raise PacketError(f"up is y or z and handed right or left, not {up!r:.20} and {handed!r:.20}")
        if isinstance(metres, bool) or not isinstance(metres, int | float) or not 1e-6 <= metres <= 1e6:
            raise PacketError(f"metres in a unit is a number from 1e-6 to 1e6, not {metres!r:.20}")
        return cls(np.array(_AXES[up, handed], np.float64), float(metres))

    @cached_property
    def _sense(self) -> float:
        """−1 where turning right becomes turning left."""
        return float(np.sign(np.linalg.det(self.C)))

    def place(self, p: ArrayLike) -> NDArray[np.float64]:
        """(3,) in W [m], or (n, 3); also velocities."""
        return self.metre * (np.asarray(p, np.float64) @ self.C.T)

    def turning(self, w: ArrayLike) -> NDArray[np.float64]:
        """(3,) of what turns: angular velocities, angular impulses."""
        return self._sense * (self.C @ np.asarray(w, np.float64))

    def force(self, f: ArrayLike) -> NDArray[np.float64]:
        """(3,) of what points and has no length in it: forces, impulses, normals."""
        return self.C @ np.asarray(f, np.float64)

    def pose(self, p: ArrayLike, q: ArrayLike) -> NDArray[np.float64]:
        """X_WB (4, 4), from a place and a quaternion x y z w; of length 0 or not finite: NaN, which is refused."""
        turn = np.asarray(q, np.float64)
        R = rotation_of(turn) if turn.any() else np.full((3, 3), np.nan)
        X_WB = np.eye(4)
        X_WB[:3, :3] = self.C @ R @ self.C.T
        X_WB[:3, 3] = self.place(p)
        return X_WB

    def inertia(self, inertia: ArrayLike) -> NDArray[np.float64]:
        """(3, 3) about the centre of mass, from (3,) or (3, 3) in the client's body axes [kg·m²]."""
        given = np.asarray(inertia, np.float64)
        return self.C @ (np.diag(given) if given.shape == (3,) else given) @ self.C.T

    def told_place(self, p_W: ArrayLike) -> tuple[float, ...]:
        return tuple((self.C.T @ np.asarray(p_W, np.float64) / self.metre).tolist())

    def told_force(self, f_W: ArrayLike) -> tuple[float, ...]:
        return tuple((self.C.T @ np.asarray(f_W, np.float64)).tolist())

    def told_turning(self, L_W: ArrayLike) -> tuple[float, ...]:
        return tuple((self._sense * (self.C.T @ np.asarray(L_W, np.float64))).tolist())
