"""Triangles of bodies for rendering, coloured by their paint and shaded by the colours in the mesh file."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.fine_paint import NOTHING as NO_SUBFACES
from hapscene.scene.fine_paint import parts, swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import unit
from hapscene.view.palette import distinct_colours, rgb
from hapscene.view.triangles import Triangles, joined, linear_rgb

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene

__all__ = ["corner_normals", "scene_solid", "shade_of", "used_swatches"]

CREASE_COS: Final = 0.95
"""Cosine of the crease angle, 18° [1]: below it, normals at a vertex are averaged; above it, edges are sharp."""

SHADE_SHARE: Final = 0.5
"""Weight of the brightness of colours in the mesh file on painted faces [1]."""


def used_swatches(scene: "Scene") -> list[int]:
    """Return the indices of all swatches in use, ascending."""
    return sorted({int(i) for body in scene.bodies for i in swatches_of(body)})


def scene_solid(scene: "Scene") -> Triangles:
    """Return the triangles of all bodies at their poses, coloured by their paint."""
    colours = np.array([rgb(colour) for colour in distinct_colours(scene.swatches, used_swatches(scene))])
    return joined([_body_solid(body, colours) for body in scene.bodies])


def _body_solid(body: "Body", colours: NDArray[np.float64]) -> Triangles:
    mesh, X_WB, subfaces = body.mesh, np.asarray(body.X_WB), body.fine or NO_SUBFACES
    whole = np.delete(np.arange(len(mesh.faces)), subfaces.faces)  # faces that are not subdivided
    face = np.concatenate((whole, subfaces.face))
    a, b, weight = parts(np.concatenate((body.face_swatch[whole], subfaces.paint)))
    colour = (1 - weight)[:, None] * colours[a] + weight[:, None] * colours[b]
    if mesh.colour_rgb is not None:
        own, plain = mesh.colour_rgb[face], a == 0
        colour[plain] = own[plain] / 255
        colour[~plain] = np.clip(colour * shade_of(own, mesh.colour_rgb)[:, None], 0.0, 1.0)[~plain]
    vertices_m = mesh.vertices_m @ X_WB[:3, :3].T + X_WB[:3, 3]
    corner_m, normal = vertices_m[mesh.faces.ravel()], corner_normals(mesh) @ X_WB[:3, :3].T
    if body.fine is not None:
        corners = np.concatenate((np.broadcast_to(np.eye(3), (len(whole), 3, 3)), subfaces.corners()))
        corner_m = (corners @ corner_m.reshape(-1, 3, 3)[face]).reshape(-1, 3)
        normal = unit((corners @ normal.reshape(-1, 3, 3)[face]).reshape(-1, 3))
    return Triangles(corner_m, normal, np.repeat(linear_rgb(colour), 3, axis=0))


def shade_of(colour_rgb: NDArray[Any], all_rgb: NDArray[Any]) -> NDArray[np.float64]:
    """Return the brightness factor (n,) of painted faces from their colours in the file (n, 3), from 0 to 255.

    It is relative to the mean of all colours of the file (m, 3), so that details of its texture remain visible.
    """
    grey = colour_rgb.mean(axis=1) + 1.0
    return np.asarray(1.0 + SHADE_SHARE * np.clip(grey / (all_rgb.mean() + 1.0) - 1.0, -0.5, 0.5))


def corner_normals(mesh: Mesh) -> NDArray[np.float64]:
    """Return a normal for each corner (3 m, 3): the mean of the faces at the vertex, except across creases.

    Faces are weighted by their angle at the vertex, so the triangulation of flat sides has no influence.
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
