"""The contact that `Renderer.step` reports, and contact events found in the rows of ticks."""

import math
from collections.abc import Sequence
from struct import Struct
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.geometry import numbers
from hapscene.records import ROW, Records

__all__ = ["Contact", "ContactEvent", "Impulse", "events_of", "spread_force"]

Vector3 = NDArray[np.float64]

SAMPLES: Final = 4
"""Least samples along the radius of the patch [count]; with 2, the weights of a coarse mesh are 5 % off."""

CUTS_MAX: Final = 16
"""Most parts into which an edge is cut [count]. It bounds the time on a face that is much larger than the patch."""

_OFFSET: Final = {name: ROW.fields[name][1] for name in ROW.names or () if ROW.fields is not None}
_FLOAT: Final = Struct("=d").unpack_from
_INTEGER: Final = Struct("=q").unpack_from


class Impulse(NamedTuple):
    """Impulse of the tool on a body since the last reset, in W.

    Attributes:
        linear_N_s: (3,) linear impulse [N·s].
        angular_N_m_s: (3,) angular impulse about the origin of the body at each tick [N·m·s].
    """

    linear_N_s: Vector3
    angular_N_m_s: Vector3


class Contact:
    """The contact of one tick. A copy, which you may keep.

    The force on the body comes from the effects of contact alone. It excludes effects of the scene and device
    damping, and it is not limited to what the device can output. If several bodies are in contact, it is the share of
    this body.
    """

    __slots__ = ("_bodies", "_floats", "_row", "_swatches")

    def __init__(self, row: bytes, bodies: tuple[str, ...], swatches: tuple[str, ...]) -> None:
        """`row`: bytes of one `ROW`. Copying a record instead of bytes would take longer than a tick."""
        self._row, self._bodies, self._swatches = row, bodies, swatches
        self._floats: Vector3 | None = None  # view of the row as floats, made on demand; all fields have eight bytes

    def __repr__(self) -> str:
        place = ", ".join(f"{v:.4g}" for v in self.p_W_m)
        return f"<Contact: body {self.body!r}, face {self.face}, {self.swatch!r}, at ({place}) m>"

    @property
    def body(self) -> str:
        """Name of the touched body."""
        return self._bodies[self._integer("body")]

    @property
    def face(self) -> int:
        """Touched face, an index into the faces of the mesh."""
        return self._integer("face")

    @property
    def swatch(self) -> str:
        """Name of the touched swatch."""
        return self._swatches[self._integer("swatch")]

    @property
    def p_W_m(self) -> Vector3:
        """(3,) contact point on the surface, where the force acts [m]. A ball that touches several faces has one
        contact point on each; this is the one that pushes most."""
        return self._vector("p_WC_m")

    @property
    def nhat_W(self) -> Vector3:
        """(3,) unit normal out of the surface."""
        return self._vector("nhat_W")

    @property
    def depth_m(self) -> float:
        """Penetration depth: distance from the device position to the proxy [m]."""
        return self._float("depth_m")

    @property
    def slip_m_s(self) -> float:
        """Low-passed slip speed of the proxy relative to the body [m/s]."""
        return self._float("slip_m_s")

    @property
    def began(self) -> bool:
        """Whether this is the first tick of the contact."""
        return bool(self._integer("began"))

    @property
    def f_body_W_N(self) -> Vector3:
        """(3,) force of the tool on the body [N]."""
        return self._vector("f_body_W_N")

    def tau_body_W_Nm(self, about_W_m: ArrayLike) -> Vector3:
        """Return the torque (3,) of the tool on the body about a point (3,) in W, such as its centre of mass [N·m].

        Raises:
            PathError: the point is not numeric.
        """
        return np.cross(self.p_W_m - numbers(about_W_m), self.f_body_W_N)

    @property
    def patch_radius_m(self) -> float:
        """Radius of the contact patch [m]: √(r · depth) of a tip of radius r (Hertz 1882), at most r. A point has 0."""
        radius_m = float(np.linalg.norm(self._vector("p_WP_m") - self.p_W_m))
        return min(math.sqrt(radius_m * self.depth_m), radius_m)

    def vertex_forces_N(self, vertices_W_m: ArrayLike, faces: ArrayLike) -> Vector3:
        """Distribute the force on the body over the contact patch, for a simulation of a soft body.

        Sum and moment are those of the force at the contact point. With a point load instead, the displacement grows
        as the mesh is refined. See `spread_force`.

        Args:
            vertices_W_m: (N, 3) present positions of all vertices of the body in W [m].
            faces: (M, 3) faces of its mesh.

        Returns:
            (N, 3) forces on the vertices in W [N].

        Raises:
            PathError: an argument is not numeric.
            SceneError: the arrays are not (N, 3) and (M, 3), or the touched face is not among the faces.
        """
        vertices, triples = numbers(vertices_W_m), np.asarray(faces)
        given = vertices.shape, triples.shape
        if [shape[1:] for shape in given] != [(3,), (3,)] or self.face >= len(triples):
            raise SceneError(
                f"vertices_W_m and faces have the shapes {given[0]} and {given[1]}; expected (N, 3) and (M, 3) of the "
                f"mesh of body {self.body!r}, whose face {self.face} is touched"
            )
        return spread_force(
            vertices, triples, self.face, p_m=self.p_W_m, f_N=self.f_body_W_N, radius_m=self.patch_radius_m
        )

    def _vector(self, name: str) -> Vector3:
        if self._floats is None:
            self._floats = np.frombuffer(self._row, np.float64)
        first = _OFFSET[name] // 8
        return self._floats[first : first + 3]

    def _integer(self, name: str) -> int:
        number: int = _INTEGER(self._row, _OFFSET[name])[0]
        return number

    def _float(self, name: str) -> float:
        number: float = _FLOAT(self._row, _OFFSET[name])[0]
        return number


