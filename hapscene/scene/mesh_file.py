"""Mesh files: what is read with trimesh, and everything that can be wrong with a file, said in a sentence."""

import io
import logging
import re
import warnings
import zipfile
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
from hapscene.scene.ply import binary_ply, declared, ply_groups
from hapscene.scene.resource_resolver import ArchiveResources, FolderResources
from hapscene.scene.step_file import faces_in, promised_by, step_glb
from hapscene.scene.topology import edges_of, weld

# A first look at a mesh file's bytes, since trimesh takes some damaged files for smaller ones.


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


def open_archive(content: bytes, where: str, advice: str) -> zipfile.ZipFile:
    """A zip archive that unpacks to no more than `UNPACKED_MAX_B` and its own size allow.

    Args:
        content: the archive's.
        where: what messages call it.
        advice: what to do where it is more.

    Raises:
        MeshError: it is no archive, or unpacks to more.
    """
    with refusing(MeshError, where):
        return open_zip(io.BytesIO(content), UNPACKED_MAX_B, advice)


def _off(content: bytes, where: str) -> int:
    """After the word OFF come the counts of vertices and faces, then a line for each; how many faces.

    Raises:
        MeshError: a vertex that is not there, or not whole.
    """
    texts = content.splitlines()
    if longest := next((i for i, line in enumerate(texts, 1) if len(line) > LINE_MAX), None):
        raise MeshError(f"{where}, line {longest}: longer than {LINE_MAX:,} characters, which is not read")
    numbered = ((i, line.split(b"#")[0].split()) for i, line in enumerate(texts, 1))
    lines = ((i, words) for i, words in numbered if words)
    number, words = next(lines, (1, []))
    if not words or not words[0].endswith(b"OFF"):
        raise MeshError(f"{where}: not a readable OFF file: its first word must be OFF")
    if not (words := words[1:]):
        number, words = next(lines, (number + 1, []))
    if len(words) < 2 or not (words[0].isdigit() and words[1].isdigit()):
        raise MeshError(f"{where}, line {number}: expected the counts of vertices and faces after OFF")
    count = int(words[0])
    for vertex in range(count):
        number, numbers = next(lines, (0, []))
        if not number:
            raise MeshError(f"{where}: the file is truncated: its header says {count:,} vertices, there are {vertex:,}")
        if len(numbers) < 3:
            found = b" ".join(numbers).decode("utf-8", errors="replace")[:60]
            raise MeshError(
                f"{where}, line {number}: expected three numbers for a vertex, found {found!r}; is the file truncated?"
            )
    return int(words[1])


_STL_FACE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def _binary_stl(content: bytes) -> Part:
    """A binary STL without what some programs write after its faces: trimesh would take twice the memory and time."""
    corners = np.frombuffer(content, _STL_FACE, (_binary_end(content) - 84) // 50, 84)["corners"]
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return Part(corners.reshape(-1, 3), faces, np.zeros(len(faces), np.int16), [UNNAMED])


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
    if suffix not in ("obj", "gltf") or not isinstance(resolver, FolderResources):
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


def _open(path: Path) -> tuple[str, bytes, Any]:
    """Suffix and content of a file, or of the one mesh in an archive, and what finds the files beside it."""
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        raise MeshError(f"{path}: no mesh format {path.suffix!r}; there are: {', '.join(FORMATS)}")
    with refusing(MeshError):
        content = read_bytes(path, FILE_MAX_B, "mesh file that is read")
    if not content:
        raise MeshError(f"{path}: the file is empty")
    return _unzip(path, content) if suffix == "zip" else (suffix, content, FolderResources(path, FILE_MAX_B))


def _unzip(path: Path, content: bytes) -> tuple[str, bytes, Any]:
    archive = open_archive(content, str(path), "unpack it and load the mesh itself")
    found = [n for n in archive.namelist() if _suffix(n) in FORMATS[:-1] and not n.startswith("__MACOSX")]
    if len(found) != 1:
        what = ", ".join(found[:5]) or "none"
        raise MeshError(f"{path}: expected one mesh file in the archive, found {what}; unpack it and load each")
    packed = ArchiveResources(path, archive, found[0])
    return _suffix(found[0]), packed.member(found[0]), packed


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
        return [_binary_stl(content)], None
    if suffix == "ply" and (plain := binary_ply(content)) is not None:
        return [plain], None
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
            # older numpy only warns of a number that is none, and leaves out what follows
            warnings.filterwarnings("error", message="string or file could not be read")
            return trimesh.load_scene(io.BytesIO(content), file_type=suffix, resolver=resolver, process=False)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # its loaders raise anything at all on a damaged file
        if isinstance(error, ValueError) and (text := str(error).strip()):
            reason = text.split("\n")[0][:200]
        else:  # words about the loader's insides would help no one
            reason = f"damaged, or of a kind that trimesh does not read ({type(error).__name__})"
        raise MeshError(f"{path}: not a readable {suffix.upper()} file: {reason}") from None
