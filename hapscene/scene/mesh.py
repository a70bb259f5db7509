"""A mesh: triangles in metres, with the names and colours its file gave them."""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import REACH_MAX_M
from hapscene.errors import MeshError, no_such
from hapscene.geometry import columns_of, used_by
from hapscene.scene.topology import normals_of

if TYPE_CHECKING:
    import trimesh

    from hapscene.scene.neighbours import Neighbours

__all__ = [
    "FACE_MAX",
    "SIZE_M",
    "UNIT_M",
    "UNNAMED",
    "Mesh",
    "MeshWarning",
    "Part",
    "check_reading",
    "face_colours",
    "join",
    "parts_of",
    "sample",
    "unit_name",
]


UNIT_M: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Length of each known unit [m]."""

UNIT_ALIAS: Final = {
    **{"meter": "m", "meters": "m", "metre": "m", "metres": "m"},
    **{"centimeter": "cm", "centimeters": "cm", "centimetre": "cm", "centimetres": "cm"},
    **{"millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm"},
    **{"micron": "um", "microns": "um", "micrometer": "um", "micrometers": "um", "µm": "um", "μm": "um"},
    **{"inch": "in", "inches": "in", "foot": "ft", "feet": "ft"},
}
"""Longer spellings, as trimesh uses them."""

FACE_MAX: Final = 50_000_000
"""Most faces of one mesh [count]: with more, an ordinary computer runs out of memory."""

SIZE_M: Final = (1e-6, 1e5)
"""Smallest and largest diagonal of a mesh [m]. Outside it the unit is wrong, or the file is damaged."""

SCALE: Final = (1e-9, 1e9)
"""Smallest and largest factor by which a mesh is scaled [1]."""

UPS: Final = ("y", "z")
"""Axes that may point up in a file. In a scene z does."""

UNNAMED: Final = "default"
"""Group of the faces that the file gives no name."""


class MeshWarning(UserWarning):
    """A mesh that can be touched, but will not feel as its file suggests."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in the body's frame B, counter-clockwise seen from outside. Faces stay in the file's order.

    The arrays are read-only: bodies share one mesh.

    Attributes:
        vertices_m: (N, 3) float64 [m].
        faces: (M, 3) int32, indices into `vertices_m`.
        group: (M,) int16, index into `group_names`.
        group_names: material, object and group names in the file, joined by "/" where a face has several.
        colour_rgb: (M, 3) uint8, colour of each face in the file, or None; for pictures alone.
        path: the file it was loaded from, or None.
        unit: of the numbers in that file, a key of `UNIT_M`.
        up: the axis that is up in that file, "y" or "z". Here it is z: a file with y up has been turned.
        scale: how much larger than in that file [1].
        uv: (M, 3, 2) float32, texture coordinates of each face's corners, v upward; NaN where a face has none. None
            where no face has.

    Raises:
        MeshError: an array has the wrong shape, a vertex is not finite or farther than `REACH_MAX_M`, an index is out
            of range, there is no face.
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
            raise MeshError(f"{where}group must give every face an index into its {len(self.group_names)} names")
        _freeze(self, "vertices_m", vertices, np.float64)
        _freeze(self, "faces", faces, np.int32)
        _freeze(self, "group", group, np.int16)
        if self.colour_rgb is not None:
            if np.shape(self.colour_rgb) != (len(faces), 3):
                raise MeshError(f"{where}colour_rgb must have shape ({len(faces)}, 3)")
            _freeze(self, "colour_rgb", self.colour_rgb, np.uint8)
        if self.uv is not None:
            if np.shape(self.uv) != (len(faces), 3, 2):
                raise MeshError(f"{where}uv must have shape ({len(faces)}, 3, 2)")
            _freeze(self, "uv", self.uv, np.float32)
        _check_extent(self, where)

    def __repr__(self) -> str:
        where = f" of {self.path}" if self.path else ""
        return f"<Mesh{where}: {len(self.vertices_m):,} vertices, {len(self.faces):,} faces, {self.diagonal_m:.3g} m>"

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content, in hex: vertices [m] and faces, not names, colours or place."""
        content = hashlib.sha256(f"{len(self.vertices_m)} {len(self.faces)} ".encode())
        content.update(self.vertices_m.astype("<f8", copy=False).data)
        content.update(self.faces.astype("<i4", copy=False).data)
        return content.hexdigest()

    @cached_property
    def bounds_m(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the faces' bounding box (2, 3) [m]."""
        columns = columns_of(self.vertices_m, used_by(self.faces))
        return np.array([[column.min() for column in columns], [column.max() for column in columns]])

    @cached_property
    def neighbours(self) -> "Neighbours":
        """The faces across each face's edges."""
        from hapscene.scene.neighbours import neighbours_of

        return neighbours_of(self.vertices_m, self.faces)

    @property
    def diagonal_m(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(self.bounds_m[1] - self.bounds_m[0]))

    @property
    def triangles_m(self) -> NDArray[np.float64]:
        """Corners of every face (M, 3, 3) [m]."""
        return np.take(self.vertices_m, self.faces, axis=0)

    @property
    def normals(self) -> NDArray[np.float64]:
        """Unit normal of every face (M, 3), outward by winding; zero where a face has no area."""
        return normals_of(self.triangles_m)

    def faces_of(self, name: str) -> NDArray[np.bool_]:
        """Faces of a group, material or object (M,) bool.

        Raises:
            MeshError: no face has that name.
        """
        # A group is named "object/group/material": any of its parts finds it.
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
        """A mesh from a `trimesh.Trimesh` or `trimesh.Scene` in memory. Nothing is merged or reordered.

        Args:
            mesh: what to take; a scene becomes one mesh, its nodes in place.
            unit: of its numbers, a key of `UNIT_M`; without one, what `mesh.units` says.
            up: the axis of its numbers that is up, "y" or "z" (the default).
            scale: how much larger to make it [1].

        Raises:
            MeshError: no unit, an unknown unit, axis or scale, or a mesh that cannot be touched.
        """
        parts = parts_of(mesh, "trimesh object")
        known = unit if unit is not None else getattr(mesh, "units", None)
        if known is None:
            raise MeshError(
                f"a trimesh object without units: give unit=, one of {', '.join(UNIT_M)}, or set its .units"
            )
        return join(parts, unit_name(known), None, up or "z", scale)


