"""Loading of mesh files with trimesh, after a check for damage."""

import io
import logging
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np

from hapscene.constants import UNITLESS
from hapscene.errors import MeshError, warn
from hapscene.io.files import METRES, read_bytes, refusing
from hapscene.scene.gltf_check import check_gltf
from hapscene.scene.mesh import (
    UNIT_M,
    UNNAMED,
    Mesh,
    MeshWarning,
    Part,
    check_reading,
    join,
    parts_of,
    unit_name,
)
from hapscene.scene.obj import read_obj
from hapscene.scene.off import read_off
from hapscene.scene.ply import add_look, declared_counts, ply_groups, strips_to_faces
from hapscene.scene.step_file import declared_by, faces_in, step_glb
from hapscene.scene.topology import edges_of, weld

__all__ = ["FORMATS", "FolderResources", "files_of", "load_mesh"]

# Access to the files that a mesh file refers to, such as the buffers of a glTF file or the materials of an OBJ file.
#
# Only files in the folder of the mesh file and below are opened, since an untrusted file may name any path. The class
# implements the resolver interface of trimesh.


class FolderResources:
    """Reads files from the folder of a mesh file.

    Args:
        path: the mesh file. If it is a symbolic link, the folder of its target is searched before that of the link.
        most_B: maximum total size of the files [bytes].

    Attributes:
        folders: folders that are searched.
        found: files that were read.
        missing: names that were not found.
    """

    def __init__(self, path: Path, most_B: int) -> None:
        self._path, self._left_B = path, most_B
        self.folders = list(dict.fromkeys((path.resolve().parent, path.parent.resolve())))
        self.found: list[Path] = []
        self.missing: list[str] = []

    def get(self, name: str) -> bytes:
        """Read a file by its name, a relative path or URI.

        Raises:
            MeshError: the file is not found, too large, or cannot be read.
        """
        file = self._find(name)
        if file is None:
            self.missing.append(name)
            raise MeshError(_missing(self._path, name))
        try:
            self._left_B -= file.stat().st_size
            if self._left_B < 0:
                raise MeshError(f"{self._path}: too large: its file {file.name} exceeds the limit")
            self.found.append(file)
            return file.read_bytes()
        except OSError as error:
            raise MeshError(f"{file}: cannot be read: {error.strerror}") from None

    __getitem__ = get

    def _find(self, name: str) -> Path | None:
        for spelling in _spellings(name):
            for folder in self.folders:
                try:
                    file = (folder / spelling).resolve()
                    if file.is_relative_to(folder) and file.is_file():
                        return file
                except (OSError, ValueError):  # not a valid file name
                    continue
        return None


def _spellings(name: str) -> Iterator[str]:
    """Yield possible names of a file; absolute paths from another computer are reduced to the file name."""
    last = name.strip().replace("\\", "/").rpartition("/")[2]
    yield from dict.fromkeys((name.strip(), unquote(name.strip()), last, unquote(last)))


def _missing(path: Path, name: str) -> str:
    return (
        f"{path}: the file {name[:100]!r}, which it refers to, is not found: put it in the same folder, or export "
        "everything into one file (other folders and web addresses are not opened)"
    )


# Checks on the bytes of a file come first: trimesh reads some truncated files without an error.


FILE_MAX_B: Final = 4_000_000_000
"""Maximum size of a mesh file [bytes]."""


def check(suffix: str, content: bytes, where: str) -> int:
    """Check that a file matches its suffix, is complete, and does not declare more elements than it can hold.

    Returns the number of faces that the file declares, 0 if it declares none. Raises MeshError if the check fails.
    """
    if suffix == "ply":
        return declared_counts(content, where).get("face", 0)
    if suffix == "stl":
        _stl(content, where)
    elif suffix in ("gltf", "glb"):
        check_gltf(content, suffix == "glb", where, FILE_MAX_B)
    return 0


_FACET: Final = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE)
_CORNER: Final = re.compile(
    rb"\bvertex\s+[-+.\dni]", re.IGNORECASE
)  # a number, nan or inf, so that words in names do not match


