"""Conversion between the coordinates of a client and those of the scene: up axis, handedness and unit of length."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.bridge.packets import PacketError
from hapscene.geometry import rotation_of
from hapscene.io.files import Json

__all__ = ["Convention"]

_AXES: Final = {
    ("z", "right"): ((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # hapscene, MuJoCo, Blender
    ("y", "right"): ((1, 0, 0), (0, 0, -1), (0, 1, 0)),  # Godot, three.js, glTF
    ("y", "left"): ((1, 0, 0), (0, 0, 1), (0, 1, 0)),  # Unity
    ("z", "left"): ((1, 0, 0), (0, -1, 0), (0, 0, 1)),  # Unreal
}
"""Rows of the matrix C, with p_W = C p."""


@dataclass(frozen=True)
class Convention:
    """Coordinate convention of a client.

    Attributes:
        C: (3, 3) matrix from client axes to world axes; a reflection for a left-handed client.
        metre: length of the client's unit [m].
    """

    C: NDArray[np.float64]
    metre: float

    @classmethod
    def of(cls, hello: dict[str, Json]) -> "Convention":
        """The convention in the HELLO of a client: `up` y or z, `handed` right or left, `metres` per unit.

        Raises:
            PacketError: an invalid value.
        """
        up, handed, metres = hello.get("up", "z"), hello.get("handed", "right"), hello.get("metres", 1.0)
        if (str(up), str(handed)) not in _AXES:
            raise PacketError(f"up {up!r:.20}, handed {handed!r:.20}: expected y or z, and right or left")
        if isinstance(metres, bool) or not isinstance(metres, int | float) or not 1e-6 <= metres <= 1e6:
            raise PacketError(f"metres {metres!r:.20}: expected a number of metres per unit from 1e-6 to 1e6")
        return cls(np.array(_AXES[up, handed], np.float64), float(metres))

    @cached_property
    def _sense(self) -> float:
        """−1 if the client is left-handed, else 1."""
        return float(np.sign(np.linalg.det(self.C)))

    def position(self, p: ArrayLike) -> NDArray[np.float64]:
        """Convert a position (3,) or positions (n, 3), or velocities, to W [m]."""
        return self.metre * (np.asarray(p, np.float64) @ self.C.T)

    def angular(self, w: ArrayLike) -> NDArray[np.float64]:
        """Convert an angular velocity or impulse (3,) to W."""
        return self._sense * (self.C @ np.asarray(w, np.float64))

    def vector(self, f: ArrayLike) -> NDArray[np.float64]:
        """Convert a vector without a unit of length (3,), such as a force, impulse or normal, to W."""
        return self.C @ np.asarray(f, np.float64)

    def pose(self, p: ArrayLike, q: ArrayLike) -> NDArray[np.float64]:
        """Convert a position and a quaternion x y z w to X_WB (4, 4). An invalid quaternion gives NaN, which is
        refused later."""
        turn = np.asarray(q, np.float64)
        R = rotation_of(turn) if turn.any() else np.full((3, 3), np.nan)
        X_WB = np.eye(4)
        X_WB[:3, :3] = self.C @ R @ self.C.T
        X_WB[:3, 3] = self.position(p)
        return X_WB

    def inertia(self, inertia: ArrayLike) -> NDArray[np.float64]:
        """Convert an inertia (3,) or (3, 3) about the centre of mass, in client body axes, to (3, 3) [kg·m²]."""
        given = np.asarray(inertia, np.float64)
        return self.C @ (np.diag(given) if given.shape == (3,) else given) @ self.C.T

    def client_position(self, p_W: ArrayLike) -> tuple[float, ...]:
        return tuple((self.C.T @ np.asarray(p_W, np.float64) / self.metre).tolist())

    def client_vector(self, f_W: ArrayLike) -> tuple[float, ...]:
        return tuple((self.C.T @ np.asarray(f_W, np.float64)).tolist())

    def client_angular(self, L_W: ArrayLike) -> tuple[float, ...]:
        return tuple((self._sense * (self.C.T @ np.asarray(L_W, np.float64))).tolist())