_EVENT_FIELDS: Final = ("body", "swatch", "began", "approach_m_s")

Kind = Literal["began", "crossed", "ended"]


class ContactEvent(NamedTuple):
    """One contact event.

    Attributes:
        tick: number of the tick.
        kind: "began", "crossed" (to another body or swatch without leaving the surface) or "ended".
        body, swatch: names of what is touched, or was touched if the contact ended.
        approach_m_s: speed into the surface if the contact began, otherwise 0 [m/s].
    """

    tick: int
    kind: Kind
    body: str
    swatch: str
    approach_m_s: float


def events_of(
    rows: Records, first: int, since: int, body_names: Sequence[str], swatch_names: Sequence[str]
) -> list[ContactEvent]:
    """Return the events from tick `since` on in rows (n,) ROW, of which the first is tick number `first`.

    A contact that continues in the first row is no event, unless that row is tick 0.
    """
    found = []
    before = (-1, -1)
    for tick, row in enumerate(zip(*(rows[name].tolist() for name in _EVENT_FIELDS), strict=True), first):
        body, swatch, began, approach_m_s = row
        now = body, swatch
        if tick == first > 0:
            before = now
        kind: Kind | None = None
        if now[0] >= 0 and (began or before[0] < 0):
            kind = "began"
        elif now[0] < 0 <= before[0]:
            kind = "ended"
        elif now != before and now[0] >= 0:
            kind = "crossed"
        if kind is not None and tick >= since:
            at = before if kind == "ended" else now
            name = swatch_names[at[1]] if at[1] < len(swatch_names) else ""
            speed = approach_m_s if kind == "began" else 0.0
            found.append(ContactEvent(tick, kind, body_names[at[0]], name, speed))
        before = now
    return found


def spread_force(
    vertices_m: Vector3, faces: NDArray[np.integer], face: int, *, p_m: Vector3, f_N: Vector3, radius_m: float
) -> Vector3:
    """Distribute a force `f_N` (3,) at `p_m` (3,) on `face` over vertices (N, 3); returns their forces (N, 3) [N].

    The displacement under a point load on a discretised soft body grows without bound as the mesh is refined. The
    pressure under a ball of radius r, pressed d deep into an elastic body, is √(1 − ρ²/a²) within the radius a = √(r d)
    (Hertz 1882), and zero outside. Each vertex gets the integral of the pressure times its shape function, which is
    linear on each face. A correction keeps the moment exactly, as in the RBE3 element of Nastran.

    Sum and moment are exact. If the shape has moved on since the contact, the force acts at the nearest point of the
    face. A patch that no sample hits loads the corners of the face.
    """
    triangle = vertices_m[faces[face]]
    edges = triangle[1:] - triangle[0]
    bary = np.linalg.lstsq(edges.T, p_m - triangle[0], rcond=None)[0]
    bary = np.clip([1.0 - bary.sum(), *bary], 0.0, None)
    bary /= bary.sum()
    p_m = bary @ triangle
    count = len(vertices_m)
    weight = _pressure(vertices_m, faces, p_m, np.cross(*edges), radius_m)
    if not weight.any():
        weight[faces[face]] = bary
    used = np.flatnonzero(weight)
    w = weight[used] / weight.sum()
    arm = vertices_m[used] - w @ vertices_m[used]
    inertia = np.einsum("i,ij,ij", w, arm, arm) * np.eye(3) - np.einsum("i,ij,ik->jk", w, arm, arm)
    turn = np.linalg.lstsq(inertia, np.cross(p_m - w @ vertices_m[used], f_N), rcond=1e-12)[0]
    force = np.zeros((count, 3))
    force[used] = w[:, None] * (f_N + np.cross(turn, arm))
    return force


def _pressure(vertices_m: Vector3, faces: NDArray[np.integer], p_m: Vector3, out: Vector3, radius_m: float) -> Vector3:
    """Return the integral (N,) of pressure times shape function of each vertex, over the faces on the same side."""
    away = vertices_m - p_m
    beyond = (away > radius_m) @ (1, 2, 4) + (away < -radius_m) @ (8, 16, 32)  # sides of the cube around the patch
    faces = faces[np.bitwise_and.reduce(beyond[faces.T]) == 0]
    corner = vertices_m[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    front = normal @ out > 0.0
    faces, corner, normal = faces[front], corner[front], normal[front]
    if radius_m <= 0.0 or len(faces) == 0:
        return np.zeros(len(vertices_m))
    longest_m = float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max())
    shape = _centroids(int(np.clip(np.ceil(SAMPLES * longest_m / radius_m), 1, CUTS_MAX)))
    distance = np.linalg.norm(shape @ corner - p_m, axis=2) / radius_m
    pressure = np.sqrt(np.maximum(1.0 - distance**2, 0.0)) * (np.linalg.norm(normal, axis=1) / len(shape))[:, None]
    return np.asarray(np.bincount(faces.ravel(), (pressure @ shape).ravel(), len(vertices_m)), np.float64)


def _centroids(cuts: int) -> Vector3:
    """Return the barycentric coordinates (cuts², 3) of the centroids of the parts of a face with its edges cut."""
    i, j = (axis.ravel() for axis in np.mgrid[:cuts, :cuts])
    up, down = i + j < cuts, i + j < cuts - 1
    u = np.r_[i[up] + 1 / 3, i[down] + 2 / 3] / cuts
    v = np.r_[j[up] + 1 / 3, j[down] + 2 / 3] / cuts
    return np.column_stack((u, v, 1.0 - u - v))