def _stl(content: bytes, where: str) -> None:
    """Check an STL file: a binary file declares its number of faces; an ASCII file ends with `endsolid`."""
    if _is_text(content):
        if b"endsolid" not in content[-1000:].lower():
            raise MeshError(f"{where}: truncated: an ASCII STL file must end with 'endsolid'")
        facets, corners = (sum(1 for _ in word.finditer(content)) for word in (_FACET, _CORNER))
        if corners != 3 * facets:
            raise MeshError(f"{where}: damaged: {facets:,} facets have {corners:,} vertices; expected three per facet")
        return
    end = _binary_end(content)
    if len(content) < end:
        raise MeshError(
            f"{where}: not a valid STL file, or truncated: it does not start with 'solid', and it is shorter than the "
            f"{(end - 84) // 50:,} faces in its binary header require"
        )
    rest = len(content) - end
    if rest and (end == 84 or rest % 50 == 0):
        count = f"{(end - 84) // 50:,} faces"
        raise MeshError(f"{where}: damaged: {rest:,} bytes follow the {count} in its header; export it again")


def _is_text(content: bytes) -> bool:
    """Return whether an STL file is ASCII. Some binary files begin with `solid` too."""
    return (
        len(content) != _binary_end(content)
        and content.lstrip()[:5].lower() == b"solid"
        and b"\0" not in content[:1000]
    )


def _binary_end(content: bytes) -> int:
    """Return the offset of the end of the faces in a binary STL [bytes]."""
    return 84 + 50 * int.from_bytes(content[80:84], "little")


logging.getLogger("trimesh").addHandler(logging.NullHandler())  # keep its tracebacks off standard error

STEP: Final = ("step", "stp")

Y_UP: Final = ("glb", "gltf")
"""Formats with y up (glTF 2.0, section 3.4). Other formats do not define it; z is assumed."""

FORMATS: Final = (*UNITLESS, "glb", "gltf", *STEP)
"""Suffixes of the supported files."""


def load_mesh(path: str | Path, unit: str | None = None, *, up: str | None = None, scale: float = 1.0) -> Mesh:
    """Load a mesh from STL, OBJ (with MTL), PLY, OFF, GLB, glTF or STEP.

    All objects in a file become one mesh, at their poses. Vertices and faces are not merged, dropped or reordered. The
    group name of a face consists of its object, group and material names in the file.

    Args:
        path: the mesh file.
        unit: unit of length of the coordinates, a key of `UNIT_M`. Required for STL, OBJ, PLY and OFF, which have no
            unit. For glTF it overrides the standard's metre. STEP files contain their unit, which is always used.
        up: vertical axis in the file, "y" or "z". Default: y for glTF, as its standard requires, else z. Meshes with y
            up are rotated to z up.
        scale: scale factor [1].

    Raises:
        MeshError: the file is missing, damaged or not a mesh; its unit is unknown; or `up` or `scale` is invalid.

    Warns:
        MeshWarning: `unit` differs from that of the file, or its textures are missing.
    """
    path = Path(path)
    check_reading(up, scale)
    given = None if unit is None else unit_name(unit)
    suffix, content, resolver = _open(path)
    up = up or ("y" if suffix in Y_UP else "z")
    if suffix in UNITLESS and given is None and METRES in content[:100]:
        given = "m"
    if suffix in UNITLESS and given is None:
        raise MeshError(
            f'{path}: {suffix.upper()} files have no unit of length: specify it with --unit mm, or unit="mm" in '
            f"Python; units are {', '.join(UNIT_M)}"
        )
    if suffix in STEP:
        if given not in (None, "m"):
            warn(f"{path}: unit={unit!r} is ignored: a STEP file contains its unit", MeshWarning)
        return _step(path, content, up, scale)
    try:
        parts, own_unit = _read(path, suffix, content, resolver)
        for name in dict.fromkeys(resolver.missing):
            warn(
                f"{path}: its texture or material file {name[:100]!r} is not found: put it beside the mesh", MeshWarning
            )
        del content, resolver
        file_unit = unit_name(own_unit or "m")
        if suffix not in UNITLESS and given not in (None, file_unit):
            warn(f"{path}: the unit of the file, {file_unit}, is overridden by unit={unit!r}", MeshWarning)
        return join(parts, given or file_unit, path, up, scale)
    except MemoryError:
        raise MeshError(f"{path}: not enough memory to load this file: simplify the mesh") from None


