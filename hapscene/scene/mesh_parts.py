"""Parts of a file, each with its own names and colours, from trimesh, and joined into one `Mesh`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import MeshError
from hapscene.scene.mesh import FACE_MAX, UNIT_M, UNNAMED, Mesh

if TYPE_CHECKING:
    import trimesh


@dataclass
class Part:
    """Triangles in the file's own unit."""

    vertices: NDArray[Any]  # (n, 3)
    faces: NDArray[Any]  # (m, 3)
    group: NDArray[Any]  # (m,) index into names
    names: list[str]
    colour_rgb: NDArray[np.uint8] | None = None  # (m, 3)


def join(parts: list[Part], unit: str, path: Path | None) -> Mesh:
    """One mesh of all parts, in their order, in metres; parts of the same name share a group.

    Raises:
        MeshError: what `Mesh` refuses.
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
        if len(part.faces) and (part.faces.min() < 0 or part.faces.max() >= len(part.vertices)):
            bad = int(np.argmax(((part.faces < 0) | (part.faces >= len(part.vertices))).any(axis=1)))
            of = f" of {part.names[0]!r}" if len(parts) > 1 else ""
            raise MeshError(
                f"{where}face {bad}{of} names vertices {part.faces[bad].tolist()}, "
                f"but there are only vertices 0 to {len(part.vertices) - 1}"
            )
    return Mesh(
        vertices_m=np.concatenate([np.asarray(part.vertices, np.float64) for part in parts]) * UNIT_M[unit],
        faces=np.concatenate([part.faces.astype(np.int64) + at for part, at in zip(parts, start, strict=False)]),
        group=np.concatenate([np.array([place[n] for n in part.names])[part.group] for part in parts]),
        group_names=tuple(names),
        colour_rgb=_colours(parts),
        path=path,
        unit=unit,
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
        raise MeshError(f"{where}: a {type(loaded).__name__} cannot be touched; a mesh of triangles was expected")
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
    return Part(vertices, faces, np.zeros(len(faces), np.int16), ["/".join(names)], face_colours(mesh))


def face_colours(mesh: "trimesh.Trimesh") -> NDArray[np.uint8] | None:
    """Colour of every face of a trimesh (M, 3), from texture, material, face or vertex colours; else None."""
    visual: Any = mesh.visual  # one of two classes, by what `kind` says
    try:
        if visual.kind == "texture":
            uv = None if visual.uv is None else np.asarray(visual.uv)[mesh.faces].mean(axis=1)
            return sample(visual.material, uv, len(mesh.faces))
        if visual.kind == "face":
            return np.asarray(visual.face_colors)[:, :3].astype(np.uint8)
        if visual.kind == "vertex":
            corners = np.asarray(visual.vertex_colors)[mesh.faces][:, :, :3]
            return np.asarray(corners.mean(axis=1).round().astype(np.uint8))
    except Exception:  # a broken picture spoils the colours, which are for the eye alone, not the mesh
        return None
    return None


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
