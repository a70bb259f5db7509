"""Mesh files: read with trimesh, and checked for damage before."""

import io
import logging
import re
import shutil
import tempfile
import warnings
import weakref
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from hapscene.errors import MeshError, warn
from hapscene.io.files import open_zip, read_bytes, refusing
from hapscene.memory import memory_left_B
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
from hapscene.scene.obj import LINE_MAX, read_obj
from hapscene.scene.ply import declared, ply_groups
from hapscene.scene.resource_resolver import FolderResources
from hapscene.scene.step_file import faces_in, promised_by, step_glb
from hapscene.scene.topology import edges_of, weld

__all__ = ["FORMATS", "check", "files_of", "load_mesh"]

# First, a check of a mesh file's bytes, since trimesh takes some damaged files for smaller ones.


FILE_MAX_B: Final = 4_000_000_000
"""Largest mesh file that is read [bytes]."""

UNPACKED_MAX_B: Final = 250_000_000
"""Largest content of an archive that is read [bytes]."""

MEMORY_RATIO: Final = {"stl": 9, "ply": 18, "off": 18, "obj": 6, "glb": 10}
"""Memory that reading takes for each byte of a file [1], as measured; most where the numbers are text."""


def check(suffix: str, content: bytes, where: str) -> int:
    """Refuse a file that is not of its suffix, is truncated, or says that it holds more than it can.

    Returns:
        how many faces it promises; 0 where it does not say.

    Raises:
        MeshError: with what was expected.
    """
    if suffix == "ply":
        return declared(content, where).get("face", 0)
    if suffix == "off":
        return _off(content, where)
    if suffix == "stl":
        _stl(content, where)
    elif suffix in ("gltf", "glb"):
        check_gltf(content, suffix == "glb", where, FILE_MAX_B)
    return 0


_OFF_HEADER: Final = re.compile(rb"\s*(?:#[^\n]*\n\s*)*[A-Z]*OFF\s+(?:#[^\n]*\n\s*)*(\d{1,18})\s+(\d{1,18})\s")


def _off(content: bytes, where: str) -> int:
    """How many faces an OFF file promises: after the word OFF come the counts of vertices and faces.

    Raises:
        MeshError: no such header, fewer lines than it says, or a line that is too long.
    """
    lines = content.splitlines()
    if max(map(len, lines)) > LINE_MAX:
        raise MeshError(f"{where}: a line longer than {LINE_MAX:,} characters, which is not read")
    header = _OFF_HEADER.match(content.removeprefix(b"\xef\xbb\xbf"))
    if header is None:
        raise MeshError(f"{where}: not a readable OFF file: expected OFF and the counts of vertices and faces")
    vertex_count, face_count = int(header[1]), int(header[2])
    if len(lines) <= vertex_count + face_count:
        raise MeshError(
            f"{where}: the file is truncated: its header says {vertex_count:,} vertices and {face_count:,} faces, "
            f"it has {len(lines):,} lines"
        )
    return face_count


_FACET: Final = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE)
_CORNER: Final = re.compile(rb"\bvertex\s+[-+.\dni]", re.IGNORECASE)  # a number, nan or inf: no word of a name


def _stl(content: bytes, where: str) -> None:
    """A binary STL says its count of faces, 50 bytes each; an ASCII one ends with `endsolid`."""
    if _is_text(content):
        if b"endsolid" not in content[-1000:].lower():
            raise MeshError(f"{where}: the file is truncated: an ASCII STL file ends with 'endsolid'")
        facets, corners = (sum(1 for _ in word.finditer(content)) for word in (_FACET, _CORNER))
        if corners != 3 * facets:
            raise MeshError(f"{where}: damaged: {facets:,} facets have {corners:,} vertices; expected three for each")
        return
    end = _binary_end(content)
    if len(content) < end:
        raise MeshError(
            f"{where}: not a readable STL file, or truncated: it is neither text that begins with 'solid', "
            f"nor as long as the {(end - 84) // 50:,} faces of its binary header need"
        )
    rest = len(content) - end
    if rest and (end == 84 or rest % 50 == 0):
        count = f"{(end - 84) // 50:,} faces"
        raise MeshError(f"{where}: its binary header says {count}, and {rest:,} bytes follow them: export it anew")


def _is_text(content: bytes) -> bool:
    """Whether an STL is an ASCII one. Some binary ones begin with `solid` too."""
    return (
        len(content) != _binary_end(content)
        and content.lstrip()[:5].lower() == b"solid"
        and b"\0" not in content[:1000]
    )


