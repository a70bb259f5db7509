"""The haptic layer of a body as triangles that lie over its visible surface, with the grain of each swatch.

A scene has two layers. The *look* is the material of the mesh file. The *feel* is the paint: parts of faces with the
colour and the grain of their swatch. A body without materials and colours in its file wears the look of its swatches.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.exchange.cut_faces import cut_faces
from hapscene.scene.fine_paint import parts, swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import normals_of, unit
from hapscene.swatches.picture import LIGHT, plain_look, relief
from hapscene.view.palette import distinct_colours, rgb
from hapscene.view.triangles import GAMMA, Triangles, joined

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch

__all__ = [
    "OPACITY",
    "RAISED",
    "SHOWS",
    "FeelLayer",
    "Grain",
    "Show",
    "box_uv",
    "corner_normals",
    "feel_layer",
    "grain_of",
    "has_look",
    "scene_solids",
    "used_swatches",
]

Show = Literal["look", "feel", "both"]
"""Visible layers: materials of the mesh files, paint, or paint over materials."""

SHOWS: Final[tuple[Show, ...]] = ("look", "feel", "both")

OPACITY: Final = 0.75
"""Opacity of the feel over the look [1], as in an exported page: both can be recognised."""

RAISED: Final = 3e-4
"""Height of the feel above the surface, in diagonals of the body [1]: a depth buffer can still resolve it from afar."""

TILES_MAX: Final = 24
"""Maximum number of repetitions of a grain along the diagonal of a body [1]; on larger bodies it is magnified, since it
would be finer than a pixel."""

CONTRAST: Final = 0.5
"""Contrast of a shaded relief, relative to that in low light [1]: a relief does not hide the shape of its body."""

SHADE: Final = (0.45, 1.5)
"""Range of the brightness of a shaded grain, relative to a flat surface [1]."""


class Grain(NamedTuple):
    """A periodic picture of a swatch.

    Attributes:
        shade: brightness of its relief, lit from the upper left, relative to a flat surface (h, w).
        albedo: colours (h, w, 3), sRGB from 0 to 1; None for the colour of the swatch.
        normal: unit normals (h, w, 3): x right, y up, z outwards.
        size_m: side of the square that it shows [m].
        pattern: picture (h, w, 3), sRGB, of the deviations from the mean colour.
        gain: factor of colours that `pattern` multiplies [1]; it keeps their mean.
        roughness: of its look, 0 for a mirror to 1 [1].
    """

    shade: NDArray[np.float64]
    albedo: NDArray[np.float64] | None
    normal: NDArray[np.float64]
    size_m: float
    pattern: NDArray[np.uint8]
    gain: float
    roughness: float

    @property
    def flat(self) -> bool:
        """Whether the swatch has neither a relief nor a picture."""
        return self.shade.size == 1 and self.albedo is None

    def tile_m(self, diagonal_m: float) -> float:
        """Return the side of the square on a body with this diagonal [m]: a power of two times `size_m`."""
        share = diagonal_m / (TILES_MAX * self.size_m)
        return self.size_m * 2.0 ** max(math.ceil(math.log2(max(share, 1e-9))), 0)


@lru_cache(maxsize=64)
def grain_of(swatch: "Swatch") -> Grain:
    """Return the grain of a swatch from the pictures of its look, or from the spectrum of its texture."""
    slopes, size_m = relief(swatch)
    albedo = None if swatch.look is None else swatch.look.albedo()
    if swatch.look is not None and albedo is not None:  # the relief repeats in the picture
        rows, columns = (
            (np.arange(n) * (swatch.look.size_m / size_m / n) % 1.0 * m).astype(np.int64)
            for n, m in zip(albedo.shape[:2], slopes.shape[:2], strict=True)
        )
        slopes, size_m = slopes[np.ix_(rows, columns)], swatch.look.size_m
    normal = np.concatenate([-slopes, np.ones((*slopes.shape[:2], 1))], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    shade = np.clip(1.0 + CONTRAST * (normal @ LIGHT / LIGHT[2] - 1.0), *SHADE)
    tint = 1.0 if albedo is None else albedo / np.maximum(albedo.mean(axis=(0, 1)), 0.05)
    pixels = np.broadcast_to(shade[..., None] * tint / SHADE[1], (*shade.shape, 3))
    pattern = np.rint(255 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)
    gain = float(255.0 / max(pattern.mean(), 1.0)) ** GAMMA
    return Grain(shade, albedo, normal, size_m, pattern, gain, (swatch.look or plain_look(swatch)).roughness)


def has_look(body: "Body") -> bool:
    """Return whether the mesh file of a body has materials or colours."""
    return body.mesh.colour_rgb is not None


class FeelLayer(NamedTuple):
    """Triangles of the paint of a body, in the body frame.

    Attributes:
        corner_m: (k, 3, 3) [m].
        normal: unit normals at the corners (k, 3, 3).
        swatch: (k,), of a blend the heavier one.
        other: the second swatch of a blend (k,).
        weight: weight of `other` (k,).
        opacity: how much of the surface below is covered (k,).
    """

    corner_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    swatch: NDArray[np.int64]
    other: NDArray[np.int64]
    weight: NDArray[np.float64]
    opacity: NDArray[np.float64]


def feel_layer(body: "Body", normal: NDArray[np.float64], over: Literal["materials", "faces", "nothing"]) -> FeelLayer:
    """Return the painted parts of faces, cut at the borders of the paint.

    Args:
        body: the body.
        normal: unit normals at the corners of its faces (M, 3, 3).
        over: what is drawn below. Materials: the parts with another swatch than the unpainted body are raised above the
            surface, and their blends with that swatch are translucent. Faces: the same over faces that are uniformly
            painted. Nothing: all parts, at the surface.
    """
    cut = cut_faces(body, keep_blends=True)
    a, b, weight = parts(cut.swatch)
    opacity = np.ones(len(a))
    if over != "nothing":
        below = np.full(len(a), body.made_of or 0) if over == "materials" else body.face_swatch[cut.face]
        opacity = np.where(a == below, weight, np.where((b == below) & (weight > 0.0), 1.0 - weight, 1.0))
        a, b, weight = np.where(a == below, b, a), np.where(b == below, a, b), np.where(opacity < 1.0, 0.0, weight)
    rows = np.flatnonzero(opacity > 0.0)
    at = cut.corners(normal, rows)
    at = at / np.maximum(np.linalg.norm(at, axis=2, keepdims=True), 1e-9)
    corner_m = cut.vertices_m[cut.faces[rows]]
    if over != "nothing":
        corner_m = corner_m + RAISED * body.mesh.diagonal_m * at
    return FeelLayer(corner_m, at, a[rows], b[rows], weight[rows], opacity[rows])


def box_uv(corner_m: NDArray[np.generic], tile_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project triangles (k, 3, 3) along the main axis of their normal.

    Returns:
        Texture coordinates (k, 3, 2), v upward, in tiles of `tile_m` [m]; and the direction of u (k, 3).
    """
    normal = normals_of(np.asarray(corner_m, np.float64))
    axis = np.abs(normal).argmax(axis=1)
    row = np.arange(len(axis))
    sign = np.where(normal[row, axis] < 0.0, -1.0, 1.0) * np.where(axis == 1, -1.0, 1.0)
    first, second = np.array([1, 0, 0])[axis], np.array([2, 2, 1])[axis]
    way = np.zeros((len(axis), 3))
    way[row, first] = sign
    uv = np.stack([sign[:, None] * corner_m[row, :, first], corner_m[row, :, second]], axis=2)
    return uv / tile_m, way


# Triangles of bodies for rendering: materials of the mesh file, and over them the paint.


CREASE_COS: Final = 0.95
"""Cosine of the crease angle, 18° [1]: below it, normals at a vertex are averaged; above it, edges are sharp."""


def used_swatches(scene: "Scene") -> list[int]:
    """Return the indices of all swatches in use, ascending."""
    return sorted({int(i) for body in scene.bodies for i in swatches_of(body)})


def scene_solids(scene: "Scene", show: Show = "both") -> list[Triangles]:
    """Return the triangles of all bodies at their poses; the first have neither pictures nor transparency.

    Bodies whose file has no materials and no colours always wear their paint.
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