def unit_name(unit: str) -> str:
    """The key of `UNIT_M` for any spelling of a unit.

    Raises:
        MeshError: the unit is not known.
    """
    name = UNIT_ALIAS.get(str(unit).strip().lower(), str(unit).strip().lower())
    if name not in UNIT_M:
        raise MeshError(no_such("unit of length", str(unit), UNIT_M))
    return name


def _check_shape(vertices: NDArray[Any], faces: NDArray[Any], where: str) -> None:
    if vertices.ndim != 2 or vertices.shape[1:] != (3,):
        raise MeshError(f"{where}vertices must have shape (N, 3), not {vertices.shape}")
    if not len(faces):
        raise MeshError(f"{where}no faces: a mesh needs at least one triangle to be touched")
    if faces.ndim != 2 or faces.shape[1:] != (3,):
        raise MeshError(f"{where}faces must have shape (M, 3), not {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise MeshError(f"{where}faces must be whole numbers, not {faces.dtype}")
    if len(faces) > FACE_MAX:
        raise MeshError(f"{where}{len(faces):,} faces; at most {FACE_MAX:,} are taken: reduce the mesh first")


def _check_indices(faces: NDArray[Any], vertex_count: int, where: str, of: str = "") -> None:
    if len(faces) and (faces.min() < 0 or faces.max() >= vertex_count):
        face, corner = np.argwhere((faces < 0) | (faces >= vertex_count))[0]
        raise MeshError(
            f"{where}face {face}{of} names vertex {faces[face, corner]}, but there are only vertices "
            f"0 to {vertex_count - 1}"
        )


def _check_extent(mesh: Mesh, where: str) -> None:
    size_m = mesh.diagonal_m
    if not SIZE_M[0] <= size_m <= SIZE_M[1]:
        raise MeshError(f"{where}{size_m:.3g} m across; expected {SIZE_M[0]:g} to {SIZE_M[1]:g} m: is the unit right?")
    if np.abs(mesh.bounds_m).max() > REACH_MAX_M:
        corners = mesh.faces.ravel()
        at, axis = np.argwhere(np.abs(mesh.vertices_m[corners]) > REACH_MAX_M)[0]
        raise MeshError(
            f"{where}vertex {corners[at]} is at {'xyz'[axis]} = {mesh.vertices_m[corners[at], axis]:g} m; expected at "
            f"most {REACH_MAX_M:g} m: is the unit right? If it is, move the mesh nearer to its origin"
        )


def _freeze(mesh: Mesh, name: str, values: Any, dtype: Any) -> None:
    # A copy unless nobody can write to it: the caller's array may still change.
    array = np.asarray(values, dtype, order="C")
    if array.base is not None or array.flags.writeable:
        array = np.array(values, dtype, order="C")
        array.setflags(write=False)
    object.__setattr__(mesh, name, array)


# Parts of a file, each with its own names and colours, from trimesh, and joined into one `Mesh`.


@dataclass
class Part:
    """Triangles in the file's own unit."""

    vertices: NDArray[Any]  # (n, 3)
    faces: NDArray[Any]  # (m, 3)
    group: NDArray[Any]  # (m,) index into names
    names: list[str]
    colour_rgb: NDArray[np.uint8] | None = None  # (m, 3)
    uv: NDArray[np.float32] | None = None  # (m, 3, 2)


def check_reading(up: str | None, scale: float) -> None:
    """Refuse, before a file is read, an unknown axis, or a scale that is not above 0.

    Raises:
        MeshError: with what would have worked.
    """
    if up is not None and up not in UPS:
        raise MeshError(f'no axis {up!r} is up in a mesh file; expected "y" or "z"')
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not SCALE[0] <= scale <= SCALE[1]:
        raise MeshError(f"a mesh is scaled by a number from {SCALE[0]:g} to {SCALE[1]:g}, as 0.001, not {scale!s:.20}")


def join(parts: list[Part], unit: str, path: Path | None, up: str = "z", scale: float = 1.0) -> Mesh:
    """One mesh of all parts, in their order, in metres, z up; parts of the same name share a group.

    Raises:
        MeshError: what `Mesh` and `check_reading` refuse.
    """
    check_reading(up, scale)
    whole = merged(parts, path)
    parts.clear()  # their arrays are as large
    whole.vertices *= UNIT_M[unit]
    if scale != 1.0:
        whole.vertices *= scale
    if up == "y":  # a quarter turn about x
        whole.vertices[:, 1:] = whole.vertices[:, :0:-1] * (-1.0, 1.0) + 0.0  # no −0
    for array in (whole.vertices, whole.faces):
        array.setflags(write=False)
    words = path, unit, up, float(scale)
    return Mesh(whole.vertices, whole.faces, whole.group, tuple(whole.names), whole.colour_rgb, *words, uv=whole.uv)


def merged(parts: list[Part], path: Path | None) -> Part:
    """All parts as one, in their own unit, with arrays of its own.

    Raises:
        MeshError: there are none, too many groups, or an index out of range.
    """
    where = f"{path}: " if path else "mesh: "
    if not parts:
        raise MeshError(f"{where}no faces: a mesh needs at least one triangle to be touched")
    names = list(dict.fromkeys(name for part in parts for name in part.names))
    if len(names) > np.iinfo(np.int16).max:
        raise MeshError(f"{where}{len(names):,} groups; at most {np.iinfo(np.int16).max:,} are kept apart")
    place = {name: i for i, name in enumerate(names)}
    start = np.cumsum([0] + [len(part.vertices) for part in parts])
    for part in parts:  # checked here too, since an index past its own part would name a vertex of the next
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
    )


