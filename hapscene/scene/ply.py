"""PLY files: export of meshes with exact positions, groups, colours and materials; check of headers."""

import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import MeshError
from hapscene.io.files import write_whole
from hapscene.scene.material import Material, open_picture, picture_file
from hapscene.scene.mesh import Mesh, Part

__all__ = ["HEADER_MAX_B", "add_look", "declared_counts", "mesh_to_ply", "ply_groups", "save_mesh"]

_COMMENT: Final = "hapscene group"
_MATERIAL: Final = "hapscene material"
_UV: Final = ("u0", "v0", "u1", "v1", "u2", "v2")

HEADER_MAX_B: Final = 16_000_000
"""Maximum size of a header [bytes]: enough for 10,000 bodies, or 32,767 groups or swatches with long names."""


def save_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh as binary PLY in metres. Positions are float64: the mesh loads without loss with unit="m".

    Groups are written as a face property `group` with their names in comments, colours as face properties. So are
    materials, with their numbers in comments and their picture files in an element `picture`.

    Raises:
        MeshError: the suffix is not .ply, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".ply":
        raise MeshError(f"{path}: meshes are written as .ply only, which keeps exact positions")
    write_whole(path, mesh_to_ply(mesh), MeshError)


def mesh_to_ply(mesh: Mesh) -> bytes:
    """Return the content of a binary PLY file."""
    lines = ["ply", "format binary_little_endian 1.0", "comment unit m"]
    lines += [f"comment {_COMMENT} {_in_a_line(name)}" for name in mesh.group_names]
    lines += [f"element vertex {len(mesh.vertices_m)}", *(f"property double {axis}" for axis in "xyz")]
    lines += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    fields: list[Any] = [("count", "u1"), ("corners", "<i4", 3), ("group", "<i2")]
    lines += ["property short group"]
    columns: list[tuple[Any, str, str, tuple[str, ...]]] = [
        (mesh.colour_rgb, "u1", "uchar", ("red", "green", "blue")),
        (mesh.uv, "<f4", "float", _UV),
        (mesh.material, "<i2", "short", ("material",)),
    ]
    columns = [column for column in columns if column[0] is not None]
    for _, dtype, kind, names in columns:
        fields += [(names[0], dtype, (len(names),))]
        lines += [f"property {kind} {name}" for name in names]
    pictures = b""
    if mesh.material is not None:
        more, pictures = _materials(mesh)
        lines += [*more, f"element picture {len(pictures)}", "property uchar byte"]
    faces = np.zeros(len(mesh.faces), fields)
    faces["count"], faces["corners"], faces["group"] = 3, mesh.faces, mesh.group
    for values, *_, names in columns:
        faces[names[0]] = values.reshape(len(faces), len(names))
    header = "\n".join([*lines, "end_header", ""]).encode(errors="replace")
    return header + np.ascontiguousarray(mesh.vertices_m, "<f8").tobytes() + faces.tobytes() + pictures


def _materials(mesh: Mesh) -> tuple[list[str], bytes]:
    """Return a comment for each material of a mesh, and all picture files in a row."""
    lines, content, places = [], b"", dict[int, tuple[int, int]]()
    for material in mesh.materials:
        textures = {}
        for name, picture in material.textures.items():
            if id(picture) not in places:
                file = b""
                with suppress(Exception):  # a damaged picture must not prevent that a scene is saved
                    file, _ = picture_file(picture)
                places[id(picture)] = len(content), len(content) + len(file)
                content += file
            textures[name] = places[id(picture)]
        lines.append(f"comment {_MATERIAL} {_in_a_line(json.dumps(material.numbers | {'textures': textures}))}")
    return lines, content


def _in_a_line(name: str) -> str:
    """Return a name without line breaks and without the end mark of the header."""
    return " ".join(name.split()).replace("end_header", "end-header")


def _header(content: bytes) -> list[str]:
    end = content.find(b"end_header", 0, HEADER_MAX_B)
    return content[: max(end, 0)].decode("utf-8", errors="replace").splitlines()


def declared_counts(content: bytes, where: str) -> dict[str, int]:
    """Return the number of elements of each kind that the header of a PLY file declares.

    Raises:
        MeshError: there is no header; or a number exceeds the size of the file, so that it must not be allocated; or
            the file has triangle strips, which trimesh does not read.
    """
    header = _header(content)
    if not content.startswith(b"ply") or not header:
        raise MeshError(f"{where}: not a valid PLY file: no header from 'ply' to 'end_header'")
    elements = [re.fullmatch(r"\s*element\s+(\S+)\s+(\d{1,18})\s*", line) for line in header]
    counts = {element[1]: int(element[2]) for element in elements if element}
    for element, count in counts.items():
        if count > len(content):
            raise MeshError(
                f"{where}: not a valid PLY file, or truncated: the header declares {count:,} of element {element!r}, "
                f"but the size of the file is {len(content):,} bytes"
            )
    if counts.get("tristrips"):
        raise MeshError(f"{where}: triangle strips are not supported: export the mesh with faces")
    return counts


def ply_groups(content: bytes, loaded: Any) -> tuple[NDArray[np.int64], list[str]] | None:
    """Return groups (m,) and group names of a file from `save_mesh`; None for other files."""
    try:
        (mesh,) = loaded.geometry.values()
        group = np.asarray(mesh.metadata["_ply_raw"]["face"]["data"]["group"]).ravel().astype(np.int64)
    except (KeyError, ValueError, TypeError, IndexError):
        return None
    return _groups(content, group) if len(group) == len(mesh.faces) else None


def add_look(part: Part, content: bytes, loaded: Any) -> None:
    """Add texture coordinates and materials of a file from `save_mesh` to its faces, as far as they are valid."""
    with suppress(Exception):  # they are for display only, and those of an untrusted file may be of any type
        (mesh,) = loaded.geometry.values()
        raw = mesh.metadata["_ply_raw"]
        face = raw["face"]["data"]
        uv = np.stack([face[name].ravel() for name in _UV], axis=1).astype(np.float32)
        part.uv = uv.reshape(len(part.faces), 3, 2)
    with suppress(Exception):
        material = np.asarray(face["material"]).ravel().astype(np.int16)
        start, files = f"comment {_MATERIAL} ", raw["picture"]["data"]["byte"].tobytes()
        numbers = [json.loads(line[len(start) :]) for line in _header(content) if line.startswith(start)]
        pictures: dict[tuple[int, int], Any] = {}
        found = []
        for own in numbers:
            places = {name: (int(a), int(b)) for name, (a, b) in own.pop("textures").items()}
            for a, b in set(places.values()) - set(pictures):
                with suppress(OSError):
                    pictures[a, b] = open_picture(files[a:b])
            found.append(Material.from_numbers(own, {name: pictures.get(place) for name, place in places.items()}))
        known = [one for one in found if one is not None]
        if len(known) == len(found) and len(material) == len(part.faces) and set(material) <= {-1, *range(len(known))}:
            part.materials, part.material = known, material


def _groups(content: bytes, group: NDArray[np.int64]) -> tuple[NDArray[np.int64], list[str]] | None:
    """Return groups (m,) and their names; None if the header does not name all groups."""
    start = f"comment {_COMMENT} "
    names = [line[len(start) :] for line in _header(content) if line.startswith(start)]
    return (group, names) if names and group.min() >= 0 and group.max() < len(names) else None
