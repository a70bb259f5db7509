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

__all__ = ["add_look", "declared_counts", "mesh_to_ply", "ply_groups", "save_mesh", "strips_to_faces"]

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
    fields = [("count", "u1", ()), ("corners", "<i4", (3,)), ("group", "<i2", ())]
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
        MeshError: there is no header, or a number exceeds the size of the file, so that it must not be allocated.
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
    return counts


# Triangle strips. Each triangle shares its first two corners with the one before it; a negative index ends a strip.
#
# trimesh does not read them, so they are replaced by faces in the content of the file.

_STRIPS: Final = "tristrips"

_ORDER: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

_TYPES: Final = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
"""NumPy types of the types in a header."""


def strips_to_faces(content: bytes, where: str) -> bytes:
    """Return the content of a PLY file with its triangle strips replaced by faces; unchanged if it has none.

    Raises:
        MeshError: the strips are damaged, or an unsupported variant.
    """
    if not declared_counts(content, where).get(_STRIPS):
        return content
    try:
        return _replace_strips(content)
    except (ValueError, LookupError, OverflowError, StopIteration) as error:
        reason = str(error) if type(error) is ValueError else "damaged"
        raise MeshError(f"{where}: invalid triangle strips, or truncated: {reason}") from None


def _replace_strips(content: bytes) -> bytes:
    lines = _header(content)
    body = content[content.index(b"\n", content.index(b"end_header")) + 1 :]
    fields = [line.split() for line in lines]
    at = next(i for i, words in enumerate(fields) if words[:2] == ["element", _STRIPS])
    types: dict[str, list[list[str]]] = {}  # the types of the properties of each element
    for words in fields:
        if words[:1] == ["element"]:
            types[words[1]] = []
        elif words[:1] == ["property"]:
            types[list(types)[-1]].append(words[1:-1])
    before = list(types)[: list(types).index(_STRIPS)]
    rows = {words[1]: int(words[2]) for words in fields if words[:1] == ["element"]}
    if "face" in types or any(len(kind) != 1 for name in before for kind in types[name]):
        raise ValueError("expected strips without faces, after the vertices")
    ((_, count_type, index_type),) = types[_STRIPS]
    order = _ORDER[next(words[1] for words in fields if words[:1] == ["format"])]
    count_dtype, index_dtype = (np.dtype(order + _TYPES[kind]) for kind in (count_type, index_type))
    if "f" in (count_dtype.kind, index_dtype.kind):
        raise ValueError("expected lists of integers")
    if order:
        start = sum(rows[name] * np.dtype(_TYPES[kind]).itemsize for name in before for (kind,) in types[name])
        strips, end = _binary_strips(body, start, rows[_STRIPS], count_dtype, index_dtype)
        triangles = _triangles(strips)
        faces = np.zeros(len(triangles), [("count", "u1"), ("corners", f"{order}i4", 3)])
        faces["count"], faces["corners"] = 3, triangles
        body = body[:start] + faces.tobytes() + body[end:]
    else:
        texts = [line for line in body.splitlines() if line.strip()]
        first = sum(rows[name] for name in before)
        last = first + rows[_STRIPS]
        if len(texts) < last:
            raise ValueError(f"expected {last:,} lines after the header, found {len(texts):,}")
        triangles = _triangles([_text_strip(line.split()) for line in texts[first:last]])
        body = b"\n".join(
            [*texts[:first], *(b"3 %d %d %d" % tuple(row) for row in triangles.tolist()), *texts[last:], b""]
        )
    lines[at : at + 2] = [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    return "\n".join([*lines, "end_header", ""]).encode() + body


def _binary_strips(
    body: bytes, at: int, count: int, count_type: np.dtype[np.generic], index_type: np.dtype[np.generic]
) -> tuple[list[NDArray[np.integer]], int]:
    """Return the strips from an offset, and the offset of their end."""
    strips = []
    for _ in range(count):
        length = int(np.frombuffer(body, count_type, 1, at)[0])
        if length < 0:  # NumPy would read to the end
            raise ValueError("negative length")
        at += count_type.itemsize
        strips.append(np.frombuffer(body, index_type, length, at) if length else np.zeros(0, index_type))
        at += length * index_type.itemsize
    return strips, at


def _text_strip(tokens: list[bytes]) -> NDArray[np.int64]:
    if len(tokens) != int(tokens[0]) + 1:
        raise ValueError(f"expected {int(tokens[0]):,} indices, found {len(tokens) - 1:,}")
    return np.array(tokens[1:], np.int64)


def _triangles(strips: list[NDArray[np.integer]]) -> NDArray[np.int64]:
    """Return the triangles of strips (m, 3), without the degenerate ones that join strips.

    Every second triangle of a strip has the opposite order, so two of its corners are exchanged.
    """
    found = [np.zeros((0, 3), np.int64)]
    for strip in strips:
        for part in np.split(strip, np.flatnonzero(strip < 0)):
            corners = part[part >= 0].astype(np.int64)
            if len(corners) >= 3:
                triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
                triangles[1::2, :2] = triangles[1::2, 1::-1]
                a, b, c = triangles.T
                found.append(triangles[(a != b) & (b != c) & (c != a)])
    return np.concatenate(found)


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
