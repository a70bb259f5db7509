"""PLY, the one format that hapscene writes: exact positions, groups and colours."""

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import MeshError
from hapscene.io.files import write_whole
from hapscene.scene.mesh import Mesh

__all__ = ["HEADER_MAX_B", "declared", "mesh_to_ply", "ply_groups", "save_mesh"]

_COMMENT: Final = "hapscene group"

HEADER_MAX_B: Final = 16_000_000
"""Longest header that is read [bytes]: room for 10,000 bodies, 32,767 groups or swatches with long names."""


def save_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh as binary PLY in metres: float64, so that it loads back to the bit with unit="m".

    Groups are written as a face property `group` with their names in comments, colours as on the faces.

    Raises:
        MeshError: the suffix is not .ply, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".ply":
        raise MeshError(f"{path}: meshes are written as .ply, the one format that keeps their exact positions")
    write_whole(path, mesh_to_ply(mesh), MeshError)


def mesh_to_ply(mesh: Mesh) -> bytes:
    """The content of a mesh's file."""
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
    """A name that ends neither its line nor the header."""
    return " ".join(name.split()).replace("end_header", "end-header")


def _header(content: bytes) -> list[str]:
    end = content.find(b"end_header", 0, HEADER_MAX_B)
    return content[: max(end, 0)].decode("utf-8", errors="replace").splitlines()


def declared(content: bytes, where: str) -> dict[str, int]:
    """How many of each element the header of a PLY file promises.

    Raises:
        MeshError: there is no header, or it counts more elements than the file has bytes: refused before anything
            of that size is made.
    """
    header = _header(content)
    if not content.startswith(b"ply") or not header:
        raise MeshError(f"{where}: not a readable PLY file: no header from 'ply' to 'end_header'")
    elements = [re.fullmatch(r"\s*element\s+(\S+)\s+(\d{1,18})\s*", line) for line in header]
    counts = {element[1]: int(element[2]) for element in elements if element}
    for element, count in counts.items():
        if count > len(content):
            raise MeshError(
                f"{where}: not a readable PLY file, or truncated: its header says {count:,} of element "
                f"{element!r}, its size is {len(content):,} bytes"
            )
    return counts


def ply_groups(content: bytes, loaded: Any) -> tuple[NDArray[Any], list[str]] | None:
    """Groups (m,) and their names as `save_mesh` wrote them, or None."""
    try:
        (mesh,) = loaded.geometry.values()
        group = np.asarray(mesh.metadata["_ply_raw"]["face"]["data"]["group"]).ravel().astype(np.int64)
    except (KeyError, ValueError, TypeError, IndexError):
        return None
    return _groups(content, group) if len(group) == len(mesh.faces) else None


def _groups(content: bytes, group: NDArray[np.int64]) -> tuple[NDArray[Any], list[str]] | None:
    """Groups (m,) and their names, where the header names them all."""
    start = f"comment {_COMMENT} "
    names = [line[len(start) :] for line in _header(content) if line.startswith(start)]
    return (group, names) if names and group.min() >= 0 and group.max() < len(names) else None
