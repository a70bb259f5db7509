"""Triangles of bodies for rendering: materials of the mesh file, and over them the paint."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.fine_paint import swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import unit
from hapscene.view.feel_layer import OPACITY, Show, box_uv, feel_layer, grain_of, has_look
from hapscene.view.palette import distinct_colours, rgb
from hapscene.view.triangles import GAMMA, Triangles, joined

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene

__all__ = ["corner_normals", "scene_solids", "used_swatches"]

CREASE_COS: Final = 0.95
"""Cosine of the crease angle, 18° [1]: below it, normals at a vertex are averaged; above it, edges are sharp."""


def used_swatches(scene: "Scene") -> list[int]:
    """Return the indices of all swatches in use, ascending."""
    return sorted({int(i) for body in scene.bodies for i in swatches_of(body)})


def scene_solids(scene: "Scene", show: Show = "both") -> list[Triangles]:
    """Return the triangles of all bodies at their poses; the first have neither pictures nor transparency.

    Args:
        scene: the scene.
        show: visible layers. Bodies whose file has no materials and no colours always wear their paint.
    """
    colours = np.array([rgb(colour) for colour in distinct_colours(scene.swatches, used_swatches(scene))])
    solids = [solid for body in scene.bodies for solid in _body_solids(scene, body, colours, show)]
    return [joined([solid for solid in solids if solid.simple]), *(solid for solid in solids if not solid.simple)]


def _body_solids(scene: "Scene", body: "Body", colours: NDArray[np.float64], show: Show) -> Iterator[Triangles]:
    mesh, X_WB = body.mesh, np.asarray(body.X_WB)
    normal = corner_normals(mesh).reshape(-1, 3, 3)
    over = show != "feel" and has_look(body)

    def placed(corner_m: Any, normal: Any, colour: Any, uv: Any = None, picture: Any = None) -> Triangles:
        corner_m = corner_m.reshape(-1, 3) @ X_WB[:3, :3].T + X_WB[:3, 3]
        colour = np.repeat(colour, 3, axis=0)
        return Triangles(corner_m, normal.reshape(-1, 3) @ X_WB[:3, :3].T, colour, uv, picture)

    if over:
        for rows, colour, picture in _looks(mesh):
            uv = None if picture is None or mesh.uv is None else np.nan_to_num(mesh.uv[rows]).reshape(-1, 2)
            yield placed(mesh.triangles_m[rows], normal[rows], colour, uv, picture)
        if show == "look":
            return
    layer = feel_layer(body, normal, "materials" if over else "nothing")
    share = layer.weight[:, None]
    colour = ((1 - share) * colours[layer.swatch] + share * colours[layer.other]) ** GAMMA
    for swatch in np.unique(layer.swatch):
        rows, grain = layer.swatch == swatch, grain_of(scene.swatches[swatch])
        corner_m, shown = layer.corner_m[rows], colour[rows] * (1.0 if grain.flat else grain.gain)
        if over:
            shown = np.column_stack((shown, OPACITY * layer.opacity[rows]))
        if grain.flat:
            yield placed(corner_m, layer.normal[rows], shown)
        else:
            tiles = box_uv(corner_m, grain.tile_m(mesh.diagonal_m))[0].reshape(-1, 2)
            yield placed(corner_m, layer.normal[rows], shown, tiles, grain.pattern)._replace(roughness=grain.roughness)


def _looks(mesh: Mesh) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.uint8] | None]]:
    """Yield groups of faces: their indices (n,), linear colours (n, 3), and the texture that multiplies them."""
    assert mesh.colour_rgb is not None
    material = np.full(len(mesh.faces), -1) if mesh.material is None else mesh.material
    texture = [None if mesh.uv is None else one.textures.get("baseColorTexture") for one in mesh.materials] + [None]
    bare = np.array([picture is None for picture in texture])[material]
    if bare.any():
        yield np.flatnonzero(bare), (mesh.colour_rgb[bare] / 255) ** GAMMA, None
    for index, picture in enumerate(texture):
        rows = np.flatnonzero(material == index)
        if picture is not None and len(rows):
            pixels = np.asarray(picture.convert("RGBA" if mesh.materials[index].alpha != "OPAQUE" else "RGB"))
            yield rows, np.tile(mesh.materials[index].colour[:3], (len(rows), 1)), pixels


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
