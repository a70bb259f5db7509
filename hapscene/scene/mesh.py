"""Triangle meshes in metres, with the group names, colours and texture coordinates of their files."""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from hapscene.constants import REACH_MAX_M
from hapscene.errors import MeshError, no_such
from hapscene.geometry import columns_of, used_by
from hapscene.scene.material import Material
from hapscene.scene.topology import Neighbours, neighbours_of, normals_of

if TYPE_CHECKING:
    import trimesh


__all__ = [
    "FACE_MAX",
    "OVERLAY",
    "SIZE_M",
    "UNIT_M",
    "UNNAMED",
    "Mesh",
    "MeshWarning",
    "Part",
    "check_reading",
    "join",
    "merged",
    "part_of",
    "parts_of",
    "sample",
    "unit_name",
]


UNIT_M: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Length of each supported unit [m]."""

UNIT_ALIAS: Final = {
    **{"meter": "m", "meters": "m", "metre": "m", "metres": "m"},
    **{"centimeter": "cm", "centimeters": "cm", "centimetre": "cm", "centimetres": "cm"},
    **{"millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm"},
    **{"micron": "um", "microns": "um", "micrometer": "um", "micrometers": "um", "µm": "um", "μm": "um"},
    **{"inch": "in", "inches": "in", "foot": "ft", "feet": "ft"},
}
"""Other spellings of units, as trimesh uses them."""

FACE_MAX: Final = 50_000_000
"""Maximum number of faces of a mesh [count]: larger meshes exceed the memory of an ordinary computer."""

SIZE_M: Final = (1e-6, 1e5)
"""Minimum and maximum diagonal of a mesh [m]. Outside this range the unit is wrong or the file is damaged."""

SCALE: Final = (1e-9, 1e9)
"""Minimum and maximum scale factor of a mesh [1]."""

UPS: Final = ("y", "z")
"""Possible vertical axes of a mesh file. In a scene z is up."""

UNNAMED: Final = "default"
"""Group name of faces that have no group in the file."""


OVERLAY: Final = "hapscene_overlay"
"""Key in the extras of glTF meshes and materials that only show the paint of other faces: `hapscene.exchange.gltf`."""


class MeshWarning(UserWarning):
    """The mesh is usable, but some of its faces will not behave as expected."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the body frame B. Triangles are counter-clockwise seen from outside, in the order of the file.

    The arrays are read-only, since bodies share meshes.

    Attributes:
        vertices_m: vertex positions (N, 3) float64 [m].
        faces: indices into `vertices_m` (M, 3) int32.
        group: index into `group_names` for each face (M,) int16.
        group_names: object, group and material names from the file, joined by "/" if a face has several.
        colour_rgb: colour of each face in the file (M, 3) uint8, for display only; or None.
        path: the file that the mesh was loaded from, or None.
        unit: unit of length of that file, a key of `UNIT_M`.
        up: vertical axis in that file, "y" or "z". The mesh itself has z up: files with y up are rotated.
        scale: factor by which the mesh is larger than in that file [1].
        uv: texture coordinates of the corners of each face (M, 3, 2) float32, v upward; NaN for faces without. None if
            no face has any.
        materials: appearance in the file, for display only.
        material: index into `materials` for each face (M,) int16, −1 for faces without; or None.

    Raises:
        MeshError: an array has the wrong shape, a vertex is not finite or farther than `REACH_MAX_M` from the origin,
            an index is out of range, or there are no faces.
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int32]
    group: NDArray[np.int16] = field(default_factory=lambda: np.zeros(0, np.int16))
    group_names: tuple[str, ...] = (UNNAMED,)
    colour_rgb: NDArray[np.uint8] | None = None
    path: Path | None = None
    unit: str = "m"
    up: str = "z"
    scale: float = 1.0
    uv: NDArray[np.float32] | None = field(default=None, kw_only=True)
    materials: tuple[Material, ...] = field(default=(), kw_only=True)
    material: NDArray[np.int16] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        where = f"{self.path}: " if self.path else "mesh: "
        vertices, faces = np.asarray(self.vertices_m), np.asarray(self.faces)
        _check_shape(vertices, faces, where)
        _check_indices(faces, len(vertices), where)
        if not np.isfinite(vertices).all():
            vertex = int(np.argwhere(~np.isfinite(vertices))[0, 0])
            raise MeshError(f"{where}vertex {vertex} is not finite: {vertices[vertex].tolist()}")
        group = np.asarray(self.group) if len(self.group) else np.zeros(len(faces), np.int16)
        if group.shape != (len(faces),) or group.min() < 0 or group.max() >= len(self.group_names):
            raise MeshError(
                f"{where}group must have shape ({len(faces)},) with indices 0 to {len(self.group_names) - 1}"
            )
        _freeze(self, "vertices_m", vertices, np.float64)
        _freeze(self, "faces", faces, np.int32)
        _freeze(self, "group", group, np.int16)
        for name, shape, dtype in (
            ("colour_rgb", (3,), np.uint8),
            ("uv", (3, 2), np.float32),
            ("material", (), np.int16),
        ):
            if (values := getattr(self, name)) is not None:
                if np.shape(values) != (len(faces), *shape):
                    raise MeshError(f"{where}{name} must have shape {(len(faces), *shape)}")
                _freeze(self, name, values, dtype)
        if self.material is not None and not (self.material.min() >= -1 and self.material.max() < len(self.materials)):
            raise MeshError(f"{where}material must have indices of `materials`, or −1 for none")
        _check_extent(self, where)

    def __repr__(self) -> str:
        where = f" of {self.path}" if self.path else ""
        return f"<Mesh{where}: {len(self.vertices_m):,} vertices, {len(self.faces):,} faces, {self.diagonal_m:.3g} m>"

    @cached_property
    def digest(self) -> str:
        """SHA-256 of vertices [m] and faces in hex. Names, colours and the path do not count."""
        content = hashlib.sha256(f"{len(self.vertices_m)} {len(self.faces)} ".encode())
        content.update(self.vertices_m.astype("<f8", copy=False).data)
        content.update(self.faces.astype("<i4", copy=False).data)
        return content.hexdigest()

    @cached_property
    def bounds_m(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the bounding box of the faces (2, 3) [m]."""
        columns = columns_of(self.vertices_m, used_by(self.faces))
        return np.array([[column.min() for column in columns], [column.max() for column in columns]])

    @cached_property
    def neighbours(self) -> Neighbours:
        """Adjacency of the faces."""
        return neighbours_of(self.vertices_m, self.faces)

    @property
    def diagonal_m(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(self.bounds_m[1] - self.bounds_m[0]))

    @property
    def triangles_m(self) -> NDArray[np.float64]:
        """Corner positions of every face (M, 3, 3) [m]."""
        return np.take(self.vertices_m, self.faces, axis=0)

    @property
    def normals(self) -> NDArray[np.float64]:
        """Outward unit normal of every face by its winding (M, 3); zero for faces without area."""
        return normals_of(self.triangles_m)

    def faces_of(self, name: str) -> NDArray[np.bool_]:
        """Return the mask (M,) of the faces with this object, group or material name.

        Raises:
            MeshError: no face has that name.
        """
        # A full name is "object/group/material"; any of its parts matches.
        found = [i for i, full in enumerate(self.group_names) if name == full or name in full.split("/")]
        if not found:
            known = {part for full in self.group_names for part in (full, *full.split("/"))}
            raise MeshError(f"{self.path or 'mesh'}: {no_such('group', name, known)}")
        return np.isin(self.group, found)

    @classmethod
    def from_trimesh(
        cls,
        mesh: "trimesh.Trimesh | trimesh.Scene",
        unit: str | None = None,
        *,
        up: str | None = None,
        scale: float = 1.0,
    ) -> "Mesh":
        """Convert a `trimesh.Trimesh` or `trimesh.Scene`. Vertices and faces are not merged or reordered.

        Args:
            mesh: the trimesh object. A scene becomes one mesh with all nodes at their poses.
            unit: unit of length of the coordinates, a key of `UNIT_M`. Default: `mesh.units`.
            up: vertical axis of the coordinates, "y" or "z" (the default).
            scale: scale factor [1].

        Raises:
            MeshError: the unit is missing, the unit, axis or scale is invalid, or the mesh is.
        """
        parts = parts_of(mesh, "trimesh object")
        known = unit if unit is not None else getattr(mesh, "units", None)
        if known is None:
            raise MeshError(
                f"the trimesh object has no units: pass unit=, one of {', '.join(UNIT_M)}, or set its .units"
            )
        return join(parts, unit_name(known), None, up or "z", scale)


def unit_name(unit: str) -> str:
    """Return the key of `UNIT_M` for any spelling of a unit. Raises MeshError: the unit is unknown."""
    name = UNIT_ALIAS.get(str(unit).strip().lower(), str(unit).strip().lower())
    if name not in UNIT_M:
        raise MeshError(no_such("unit of length", str(unit), UNIT_M))
    return name


def _check_shape(vertices: NDArray[np.generic], faces: NDArray[np.generic], where: str) -> None:
    if vertices.ndim != 2 or vertices.shape[1:] != (3,):
        raise MeshError(f"{where}vertices must have shape (N, 3), not {vertices.shape}")
    if not len(faces):
        raise MeshError(f"{where}no faces: a mesh needs at least one triangle")
    if faces.ndim != 2 or faces.shape[1:] != (3,):
        raise MeshError(f"{where}faces must have shape (M, 3), not {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise MeshError(f"{where}faces must have an integer type, not {faces.dtype}")
    if len(faces) > FACE_MAX:
        raise MeshError(f"{where}{len(faces):,} faces, at most {FACE_MAX:,} are supported: simplify the mesh")


def _check_indices(faces: NDArray[np.integer], vertex_count: int, where: str, of: str = "") -> None:
    if len(faces) and (faces.min() < 0 or faces.max() >= vertex_count):
        face, corner = np.argwhere((faces < 0) | (faces >= vertex_count))[0]
        raise MeshError(
            f"{where}face {face}{of} refers to vertex {faces[face, corner]}, expected 0 to {vertex_count - 1}"
        )


def _check_extent(mesh: Mesh, where: str) -> None:
    size_m = mesh.diagonal_m
    if not SIZE_M[0] <= size_m <= SIZE_M[1]:
        raise MeshError(
            f"{where}the diagonal is {size_m:.3g} m, expected {SIZE_M[0]:g} to {SIZE_M[1]:g} m: check the unit"
        )
    if np.abs(mesh.bounds_m).max() > REACH_MAX_M:
        corners = mesh.faces.ravel()
        at, axis = np.argwhere(np.abs(mesh.vertices_m[corners]) > REACH_MAX_M)[0]
        raise MeshError(
            f"{where}vertex {corners[at]} is at {'xyz'[axis]} = {mesh.vertices_m[corners[at], axis]:g} m; expected at "
            f"most {REACH_MAX_M:g} m from the origin: check the unit, or move the mesh closer to its origin"
        )


def _freeze(mesh: Mesh, name: str, values: ArrayLike, dtype: DTypeLike) -> None:
    # Copy the array unless it is immutable: the caller could still change it.
    array = np.asarray(values, dtype, order="C")
    if array.base is not None or array.flags.writeable:
        array = np.array(values, dtype, order="C")
        array.setflags(write=False)
    object.__setattr__(mesh, name, array)


# Conversion of trimesh objects: a file has parts with separate names and colours, which are joined into one `Mesh`.


@dataclass
class Part:
    """Triangles with names and colours, in the unit of the file."""

    vertices: NDArray[np.float64]  # (n, 3)
    faces: NDArray[Any]  # (m, 3)
    group: NDArray[Any]  # (m,) index into names
    names: list[str]
    colour_rgb: NDArray[np.uint8] | None = None  # (m, 3)
    uv: NDArray[np.float32] | None = None  # (m, 3, 2)
    materials: list[Material] = field(default_factory=list)
    material: NDArray[np.int16] | None = None  # (m,) index into materials; −1 for none


def check_reading(up: str | None, scale: float) -> None:
    """Check the vertical axis and the scale factor before a file is read.

    Raises:
        MeshError: the axis or the scale is invalid.
    """
    if up is not None and up not in UPS:
        raise MeshError(f'invalid vertical axis {up!r}; expected "y" or "z"')
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not SCALE[0] <= scale <= SCALE[1]:
        raise MeshError(
            f"invalid scale {scale!s:.20}; expected a number from {SCALE[0]:g} to {SCALE[1]:g}, such as 0.001"
        )


def join(parts: list[Part], unit: str, path: Path | None, up: str = "z", scale: float = 1.0) -> Mesh:
    """Join parts into one mesh in metres with z up. Parts with the same name share a group.

    Raises:
        MeshError: `Mesh` or `check_reading` rejects the result.
    """
    check_reading(up, scale)
    whole = merged(parts, path)
    parts.clear()  # frees memory: their arrays are as large as those of the result
    whole.vertices *= UNIT_M[unit]
    if scale != 1.0:
        whole.vertices *= scale
    if up == "y":  # rotate by 90° about x; + 0.0 turns −0.0 into 0.0
        whole.vertices[:, 1:] = whole.vertices[:, :0:-1] * (-1.0, 1.0) + 0.0
    for array in (whole.vertices, whole.faces):
        array.setflags(write=False)
    faces = whole.vertices, whole.faces, whole.group, tuple(whole.names), whole.colour_rgb
    source = path, unit, up, float(scale)
    return Mesh(*faces, *source, uv=whole.uv, materials=tuple(whole.materials), material=whole.material)


def merged(parts: list[Part], path: Path | None) -> Part:
    """Join parts into one part with new arrays, in the unit of the file.

    Raises:
        MeshError: there are no parts or too many groups, or an index is out of range.
    """
    where = f"{path}: " if path else "mesh: "
    if not parts:
        raise MeshError(f"{where}no faces: a mesh needs at least one triangle")
    names = list(dict.fromkeys(name for part in parts for name in part.names))
    if len(names) > np.iinfo(np.int16).max:
        raise MeshError(f"{where}{len(names):,} groups; at most {np.iinfo(np.int16).max:,} are supported")
    place = {name: i for i, name in enumerate(names)}
    start = np.cumsum([0] + [len(part.vertices) for part in parts])
    materials, material = _materials(parts)
    for part in parts:  # checked per part: after joining, an invalid index may refer to a vertex of another part
        _check_indices(part.faces, len(part.vertices), where, f" of {part.names[0]!r}" if len(parts) > 1 else "")
    faces = np.empty((sum(len(part.faces) for part in parts), 3), np.int32 if start[-1] < 2**31 else np.int64)
    ends = np.cumsum([len(part.faces) for part in parts])
    for part, at, end in zip(parts, start, ends, strict=False):
        faces[end - len(part.faces) : end] = part.faces
        faces[end - len(part.faces) : end] += at
    return Part(
        vertices=np.concatenate([part.vertices for part in parts], dtype=np.float64),
        faces=faces,
        group=np.concatenate([np.array([place[n] for n in part.names], np.int16)[part.group] for part in parts]),
        names=names,
        colour_rgb=_colours(parts),
        uv=_uvs(parts),
        materials=materials,
        material=material,
    )


def parts_of(loaded: "trimesh.Trimesh | trimesh.Scene", where: str) -> list[Part]:
    """Return the triangles of a trimesh object, one part for each node at its pose.

    Raises:
        MeshError: the object is not a mesh or a scene of meshes, or it is too large.
    """
    import trimesh

    if isinstance(loaded, trimesh.Trimesh):
        return [part_of(loaded, [UNNAMED], None, {})]
    if not isinstance(loaded, trimesh.Scene):
        raise MeshError(f"{where}: expected a file or a triangle mesh, not a {type(loaded).__name__}")
    parts = []
    known: dict[int, Material | None] = {}  # parts may share a material
    made = 0  # limits instances: a small file can refer to the same geometry many times
    for node in loaded.graph.nodes_geometry:
        pose, geometry = loaded.graph[node]
        mesh = loaded.geometry[geometry]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces) and OVERLAY not in mesh.metadata:
            made += max(len(mesh.faces), len(mesh.vertices))
            if made > FACE_MAX:
                raise MeshError(f"{where}: more than {FACE_MAX:,} faces or vertices: simplify the mesh")
            # trimesh names an unnamed node by its number; the name of the geometry is then more useful
            parts.append(part_of(mesh, [str(geometry if node.isdigit() else node)], pose, known))
    return parts


def part_of(
    mesh: "trimesh.Trimesh",
    names: list[str],
    pose: NDArray[np.float64] | None,
    known: dict[int, Material | None],
) -> Part:
    """Return a mesh with its colours and material; `known` has materials by the id of the trimesh material."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if pose is not None and not np.array_equal(pose, np.eye(4)):
        vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
        if np.linalg.det(pose[:3, :3]) < 0:  # a mirrored node would otherwise be inside out
            faces = faces[:, ::-1]
    material = getattr(getattr(mesh.visual, "material", None), "name", None)
    if material and material not in names:
        names = [*names, str(material)]
    uv = getattr(mesh.visual, "uv", None)
    corners = None
    if uv is not None and np.shape(uv) == (len(vertices), 2) and faces.min() >= 0 and faces.max() < len(uv):
        corners = np.asarray(uv, np.float32)[faces]
    part = Part(vertices, faces, np.zeros(len(faces), np.int16), ["/".join(names)], face_colours(mesh), corners)
    visual: Any = mesh.visual
    if visual.kind == "texture" and part.colour_rgb is not None and "color" not in visual.vertex_attributes:
        key = id(visual.material)
        if key not in known:
            known[key] = Material.of(visual.material)
        if (found := known[key]) is not None:
            part.materials, part.material = [found], np.zeros(len(faces), np.int16)
    return part


def face_colours(mesh: "trimesh.Trimesh") -> NDArray[np.uint8] | None:
    """Return the colour of every face of a trimesh (M, 3), from texture, material, faces or vertices; else None."""
    visual: Any = mesh.visual  # ColorVisuals or TextureVisuals; `kind` tells which
    try:
        if visual.kind == "texture":
            uv = None if visual.uv is None else np.asarray(visual.uv)[mesh.faces].mean(axis=1)
            shade = visual.vertex_attributes.get("color")  # glTF files may have vertex colours beside a material
            if shade is not None and getattr(visual.material, "baseColorTexture", None) is None:
                return _shaded(visual.material, np.asarray(shade)[mesh.faces][:, :, :3])
            return sample(visual.material, uv, len(mesh.faces))
        if visual.kind == "face":
            return np.asarray(visual.face_colors)[:, :3].astype(np.uint8)
        if visual.kind == "vertex":
            corners = np.asarray(visual.vertex_colors)[mesh.faces][:, :, :3]
            return np.asarray(corners.mean(axis=1).round().astype(np.uint8))
    except Exception:  # colours are for display only, so an invalid image must not make the mesh unusable
        return None
    return None


def _shaded(material: object, corners: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the product (m, 3) of a glTF base colour and the mean corner colours (m, 3, 3), both linear, in sRGB."""
    share = corners.mean(axis=1) / (np.iinfo(corners.dtype).max if corners.dtype.kind == "u" else 1.0)
    factor = getattr(material, "baseColorFactor", None)  # trimesh stores it as uint8
    light = np.clip(share * (1.0 if factor is None else np.asarray(factor)[:3] / 255), 0.0, 1.0)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
    return np.asarray(np.round(255 * srgb).astype(np.uint8))


def sample(material: Any, uv: NDArray[np.generic] | None, count: int) -> NDArray[np.uint8]:
    """Sample the colours (count, 3) of a trimesh material, at texture coordinates uv (count, 2) if available."""
    from trimesh.visual.color import uv_to_color

    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None and uv is not None:
        colours = uv_to_color(np.nan_to_num(uv), image)
        if colours is not None:
            return np.asarray(colours)[:, :3].astype(np.uint8)
    return np.tile(np.asarray(material.main_color)[:3].astype(np.uint8), (count, 1))


def _colours(parts: list[Part]) -> NDArray[np.uint8] | None:
    if all(part.colour_rgb is None for part in parts):
        return None
    grey = np.full(3, 160, np.uint8)
    return np.concatenate([np.tile(grey, (len(p.faces), 1)) if p.colour_rgb is None else p.colour_rgb for p in parts])


def _materials(parts: list[Part]) -> tuple[list[Material], NDArray[np.int16] | None]:
    """Return the materials of all parts without repetition, and the material of each face (m,)."""
    if all(part.material is None for part in parts):
        return [], None
    every = list(dict.fromkeys(material for part in parts for material in part.materials))
    place = {material: i for i, material in enumerate(every)}
    index = []
    for part in parts:
        of_part = np.array([*(place[material] for material in part.materials), -1], np.int16)  # −1 is the last
        index.append(np.full(len(part.faces), -1, np.int16) if part.material is None else of_part[part.material])
    return every, np.concatenate(index)


def _uvs(parts: list[Part]) -> NDArray[np.float32] | None:
    if all(part.uv is None for part in parts):
        return None
    return np.concatenate([np.full((len(p.faces), 3, 2), np.nan, np.float32) if p.uv is None else p.uv for p in parts])