def parts_of(loaded: "trimesh.Trimesh | trimesh.Scene", where: str) -> list[Part]:
    """The triangles of a trimesh object, every node in its place.

    Raises:
        MeshError: it is neither a mesh nor a scene of meshes.
    """
    import trimesh

    if isinstance(loaded, trimesh.Trimesh):
        return [_part(loaded, [UNNAMED], None)]
    if not isinstance(loaded, trimesh.Scene):
        raise MeshError(
            f"{where}: a {type(loaded).__name__} cannot be touched; expected a file, or a mesh of triangles"
        )
    parts = []
    made = 0  # a small file can name the same geometry over and over
    for node in loaded.graph.nodes_geometry:
        pose, geometry = loaded.graph[node]
        mesh = loaded.geometry[geometry]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            made += max(len(mesh.faces), len(mesh.vertices))
            if made > FACE_MAX:
                raise MeshError(f"{where}: more than {FACE_MAX:,} faces or vertices: reduce the mesh first")
            # A node without a name is called by its number: then the name of its geometry says more.
            parts.append(_part(mesh, [str(geometry if node.isdigit() else node)], pose))
    return parts


def _part(mesh: "trimesh.Trimesh", names: list[str], pose: NDArray[np.float64] | None) -> Part:
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if pose is not None and not np.array_equal(pose, np.eye(4)):
        vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
        if np.linalg.det(pose[:3, :3]) < 0:  # a mirrored node: without this its outside would be its inside
            faces = faces[:, ::-1]
    material = getattr(getattr(mesh.visual, "material", None), "name", None)
    if material and material not in names:
        names = [*names, str(material)]
    uv = getattr(mesh.visual, "uv", None)
    corners = None
    if uv is not None and np.shape(uv) == (len(vertices), 2) and faces.min() >= 0 and faces.max() < len(uv):
        corners = np.asarray(uv, np.float32)[faces]
    return Part(vertices, faces, np.zeros(len(faces), np.int16), ["/".join(names)], face_colours(mesh), corners)


