"""Triangles to draw: bodies in the colours of their swatches, and lines as tubes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.fine_paint import NOTHING as NO_LEAVES
from hapscene.scene.fine_paint import parts, swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import unit
from hapscene.view.palette import distinct_colours, rgb

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene


CREASE_COS: Final = 0.95
"""Cosine of the angle, 18°, up to which a corner is shaded by the normal of all faces around it; beyond it by its own
face's, so that edges stay sharp."""

SHADE_SHARE: Final = 0.5
"""How much of the light and dark in a file's own colours is seen through a swatch [1]."""

TUBE_SIDES: Final = 8
TUBE_RINGS_MAX: Final = 3000

LATHE_SIDES: Final = 24
"""Sides of what is turned on a lathe: tool, proxy, arrows."""


class Triangles(NamedTuple):
    """k triangles in W, corner by corner: position [m], unit normal, linear RGB; each (3 k, 3) float64."""

    corner_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    colour: NDArray[np.float64]


NOTHING: Final = Triangles(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))


def joined(solids: list[Triangles]) -> Triangles:
    """All the triangles as one."""
    if not solids:
        return NOTHING
    return Triangles(*map(np.concatenate, zip(*solids, strict=True)))


def moved(solid: Triangles, X: NDArray[np.float64]) -> Triangles:
    """The triangles at a pose (4, 4), which may stretch them along the axes that they are symmetric about."""
    if np.array_equal(X, np.eye(4)):
        return solid
    normal = unit(solid.normal @ np.linalg.inv(X[:3, :3]))
    return Triangles(solid.corner_m @ X[:3, :3].T + X[:3, 3], normal, solid.colour)


def cut(solid: Triangles, chosen: NDArray[np.bool_]) -> Triangles:
    """The triangles that are chosen (k,)."""
    corner = np.repeat(chosen, 3)
    return Triangles(*(values[corner] for values in solid))


class Pieces(NamedTuple):
    """The k pieces of one paint that a body is drawn in: whole faces, and the leaves of those painted finer.

    Their faces (k,), the barycentric coordinates of their corners there (k, 3, 3), and their paints (k,).
    """

    face: NDArray[np.integer]
    corners: NDArray[np.float64]
    paint: NDArray[np.int64]


def pieces_of(body: "Body") -> Pieces:
    """What a body is drawn in."""
    whole = np.arange(len(body.mesh.faces))
    leaves = body.fine or NO_LEAVES
    whole = np.delete(whole, leaves.faces)
    return Pieces(
        np.concatenate((whole, leaves.face)),
        np.concatenate((np.broadcast_to(np.eye(3), (len(whole), 3, 3)), leaves.corners())),
        np.concatenate((body.face_swatch[whole], leaves.paint)),
    )


def used_swatches(scene: "Scene") -> list[int]:
    """Indices of the swatches that some piece wears, ascending."""
    return sorted({int(i) for body in scene.bodies for i in swatches_of(body)})


def worn_by(scene: "Scene") -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of each piece in `scene_solid`, the swatch that it wears, the heavier of a blend, and the index of its body."""
    paints = [pieces_of(body).paint for body in scene.bodies]
    return parts(np.concatenate(paints))[0], np.repeat(np.arange(len(paints)), [len(paint) for paint in paints])


def scene_solid(scene: "Scene", painted: bool = True) -> Triangles:
    """Every body of the scene at its pose, each piece in the colour of its paint; or, unpainted, of the plain one."""
    colours = np.array([rgb(colour) for colour in distinct_colours(scene.swatches, used_swatches(scene))])
    return joined([_body_solid(body, colours, painted) for body in scene.bodies])


def lathe(profile_m: list[tuple[float, float]], colour: str) -> Triangles:
    """What a profile of (radius, height) [m] encloses when it is turned about z; heights ascend."""
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
    return Triangles(corners_m, np.concatenate(normal), np.tile(_linear(rgb(colour)), (len(corners_m), 1)))


def tube(line_m: NDArray[np.float64], radius_m: float, colour: str) -> Triangles:
    """A tube around a polyline (n, 3), with rings a diameter apart, or wider where it is long."""
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
    return Triangles(corner_m[quads], normal[quads], np.tile(_linear(rgb(colour)), (len(quads), 1)))


def _body_solid(body: "Body", colours: NDArray[np.float64], painted: bool) -> Triangles:
    mesh, X_WB, pieces = body.mesh, np.asarray(body.X_WB), pieces_of(body)
    vertices_m = mesh.vertices_m @ X_WB[:3, :3].T + X_WB[:3, 3]
    a, b, weight = parts(pieces.paint * painted)
    colour = (1 - weight)[:, None] * colours[a] + weight[:, None] * colours[b]
    if mesh.colour_rgb is not None:
        own, plain = mesh.colour_rgb[pieces.face], a == 0
        colour[plain] = own[plain] / 255
        colour[~plain] = np.clip(colour * shade_of(own, mesh.colour_rgb)[:, None], 0.0, 1.0)[~plain]
    corner_m, normal = vertices_m[mesh.faces.ravel()], _corner_normals(mesh) @ X_WB[:3, :3].T
    if body.fine is not None:
        corner_m = (pieces.corners @ corner_m.reshape(-1, 3, 3)[pieces.face]).reshape(-1, 3)
        normal = unit((pieces.corners @ normal.reshape(-1, 3, 3)[pieces.face]).reshape(-1, 3))
    return Triangles(corner_m, normal, np.repeat(_linear(colour), 3, axis=0))


def shade_of(colour_rgb: NDArray[Any], all_rgb: NDArray[Any]) -> NDArray[np.float64]:
    """By what (n,) a swatch's colour is multiplied where the file has a colour (n, 3): its picture stays visible.

    Against the mean of all the file's colours (m, 3), 0 to 255 both.
    """
    grey = colour_rgb.mean(axis=1) + 1.0
    return np.asarray(1.0 + SHADE_SHARE * np.clip(grey / (all_rgb.mean() + 1.0) - 1.0, -0.5, 0.5))


def _corner_normals(mesh: Mesh) -> NDArray[np.float64]:
    """A normal for each corner (3 m, 3): averaged over the faces around the vertex, save across a crease.

    Faces count by their angle at the vertex: how a flat side is cut into triangles makes no difference.
    """
    triangle = mesh.triangles_m
    ahead = unit((np.roll(triangle, -1, axis=1) - triangle).reshape(-1, 3))
    back = unit((np.roll(triangle, 1, axis=1) - triangle).reshape(-1, 3))
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", ahead, back), -1.0, 1.0))
    face = np.repeat(mesh.normals, 3, axis=0)
    at, count = mesh.faces.ravel(), len(mesh.vertices_m)
    around = np.column_stack([np.bincount(at, angle * face[:, k], count) for k in range(3)])
    smooth = unit(around)[at]
    crease = np.einsum("ij,ij->i", face, smooth) < CREASE_COS
    return np.where(crease[:, None], face, smooth)


def _spaced(line_m: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Points of the polyline at equal distances along it, about `step_m`; its end stays."""
    distance_m = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1))))
    count = int(np.clip(distance_m[-1] / step_m, 1, TUBE_RINGS_MAX)) + 1
    at_m = np.linspace(0.0, distance_m[-1], count)
    if distance_m[-1] <= 0:
        return line_m[:1]
    return np.column_stack([np.interp(at_m, distance_m, line_m[:, k]) for k in range(3)])