def _binary_end(content: bytes) -> int:
    """Where the faces of a binary STL end [bytes]."""
    return 84 + 50 * int.from_bytes(content[80:84], "little")


logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else its tracebacks go to standard error

UNITLESS: Final = ("stl", "obj", "ply", "off")
"""Formats that carry no unit of length."""

STEP: Final = ("step", "stp")

Y_UP: Final = ("glb", "gltf")
"""Formats in which y is up: glTF 2.0, 3.4. The others do not say, and z is taken to be."""

FORMATS: Final = (*UNITLESS, "glb", "gltf", *STEP, "zip")
"""Suffixes of the files that can be loaded."""


def load_mesh(
    path: str | Path,
    unit: str | None = None,
    *,
    up: str | None = None,
    scale: float = 1.0,
    accept_damaged: bool = False,
) -> Mesh:
    """Load STL, OBJ (with MTL), PLY, OFF, GLB, glTF or STEP, or a zip archive that holds one of them.

    All geometries of a file become one mesh, in their places; vertices and faces are neither merged, dropped
    nor reordered. A face's group is its object, group and material name in the file, as far as it has them.

    Args:
        path: the file.
        unit: of the file's numbers, a key of `UNIT_M`. STL, OBJ, PLY and OFF carry none, so they need it.
            glTF is in metres; one given here wins over that. STEP is always converted from the unit it says.
        up: the axis that is up in the file, "y" or "z"; without it y in glTF, by its standard, and z in all others. A
            mesh with y up is turned, so that z is up in the scene.
        scale: how much larger to make it [1].
        accept_damaged: take what can be read of a damaged STEP file.

    Raises:
        MeshError: the file is missing, damaged or no mesh, or its unit is not known; or no such axis or scale.

    Warns:
        MeshWarning: the unit given is not that of the file; or what of a damaged file is missing.
    """
    path = Path(path)
    check_reading(up, scale)
    given = None if unit is None else unit_name(unit)
    suffix, content, resolver = _open(path)
    up = up or ("y" if suffix in Y_UP else "z")
    if suffix in UNITLESS and given is None:
        raise MeshError(
            f"{path}: {suffix.upper()} files carry no unit of length: say which one the numbers are in, with "
            f'unit="mm" in Python or --unit mm on the command line; known are {", ".join(UNIT_M)}'
        )
    if suffix in STEP:
        if given not in (None, "m"):
            warn(
                f"{path}: a STEP file says its own unit, and is converted by that; unit={unit!r} is not used",
                MeshWarning,
            )
        return _step(path, content, accept_damaged, up, scale)
    try:
        parts, own = _read(path, suffix, content, resolver)
        del content, resolver
        said = unit_name(own or "m")
        if suffix not in UNITLESS and given not in (None, said):
            warn(f"{path}: says that it is in {said}; taken to be in {given}, as unit={unit!r} says", MeshWarning)
        return join(parts, given or said, path, up, scale)
    except MemoryError:
        raise MeshError(f"{path}: to read it takes more memory than there is: reduce the mesh") from None


def files_of(path: Path) -> list[Path]:
    """The files beside a mesh file that it needs, such as an OBJ's colours: found by reading it again.

    Raises:
        MeshError: as `load_mesh`.
    """
    suffix, content, resolver = _open(path)
    if suffix not in ("obj", "gltf") or path.suffix.lower() == ".zip":
        return []
    _read(path, suffix, content, resolver)
    return [file for file in dict.fromkeys(resolver.found) if file.is_relative_to(path.resolve().parent)]


def _step(path: Path, content: bytes, accept_damaged: bool, up: str, scale: float) -> Mesh:
    promised = promised_by(content, str(path))
    damage = list(promised.damage)
    if not damage or accept_damaged:
        glb, said = step_glb(content, str(path))
        loaded = _load(path, "glb", glb, None)
        found = sum(faces_in(np.asarray(part.faces)) for part in loaded.geometry.values())
        damage += said
        if found < promised.face_count:
            damage.append(f"faces without triangles: {promised.face_count - found:,} of {promised.face_count:,}")
    told = f"{path}: the file is damaged: {'; '.join(damage)}"
    if damage and not accept_damaged:
        raise MeshError(f"{told}: export it anew, or take what is left with accept_damaged=True (--accept-damaged)")
    parts = parts_of(loaded, str(path))
    for part in parts:  # trimesh numbers the pieces of a part by chance, one for each colour
        part.names = [re.sub(r"_[0-9a-f]{6}(?=/|$)", "", name) for name in part.names] if len(parts) > 1 else part.names
    if damage and not parts:
        raise MeshError(f"{told}; nothing is left of it")
    mesh = join(parts, "m", path, up, scale)
    if damage:
        warn(f"{told}; what is left is taken, {len(mesh.faces):,} triangles", MeshWarning)
        return mesh
    doubts = list(promised.doubts)
    if promised.is_closed and not edges_of(mesh.faces, weld(mesh.vertices_m)).closed:
        doubts.append("its shells, which it says are closed, are open")
    if doubts:
        warn(f"{path}: may be damaged, and its shape another: {'; '.join(doubts)}", MeshWarning)
    return mesh


