"""PLY files: export of meshes with exact positions, groups and colours; check of headers."""

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import MeshError
from hapscene.io.files import write_whole
from hapscene.scene.mesh import Mesh

__all__ = ["HEADER_MAX_B", "declared_counts", "mesh_to_ply", "ply_groups", "save_mesh"]

_COMMENT: Final = "hapscene group"

HEADER_MAX_B: Final = 16_000_000
"""Maximum size of a header [bytes]: enough for 10,000 bodies, or 32,767 groups or swatches with long names."""


def save_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh as binary PLY in metres. Positions are float64: the mesh loads without loss with unit="m".

    Groups are written as a face property `group` with their names in comments, colours as face properties.

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
    if mesh.colour_rgb is not None:
        fields += [("rgb", "u1", 3)]
        lines += [f"property uchar {colour}" for colour in ("red", "green", "blue")]
    faces = np.zeros(len(mesh.faces), fields)
    faces["count"], faces["corners"], faces["group"] = 3, mesh.faces, mesh.group
    if mesh.colour_rgb is not None:
        faces["rgb"] = mesh.colour_rgb
    header = "\n".join([*lines, "end_header", ""]).encode(errors="replace")
    return header + np.ascontiguousarray(mesh.vertices_m, "<f8").tobytes() + faces.tobytes()


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


def ply_groups(content: bytes, loaded: Any) -> tuple[NDArray[Any], list[str]] | None:
    """Return groups (m,) and group names of a file from `save_mesh`; None for other files."""
    try:
        (mesh,) = loaded.geometry.values()
        group = np.asarray(mesh.metadata["_ply_raw"]["face"]["data"]["group"]).ravel().astype(np.int64)
    except (KeyError, ValueError, TypeError, IndexError):
        return None
    return _groups(content, group) if len(group) == len(mesh.faces) else None


def _groups(content: bytes, group: NDArray[np.int64]) -> tuple[NDArray[Any], list[str]] | None:
    """Return groups (m,) and their names; None if the header does not name all groups."""
    start = f"comment {_COMMENT} "
    names = [line[len(start) :] for line in _header(content) if line.startswith(start)]
    return (group, names) if names and group.min() >= 0 and group.max() < len(names) else None