def face_colours(mesh: "trimesh.Trimesh") -> NDArray[np.uint8] | None:
    """Colour of every face of a trimesh (M, 3), from texture, material, face or vertex colours; else None."""
    visual: Any = mesh.visual  # one of two classes, by what `kind` says
    try:
        if visual.kind == "texture":
            uv = None if visual.uv is None else np.asarray(visual.uv)[mesh.faces].mean(axis=1)
            shade = visual.vertex_attributes.get("color")  # of glTF, beside a material
            if shade is not None and getattr(visual.material, "baseColorTexture", None) is None:
                return _shaded(visual.material, np.asarray(shade)[mesh.faces][:, :, :3])
            return sample(visual.material, uv, len(mesh.faces))
        if visual.kind == "face":
            return np.asarray(visual.face_colors)[:, :3].astype(np.uint8)
        if visual.kind == "vertex":
            corners = np.asarray(visual.vertex_colors)[mesh.faces][:, :, :3]
            return np.asarray(corners.mean(axis=1).round().astype(np.uint8))
    except Exception:  # a broken picture spoils the colours, which are for the eye alone, not the mesh
        return None
    return None


def _shaded(material: Any, corners: NDArray[Any]) -> NDArray[np.uint8]:
    """Colours (m, 3) of a glTF material and the colours of faces' corners (m, 3, 3), which are both linear."""
    share = corners.mean(axis=1) / (np.iinfo(corners.dtype).max if corners.dtype.kind == "u" else 1.0)
    factor = getattr(material, "baseColorFactor", None)  # which trimesh keeps as bytes
    light = np.clip(share * (1.0 if factor is None else np.asarray(factor)[:3] / 255), 0.0, 1.0)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
    return np.asarray(np.round(255 * srgb).astype(np.uint8))


def sample(material: Any, uv: NDArray[Any] | None, count: int) -> NDArray[np.uint8]:
    """Colours (count, 3) of a trimesh material, at texture coordinates uv (count, 2) if there are any."""
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


def _uvs(parts: list[Part]) -> NDArray[np.float32] | None:
    if all(part.uv is None for part in parts):
        return None
    return np.concatenate([np.full((len(p.faces), 3, 2), np.nan, np.float32) if p.uv is None else p.uv for p in parts])
