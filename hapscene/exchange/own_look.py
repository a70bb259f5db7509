"""The look that a mesh has in its own file, for faces that no swatch is painted on: its pictures, else its colours."""

import io
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import HapsceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import Y_UP, load_trimesh


@dataclass(frozen=True, eq=False)
class OwnLook:
    """Of a run of faces.

    Attributes:
        faces: (m,) which of the mesh, in their order.
        uv: (n, 2) where each vertex of the mesh is in the picture, from its upper left; None where there is none.
        picture: a PNG file's content; empty where there is none.
    """

    faces: NDArray[np.int64]
    uv: NDArray[np.float64] | None = None
    picture: bytes = b""


def looks_of(mesh: Mesh, faces: NDArray[np.int64]) -> list[OwnLook]:
    """Faces (m,), ascending, in runs that have a picture each, or none; pictures are those of glTF, read again."""
    looks = []
    done = 0
    for end, look in _pictures(mesh):
        run = faces[(faces >= done) & (faces < end)]
        done = end
        if len(run):
            looks.append(OwnLook(run, look[0], look[1]) if look else OwnLook(run))
    rest = faces[faces >= done]
    return [*looks, OwnLook(rest)] if len(rest) else looks


def _pictures(mesh: Mesh) -> list[tuple[int, Any]]:
    """Where each part of the mesh's file ends among its faces, and its uv and picture, if it has any."""
    path = mesh.path
    if path is None or path.suffix.lower().lstrip(".") not in Y_UP or not path.is_file():
        return []
    found: list[tuple[int, Any]] = []
    with suppress(HapsceneError, MemoryError):  # it was read before; if it has changed, its colours stay
        loaded = load_trimesh(path)
        face = vertex = 0
        for node in loaded.graph.nodes_geometry:
            part = loaded.geometry[loaded.graph[node][1]]
            count = len(getattr(part, "faces", ()))
            if not count:
                continue
            own = np.sort(mesh.faces[face : face + count] - vertex, axis=1)  # a mirrored one is wound the other way
            if not np.array_equal(own, np.sort(part.faces, axis=1)):
                return []
            face, vertex = face + count, vertex + len(part.vertices)
            found.append((face, _picture(part, vertex, len(mesh.vertices_m))))
    return found


def _picture(part: Any, end: int, vertex_count: int) -> tuple[NDArray[np.float64], bytes] | None:
    material, uv = getattr(part.visual, "material", None), getattr(part.visual, "uv", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None or uv is None or not np.isfinite(uv).all():
        return None
    placed = np.zeros((vertex_count, 2))
    placed[end - len(uv) : end] = np.asarray(uv) * (1.0, -1.0) + (0.0, 1.0)
    content = io.BytesIO()
    with suppress(Exception):  # a broken picture spoils the look, which is for the eye alone
        image.save(content, "PNG")
        return placed, content.getvalue()
    return None
