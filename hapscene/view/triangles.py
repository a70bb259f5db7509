"""Cameras, triangles for rendering, tubes along lines, and the drawing that is sent to a child process.

Imports only NumPy, to keep the start of that process short.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.view.palette import rgb

__all__ = [
    "GAMMA",
    "MARGIN",
    "NOTHING",
    "Drawing",
    "Frame",
    "Shown",
    "Triangles",
    "facing",
    "fit_cameras",
    "joined",
    "lathe",
    "moved",
    "orbit",
    "pose_of",
    "same",
    "tube",
    "visible_size",
]

# Placement of an orthographic camera that shows the whole scene and can move around it.


VIEW_FROM: Final = (0.35, -1.0, 0.75)
"""Direction from the scene to the camera: in front, above, slightly to the right."""

MARGIN: Final = 1.08
"""Ratio of the width of the picture to that of the scene [1]."""

Extent = tuple[float, float, float]


def orbit(turns_rad: Sequence[float]) -> list[NDArray[np.float64]]:
    """Return the rotations R_SC (3, 3) of a camera that is turned about z by each of these angles."""
    (x, y, z), c, s = VIEW_FROM, np.cos(turns_rad), np.sin(turns_rad)
    return [facing(back, (0.0, 0.0, 1.0)) for back in np.stack([c * x - s * y, s * x + c * y, z + 0.0 * c], axis=1)]


def visible_size(points_m: NDArray[np.float64], R_SC: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """Return width and height of the points (k, 3) [m], seen by all these cameras."""
    low_m, high_m = _seen(points_m, R_SC)
    width_m, height_m, _ = np.maximum(high_m - low_m, 1e-9)
    return float(width_m), float(height_m)


def fit_cameras(
    points_m: NDArray[np.float64], R_SC: Sequence[NDArray[np.float64]], size: tuple[int, int]
) -> tuple[list[NDArray[np.float64]], Extent, float]:
    """Place cameras so that the points (k, 3) fill a picture of `size` pixels.

    Returns:
        The pose X_SC of each camera; half width, half height and depth of the view [m]; the size of a pixel [m].
    """
    low_m, high_m = _seen(points_m, R_SC)
    span_m = np.maximum(high_m - low_m, 1e-9)
    pixel_m = MARGIN * float(max(span_m[0] / size[0], span_m[1] / size[1]))
    far_m = 2.0 * float(span_m.max())
    middle_m = (low_m + high_m) / 2
    poses = [pose_of(R, R @ (middle_m + np.array([0.0, 0.0, far_m / 2]))) for R in R_SC]
    return poses, (pixel_m * size[0] / 2, pixel_m * size[1] / 2, far_m), pixel_m


def _seen(
    points_m: NDArray[np.float64], R_SC: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest coordinates (3,) of the points in the frames of all cameras."""
    seen_m = [R.T @ points_m.T for R in R_SC]  # one row per axis: minima along rows are ten times as fast
    return np.min([s.min(axis=1) for s in seen_m], axis=0), np.max([s.max(axis=1) for s in seen_m], axis=0)


