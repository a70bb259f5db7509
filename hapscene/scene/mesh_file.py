"""Mesh files: what is read with trimesh, and everything that can be wrong with a file, said in a sentence."""

import io
from pathlib import Path, PurePosixPath
from typing import Any, Final

from hapscene.errors import MeshError
from hapscene.scene.companion import Companions, Packed
from hapscene.scene.mesh import UNIT_M, UNNAMED, Mesh, unit_name, warn
from hapscene.scene.mesh_check import FILE_MAX_B, check, open_archive, stl_faces
from hapscene.scene.part import Part, join, parts_of
from hapscene.scene.ply import ply_groups

UNITLESS: Final = ("stl", "obj", "ply", "off")
"""Formats that carry no unit of length."""

FORMATS: Final = (*UNITLESS, "glb", "gltf", "3mf", "step", "stp", "zip")
"""Suffixes of the files that can be loaded."""


def read_mesh(path: Path, unit: str | None) -> Mesh:
    """What `hapscene.scene.mesh.load_mesh` does."""
    given = None if unit is None else unit_name(unit)
    suffix, content, resolver = _open(path)
    if suffix in UNITLESS and given is None:
        raise MeshError(
            f"{path}: {suffix.upper()} files carry no unit of length: say which one the numbers are in, with "
            f'unit="mm" in Python or --unit mm on the command line; known are {", ".join(UNIT_M)}'
        )
    parts, own = _read(path, suffix, content, resolver)
    if suffix in ("step", "stp") and given not in (None, "m"):
        warn(f"{path}: a STEP file says its own unit, and is converted by that; unit={unit!r} is not used")
        given = None
    return join(parts, given or unit_name(own or "m"), path)


def _open(path: Path) -> tuple[str, bytes, Any]:
    """Suffix and content of a file, or of the one mesh in an archive, and what finds the files beside it."""
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        raise MeshError(f"{path}: no mesh format {path.suffix!r}; there are: {', '.join(FORMATS)}")
    try:
        if path.stat().st_size > FILE_MAX_B:
            raise MeshError(f"{path}: {path.stat().st_size:,} bytes; at most {FILE_MAX_B:,} are read")
        content = path.read_bytes()
    except FileNotFoundError:
        raise MeshError(f"{path}: no such file") from None
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror}") from None
    if not content:
        raise MeshError(f"{path}: the file is empty")
    return _unzip(path, content) if suffix == "zip" else (suffix, content, Companions(path, FILE_MAX_B))


def _unzip(path: Path, content: bytes) -> tuple[str, bytes, Any]:
    archive = open_archive(content, str(path), "unpack it and load the mesh itself")
    found = [n for n in archive.namelist() if _suffix(n) in FORMATS[:-1] and not n.startswith("__MACOSX")]
    if len(found) != 1:
        what = ", ".join(found[:5]) or "none"
        raise MeshError(f"{path}: expected one mesh file in the archive, found {what}; unpack it and load each")
    packed = Packed(path, archive, found[0])
    return _suffix(found[0]), packed.member(found[0]), packed


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower().lstrip(".")


def _read(path: Path, suffix: str, content: bytes, resolver: Any) -> tuple[list[Part], str | None]:
    """Parts of a file, and the unit that it says."""
    if suffix == "obj":
        from hapscene.scene.obj import read_obj

        return [read_obj(content.decode("utf-8", errors="replace"), str(path), resolver)], None
    face_count = check(suffix, content, str(path))
    content = stl_faces(content) if suffix == "stl" else content
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
        return trimesh.load_scene(io.BytesIO(content), file_type=suffix, resolver=resolver, process=False)
    except MeshError:
        raise
    except Exception as error:  # its loaders raise anything at all on a damaged file
        if isinstance(error, ValueError) and (text := str(error).strip()):
            reason = text.split("\n")[0][:200]
        else:  # words about the loader's insides would help no one
            reason = f"damaged, or of a kind that trimesh does not read ({type(error).__name__})"
        raise MeshError(f"{path}: not a readable {suffix.upper()} file: {reason}") from None
