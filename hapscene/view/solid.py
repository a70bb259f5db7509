"""Triangles to draw: bodies in the colours of their swatches, and lines as tubes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.mesh import Mesh
    from hapscene.scene.scene import Scene

CREASE_COS: Final = 0.95
"""Cosine of the angle, 18°, up to which a corner is shaded by the normal of all faces around it; beyond it by its own
face's, so that edges stay sharp."""

SHADE_SHARE: Final = 0.5
"""How much of the light and dark in a file's own colours is seen through a swatch [1]."""

TUBE_SIDES: Final = 8
TUBE_RINGS_MAX: Final = 3000


@dataclass(frozen=True)
class Solid:
    """k triangles in W, corner by corner: position [m], unit normal, linear RGB; each (3 k, 3) float64."""

    corner_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    colour: NDArray[np.float64]


def joined(solids: list[Solid]) -> Solid:
    """All the triangles as one."""
    return Solid(
        np.concatenate([s.corner_m for s in solids]),
        np.concatenate([s.normal for s in solids]),
        np.concatenate([s.colour for s in solids]),
    )


def scene_solid(scene: "Scene") -> Solid:
    """Every body of the scene at its pose, each face in the colour of its swatch."""
    return joined([_body_solid(body, scene) for body in scene.bodies])


def tube(line_m: NDArray[np.float64], radius_m: float, colour: str) -> Solid:
    """A tube around a polyline (n, 3), with rings a radius apart, or wider where it is long."""
    line_m = _spaced(line_m, radius_m)
    if len(line_m) < 2:
        return Solid(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
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
    rgb = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return Solid(corner_m[quads], normal[quads], np.tile(_linear(rgb), (len(quads), 1)))


def _body_solid(body: "Body", scene: "Scene") -> Solid:
    mesh, X_WB = body.mesh, np.asarray(body.X_WB)
    vertices_m = mesh.vertices_m @ X_WB[:3, :3].T + X_WB[:3, 3]
    albedo = np.array([swatch.albedo_rgb for swatch in scene.swatches], dtype=float)
    colour = albedo[body.face_swatch]
    if mesh.colour_rgb is not None:
        plain = body.face_swatch == 0
        colour[plain] = mesh.colour_rgb[plain] / 255
        # under a swatch the file's picture stays visible, as shades of the swatch's colour
        grey = mesh.colour_rgb.mean(axis=1, keepdims=True) + 1.0
        shade = 1.0 + SHADE_SHARE * np.clip(grey / grey.mean() - 1.0, -0.5, 0.5)
        colour[~plain] = np.clip(colour * shade, 0.0, 1.0)[~plain]
    return Solid(
        vertices_m[mesh.faces.ravel()],
        _corner_normals(mesh) @ X_WB[:3, :3].T,
        np.repeat(_linear(colour), 3, axis=0),
    )


def _corner_normals(mesh: "Mesh") -> NDArray[np.float64]:
    """A normal for each corner (3 m, 3): averaged over the faces around the vertex, save across a crease.

    Faces count by their angle at the vertex: how a flat side is cut into triangles makes no difference.
    """
    triangle = mesh.triangles_m
    ahead = _unit((np.roll(triangle, -1, axis=1) - triangle).reshape(-1, 3))
    back = _unit((np.roll(triangle, 1, axis=1) - triangle).reshape(-1, 3))
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", ahead, back), -1.0, 1.0))
    face = np.repeat(mesh.normals, 3, axis=0)
    at, count = mesh.faces.ravel(), len(mesh.vertices_m)
    around = np.column_stack([np.bincount(at, angle * face[:, k], count) for k in range(3)])
    smooth = _unit(around)[at]
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


def _unit(vectors: NDArray[Any]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


def _linear(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB, 0 … 1, to the linear values that light is summed in (pyrender's own exponent)."""
    return np.asarray(srgb**2.2)