def _open(path: Path) -> tuple[str, bytes, FolderResources]:
    """Suffix and content of a file, or of the one mesh in an archive, and what finds the files beside it."""
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        raise MeshError(f"{path}: no mesh format {path.suffix!r}; there are: {', '.join(FORMATS)}")
    with refusing(MeshError):
        content = read_bytes(path, FILE_MAX_B, "mesh file that is read")
    if not content:
        raise MeshError(f"{path}: the file is empty")
    return _unzip(path, content) if suffix == "zip" else (suffix, content, FolderResources(path, FILE_MAX_B))


def _unzip(path: Path, content: bytes) -> tuple[str, bytes, FolderResources]:
    """The same of the one mesh in an archive, which is unpacked into a folder that goes with the resources."""
    with refusing(MeshError, str(path)):
        archive = open_zip(io.BytesIO(content), UNPACKED_MAX_B, "unpack it and load the mesh itself")
    found = [n for n in archive.namelist() if _suffix(n) in FORMATS[:-1] and not n.startswith("__MACOSX")]
    if len(found) != 1:
        what = ", ".join(found[:5]) or "none"
        raise MeshError(f"{path}: expected one mesh file in the archive, found {what}; unpack it and load each")
    resources = FolderResources(path, UNPACKED_MAX_B)
    try:
        folder = Path(tempfile.mkdtemp()).resolve()
        weakref.finalize(resources, shutil.rmtree, folder, ignore_errors=True)
        archive.extractall(folder)
        member = Path(archive.extract(found[0], folder))
    except Exception as error:  # damaged, encrypted or packed in an odd way: zipfile raises anything at all
        raise MeshError(f"{path}: not a readable zip archive: {error}") from None
    resources.folders = [member.parent, folder]
    return _suffix(found[0]), member.read_bytes(), resources


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower().lstrip(".")


def _read(path: Path, suffix: str, content: bytes, resolver: Any) -> tuple[list[Part], str | None]:
    """Parts of a file, and the unit that it says."""
    needed_B, free_B = MEMORY_RATIO.get(suffix, 0) * len(content), memory_left_B()
    if needed_B > free_B:
        raise MeshError(
            f"{path}: to read it takes some {needed_B / 1e9:.1f} GB of memory, and {free_B / 1e9:.1f} GB are free: "
            "reduce the mesh, or save it as binary .ply, which takes the least"
        )
    if suffix == "obj":
        return [read_obj(content, str(path), resolver)], None
    face_count = check(suffix, content, str(path))
    if suffix == "stl" and not _is_text(content):
        content = content[: _binary_end(content)]  # without what some programs write after the faces
    loaded = _load(path, suffix, content, resolver)
    parts = parts_of(loaded, str(path))
    if (found := sum(len(part.faces) for part in parts)) < face_count:
        raise MeshError(f"{path}: the file is truncated: its header says {face_count:,} faces, there are {found:,}")
    if suffix in UNITLESS:  # one nameless geometry, which trimesh calls by the name of its file
        names = ply_groups(content, loaded) if suffix == "ply" else None
        for part in parts:
            part.group, part.names = names or (part.group, [UNNAMED] if len(parts) == 1 else part.names)
    return parts, loaded.units


def _load(path: Path, suffix: str, content: bytes, resolver: Any) -> Any:
    import trimesh

    try:
        with warnings.catch_warnings():
            # older numpy only warns of an invalid number, and leaves out what follows
            warnings.filterwarnings("error", message="string or file could not be read")
            return trimesh.load_scene(io.BytesIO(content), file_type=suffix, resolver=resolver, process=False)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # its loaders raise anything at all on a damaged file
        if isinstance(error, ValueError) and (text := str(error).strip()):
            reason = text.split("\n")[0][:200]
        else:  # words about the loader's insides would help no one
            reason = f"damaged, or of a kind that trimesh does not read ({type(error).__name__})"
        raise MeshError(f"{path}: not a readable {suffix.upper()} file, or truncated: {reason}") from None