def files_of(path: Path) -> list[Path]:
    """Return the files that a mesh file refers to, such as the material library of an OBJ, by loading it again.

    Raises:
        MeshError: as in `load_mesh`.
    """
    suffix, content, resolver = _open(path)
    if suffix not in ("obj", "gltf"):
        return []
    _read(path, suffix, content, resolver)
    return [file for file in dict.fromkeys(resolver.found) if file.is_relative_to(path.resolve().parent)]


def _step(path: Path, content: bytes, up: str, scale: float) -> Mesh:
    declared = declared_by(content, str(path))
    damage = list(declared.damage)
    if not damage:
        glb, damage = step_glb(content, str(path))
        loaded = _load(path, "glb", glb, None)
        found = sum(faces_in(np.asarray(part.faces)) for part in loaded.geometry.values())
        if found < declared.face_count:
            damage.append(f"{declared.face_count - found:,} of {declared.face_count:,} faces have no triangles")
    if damage:
        raise MeshError(f"{path}: the STEP file is damaged: {'; '.join(damage)}: export it again")
    parts = parts_of(loaded, str(path))
    for part in parts:  # trimesh appends random digits to the pieces of a part
        part.names = [re.sub(r"_[0-9a-f]{6}(?=/|$)", "", name) for name in part.names] if len(parts) > 1 else part.names
    mesh = join(parts, "m", path, up, scale)
    if declared.is_closed and not edges_of(mesh.faces, weld(mesh.vertices_m)).closed:
        warn(f"{path}: the STEP file may be damaged: shells that are declared closed are open", MeshWarning)
    return mesh


def _open(path: Path) -> tuple[str, bytes, FolderResources]:
    """Return suffix and content of a mesh file, and the resolver of files beside it."""
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        raise MeshError(
            f"{path}: unsupported format {path.suffix!r}; expected .scene.json or one of: {', '.join(FORMATS)}"
        )
    with refusing(MeshError):
        content = read_bytes(path, FILE_MAX_B, "mesh file")
    if not content:
        raise MeshError(f"{path}: the file is empty")
    return suffix, content, FolderResources(path, FILE_MAX_B)


def _read(path: Path, suffix: str, content: bytes, resolver: FolderResources) -> tuple[list[Part], str | None]:
    """Return the parts of a mesh file, and its unit if it has one."""
    if suffix == "obj":
        return [read_obj(content, str(path), resolver)], None
    if suffix == "off":
        return [read_off(content, str(path))], None
    if suffix == "ply":
        content = strips_to_faces(content, str(path))
    face_count = check(suffix, content, str(path))
    if suffix == "stl" and not _is_text(content):
        content = content[: _binary_end(content)]  # drop data that some programs append after the faces
    loaded = _load(path, suffix, content, resolver)
    parts = parts_of(loaded, str(path))
    if (found := sum(len(part.faces) for part in parts)) < face_count:
        raise MeshError(f"{path}: truncated: the header declares {face_count:,} faces, but the file has {found:,}")
    if suffix in UNITLESS:  # trimesh names the only geometry of these files after the file
        names = ply_groups(content, loaded) if suffix == "ply" else None
        for part in parts:
            part.group, part.names = names or (part.group, [UNNAMED] if len(parts) == 1 else part.names)
            if names and suffix == "ply":
                add_look(part, content, loaded)
    return parts, loaded.units


def _load(path: Path, suffix: str, content: bytes, resolver: Any) -> Any:
    import trimesh

    try:
        with warnings.catch_warnings():
            # older NumPy versions only warn about an invalid number, and skip the rest of the file
            warnings.filterwarnings("error", message="string or file could not be read")
            return trimesh.load_scene(io.BytesIO(content), file_type=suffix, resolver=resolver, process=False)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # loaders of trimesh raise many classes for damaged files
        if isinstance(error, ValueError) and (text := str(error).strip()):
            reason = text.split("\n")[0][:200]
        else:  # the message is about internals of the loader and does not help the user
            reason = f"damaged, or a variant that trimesh does not support ({type(error).__name__})"
        raise MeshError(f"{path}: not a valid {suffix.upper()} file, or truncated: {reason}") from None
