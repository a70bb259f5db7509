"""What a program is told of a contact: which body, where, and what the tool does to it."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.geometry import numbers
from hapscene.records import ROW

Vector3 = NDArray[np.float64]


class Impulse(NamedTuple):
    """What the tool has given a body since the last reset, in W.

    Attributes:
        linear_N_s: (3,) impulse [N·s].
        angular_N_m_s: (3,) angular impulse about the body's origin, tick by tick where that was [N·m·s].
    """

    linear_N_s: Vector3
    angular_N_m_s: Vector3


class Contact:
    """A contact of one tick, the caller's to keep.

    The force on the body is that of the effects of contact alone: no field of the scene, no damper of the device, and
    nothing is cut to what the device can do. Where several bodies hold the tool, it is the share of this one.
    """

    __slots__ = ("_bodies", "_row", "_swatches")

    def __init__(self, row: bytes, bodies: tuple[str, ...], swatches: tuple[str, ...]) -> None:
        """`row` is one `ROW`: its bytes, since to copy a record takes longer than a tick."""
        self._row, self._bodies, self._swatches = row, bodies, swatches

    def __repr__(self) -> str:
        place = ", ".join(f"{v:.4g}" for v in self.p_W_m)
        return f"<Contact: body {self.body!r}, face {self.face}, {self.swatch!r}, at ({place}) m>"

    @property
    def body(self) -> str:
        """Name of the touched body."""
        return self._bodies[int(self._number("body"))]

    @property
    def face(self) -> int:
        """Touched face, an index into the faces of its mesh."""
        return int(self._number("face"))

    @property
    def swatch(self) -> str:
        """Name of the touched swatch."""
        return self._swatches[int(self._number("swatch"))]

    @property
    def p_W_m(self) -> Vector3:
        """(3,) the proxy, on the surface [m]: where the force acts."""
        return self._vector("p_WP_m")

    @property
    def nhat_W(self) -> Vector3:
        """(3,) unit normal out of the surface."""
        return self._vector("nhat_W")

    @property
    def depth_m(self) -> float:
        """How deep the tool is inside [m]."""
        return float(self._number("depth_m"))

    @property
    def slip_m_s(self) -> float:
        """Speed of the proxy over the body, low-passed [m/s]."""
        return float(self._number("slip_m_s"))

    @property
    def began(self) -> bool:
        """Whether this is the first tick of the contact."""
        return bool(self._number("began"))

    @property
    def f_body_W_N(self) -> Vector3:
        """(3,) force of the tool on the body [N]."""
        return self._vector("f_body_W_N")

    def tau_body_W_Nm(self, about_W_m: ArrayLike) -> Vector3:
        """(3,) torque of the tool on the body about a point (3,) of W, such as its centre of mass [N·m].

        Raises:
            PathError: a point that is not of numbers.
        """
        return np.cross(self.p_W_m - numbers(about_W_m), self.f_body_W_N)

    def _vector(self, name: str) -> Vector3:
        return np.array(self._number(name), np.float64)

    def _number(self, name: str) -> Any:
        return np.frombuffer(self._row, ROW)[name][0]