def _sides(along: NDArray[np.float64]) -> NDArray[np.float64]:
    """A unit vector across each tangent (n, 3), carried from one to the next: the tube does not twist."""
    side = np.empty_like(along)
    last = np.eye(3)[np.argmin(np.abs(along[0]))]
    for i, tangent in enumerate(along):
        last = last - tangent * (last @ tangent)
        length = np.linalg.norm(last)
        if length < 1e-6:  # the line turned straight back
            last = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent))])
            length = np.linalg.norm(last)
        last = side[i] = last / length
    return side


def _linear(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB, 0 … 1, to the linear values that light is summed in (pyrender's own exponent)."""
    return np.asarray(srgb**2.2)


# What is handed to GL: triangles in parts, and for each frame which parts are shown, where, and from where.


Shown = list[tuple[int, NDArray[np.float64]]]
"""Indices of parts that are seen, each with its pose X_SP (4, 4)."""


@dataclass(frozen=True)
class Frame:
    """One frame."""

    X_SC: NDArray[np.float64]
    """(4, 4) pose of the camera, which looks along its own −z."""
    shown: Shown


@dataclass(frozen=True)
class Drawing:
    """Parts and frames. Frame S is W moved to the scene's middle, since GL counts in float32."""

    parts: Sequence[Triangles]
    """Each in a frame P of its own."""
    frames: Sequence[Frame]
    """As many as there are to draw."""
    extent_m: tuple[float, float, float]
    """Half width and half height of what the orthographic camera sees, and how far it sees."""
    size: tuple[int, int]
    """Width and height [pixels]."""
    background: str
    """Colour, "#rrggbb"."""
    oversampling: int
    """Pixels drawn for each pixel of `size`, along each side."""

    def save(self, path: Path) -> None:
        """Write as npz, for the process that draws."""
        shown = [(k, part, X_SP) for k, frame in enumerate(self.frames) for part, X_SP in frame.shown]
        with path.open("wb") as file:
            np.savez(
                file,
                **packed(self.parts),
                X_SC=np.array([frame.X_SC for frame in self.frames]),
                shown=np.array([(k, part) for k, part, _ in shown]),
                X_SP=np.array([X_SP for *_, X_SP in shown]),
                extent_m=self.extent_m,
                size=self.size,
                background=self.background,
                oversampling=self.oversampling,
            )

    @classmethod
    def load(cls, path: Path) -> "Drawing":
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as archive:
            shown: list[Shown] = [[] for _ in archive["X_SC"]]
            for (k, part), X_SP in zip(archive["shown"], archive["X_SP"], strict=True):
                shown[k].append((int(part), X_SP))
            x_m, y_m, far_m = (float(m) for m in archive["extent_m"])
            width, height = (int(n) for n in archive["size"])
            return cls(
                unpacked(archive),
                [Frame(X_SC, parts) for X_SC, parts in zip(archive["X_SC"], shown, strict=True)],
                (x_m, y_m, far_m),
                (width, height),
                str(archive["background"]),
                int(archive["oversampling"]),
            )


def same(a: Shown, b: Shown) -> bool:
    """Whether the same parts are seen at the same places."""
    return len(a) == len(b) and all(i == j and np.array_equal(X, Y) for (i, X), (j, Y) in zip(a, b, strict=True))


def packed(parts: Sequence[Triangles]) -> dict[str, Any]:
    """Arrays that hold all the parts, in float32 as GL takes them."""
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts]).astype(np.float32)
        for name in ("corner_m", "normal", "colour")
    }
    return arrays | {"part_end": np.cumsum([len(part.corner_m) for part in parts])}


def unpacked(archive: Any) -> list[Triangles]:
    """The parts from those arrays."""
    names = ("corner_m", "normal", "colour")
    pieces = [np.split(archive[name], archive["part_end"][:-1]) for name in names]
    return [Triangles(*arrays) for arrays in zip(*pieces, strict=True)]