def facing(direction: NDArray[np.float64], up: tuple[float, float, float] | None = None) -> NDArray[np.float64]:
    """Return a rotation (3, 3) whose z axis is `direction` (3,) and whose y axis is close to `up`, if given."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))] if up is None else np.array(up), z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def pose_of(R: NDArray[np.float64], p_m: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Return the pose (4, 4) of a rotation (3, 3), which may also scale, and a position (3,) [m]."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p_m
    return X


GAMMA: Final = 2.2  # exponent with which pyrender converts linear colours to those of a screen
TUBE_SIDES: Final = 8
TUBE_RINGS_MAX: Final = 3000

LATHE_SIDES: Final = 24
"""Number of sides of surfaces of revolution [count]: tool, proxy, arrows."""


class Triangles(NamedTuple):
    """k triangles in the world frame, by corner: position [m], unit normal, linear RGB; each (3 k, 3) float64.

    The colour may have an opacity as fourth channel. With a picture (h, w, 3 or 4) uint8, sRGB, which repeats, `uv` has
    texture coordinates (3 k, 2), v upward, and the picture multiplies the colour. The roughness is 0 for a mirror to 1.
    """

    corner_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    colour: NDArray[np.float64]
    uv: NDArray[np.float64] | None = None
    picture: NDArray[np.uint8] | None = None
    roughness: float = 0.85

    @property
    def simple(self) -> bool:
        """Whether the triangles are opaque and without a picture, so that they can be joined with others."""
        return self.picture is None and self.colour.shape[1] == 3

    def in_float32(self) -> "Triangles":
        """Return the triangles in float32, the precision of GL, which halves the data for the child process."""
        uv = None if self.uv is None else self.uv.astype(np.float32)
        corner_m, normal, colour = (values.astype(np.float32) for values in self[:3])
        return self._replace(corner_m=corner_m, normal=normal, colour=colour, uv=uv)  # type: ignore[arg-type]


NOTHING: Final = Triangles(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))


def joined(solids: list[Triangles]) -> Triangles:
    """Concatenate simple triangles."""
    if not solids:
        return NOTHING
    corner_m, normal, colour = (np.concatenate([solid[k] for solid in solids]) for k in range(3))
    return Triangles(corner_m, normal, colour)


def moved(solid: Triangles, X: NDArray[np.float64]) -> Triangles:
    """Transform triangles by a pose (4, 4), which may scale along their axes of symmetry."""
    if np.array_equal(X, np.eye(4)):
        return solid
    normal = solid.normal @ np.linalg.inv(X[:3, :3])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return solid._replace(corner_m=solid.corner_m @ X[:3, :3].T + X[:3, 3], normal=normal)


def lathe(profile_m: list[tuple[float, float]], colour: str) -> Triangles:
    """Return the surface of revolution of a profile of (radius, height) [m] about z; heights are ascending."""
    angle = np.linspace(0, 2 * np.pi, LATHE_SIDES + 1)
    around = np.column_stack((np.cos(angle), np.sin(angle)))
    corner_m, normal = [], []
    for (r0_m, z0_m), (r1_m, z1_m) in pairwise(profile_m):
        length_m = np.hypot(r1_m - r0_m, z1_m - z0_m)
        out, up = (z1_m - z0_m) / length_m, (r0_m - r1_m) / length_m
        low_m, high_m = (np.column_stack((r * around, np.full(len(angle), z))) for r, z in ((r0_m, z0_m), (r1_m, z1_m)))
        side = np.column_stack((out * around, np.full(len(angle), up)))
        quads = ((low_m, 0), (low_m, 1), (high_m, 1), (low_m, 0), (high_m, 1), (high_m, 0))
        corner_m.append(np.stack([at[k : k + LATHE_SIDES] for at, k in quads], axis=1).reshape(-1, 3))
        normal.append(np.stack([side[k : k + LATHE_SIDES] for _, k in quads], axis=1).reshape(-1, 3))
    corners_m = np.concatenate(corner_m)
    return Triangles(corners_m, np.concatenate(normal), np.tile(rgb(colour) ** GAMMA, (len(corners_m), 1)))


def tube(line_m: NDArray[np.float64], radius_m: float, colour: str) -> Triangles:
    """Return a tube around a polyline (n, 3). Its rings are a diameter apart, or farther on long lines."""
    line_m = _spaced(line_m, 2 * radius_m)
    if len(line_m) < 2:
        return NOTHING
    along = np.gradient(line_m, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    side = _sides(along)
    angle = np.linspace(0, 2 * np.pi, TUBE_SIDES, endpoint=False)[:, None]
    out = np.cos(angle) * side[:, None] + np.sin(angle) * np.cross(along, side)[:, None]  # (n, sides, 3)
    ring = np.arange(len(line_m) - 1)[:, None] * TUBE_SIDES
    k = np.arange(TUBE_SIDES)
    a, b = ring + k, ring + (k + 1) % TUBE_SIDES
    quads = np.stack((a, b, b + TUBE_SIDES, a, b + TUBE_SIDES, a + TUBE_SIDES), axis=-1).ravel()
    normal = out.reshape(-1, 3)
    corner_m = (line_m[:, None] + radius_m * out).reshape(-1, 3)
    return Triangles(corner_m[quads], normal[quads], np.tile(rgb(colour) ** GAMMA, (len(quads), 1)))


def _spaced(line_m: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Resample a polyline to equal distances of about `step_m`; its end is preserved."""
    distance_m = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1))))
    count = int(np.clip(distance_m[-1] / step_m, 1, TUBE_RINGS_MAX)) + 1
    at_m = np.linspace(0.0, distance_m[-1], count)
    if distance_m[-1] <= 0:
        return line_m[:1]
    return np.column_stack([np.interp(at_m, distance_m, line_m[:, k]) for k in range(3)])


def _sides(along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a unit vector perpendicular to each tangent (n, 3), transported along the line without twist."""
    side = np.empty_like(along)
    last = np.eye(3)[np.argmin(np.abs(along[0]))]
    for i, tangent in enumerate(along):
        last = last - tangent * (last @ tangent)
        length = np.linalg.norm(last)
        if length < 1e-6:  # the line reverses its direction
            last = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent))])
            length = np.linalg.norm(last)
        last = side[i] = last / length
    return side


Shown = list[tuple[int, NDArray[np.float64]]]
"""Indices of the visible parts with their poses X_SP (4, 4)."""


@dataclass(frozen=True)
class Frame:
    """A frame of a drawing."""

    X_SC: NDArray[np.float64]
    """Pose of the camera (4, 4), which looks along its −z axis."""
    shown: Shown


@dataclass(frozen=True)
class Drawing:
    """Parts and frames to render. Frame S is the world frame moved to the scene's centre, since GL uses float32."""

    parts: Sequence[Triangles]
    """Triangles of each part in its frame P."""
    frames: Sequence[Frame]
    extent_m: tuple[float, float, float]
    """Half width and half height of the view of the orthographic camera, and its depth [m]."""
    size: tuple[int, int]
    """Width and height [pixels]."""
    background: str
    """Background colour, "#rrggbb"."""
    oversampling: int
    """Rendered pixels per pixel of `size`, along each side."""
    casters: Sequence[int] = ()
    """Indices of the parts that cast shadows."""


def same(a: Shown, b: Shown) -> bool:
    """Return whether two frames show the same parts at the same poses."""
    return len(a) == len(b) and all(i == j and np.array_equal(X, Y) for (i, X), (j, Y) in zip(a, b, strict=True))
