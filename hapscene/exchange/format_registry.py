"""File formats for export and import of painted scenes."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SaveConflict, SceneError
from hapscene.exchange.cut_faces import cut_faces
from hapscene.exchange.gltf import write_gltf
from hapscene.exchange.gltf_read import read_gltf
from hapscene.exchange.html_page import write_html
from hapscene.exchange.swatch_payload import digest_of, known_swatch
from hapscene.io.files import check_file, naming, whole_file, write_whole
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import parts, swatches_of
from hapscene.scene.mesh import Mesh, unit_name
from hapscene.scene.ply import mesh_to_ply
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import is_own
from hapscene.surface.swatch import Swatch
from hapscene.view.feel_layer import Show

__all__ = ["EXPORTS", "export_scene", "format_of", "import_scene", "is_mesh_of", "losses", "painted_scene"]

# Export to formats without scenes: PLY and OBJ, which keep swatch names. World frame, metres.


def write_obj(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as OBJ with an object for each body and a material for each swatch, and its MTL file.

    Raises:
        SceneError: a file cannot be written.
    """
    library = path.with_suffix(".mtl")
    try:
        with whole_file(library) as colours, whole_file(path) as shapes:
            with colours.open("w", encoding="utf-8", newline="\n") as out:
                for swatch in scene.swatches:
                    out.write(f"newmtl {_line(swatch.name)}\nKd {' '.join(map(repr, swatch.albedo_rgb))}\n\n")
            with shapes.open("w", encoding="utf-8", newline="\n") as out:
                out.write(f"# unit m\n# z up\nmtllib {library.name}\n")
                out.writelines(_obj_lines(scene))
    except OSError as error:
        raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None
    return [path, library]


def _obj_lines(scene: Scene) -> Iterator[str]:
    start = 1
    for body in scene.bodies:
        vertices_m, faces, face_swatch, *_ = cut_faces(body)
        yield f"o {_line(body.name)}\n"
        for x, y, z in _world(body, vertices_m).tolist():
            yield f"v {x!r} {y!r} {z!r}\n"
        for index in np.unique(face_swatch):
            yield f"usemtl {_line(scene.swatches[index].name)}\n"
            for a, b, c in (faces[face_swatch == index] + start).tolist():
                yield f"f {a} {b} {c}\n"
        start += len(vertices_m)


def _line(name: str) -> str:
    """Return a name for an OBJ line, in which a backslash would continue the line."""
    return name.replace("\\", "_")


def write_ply(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as one binary PLY: faces with the number and the colour of their swatch, whose names are comments.

    Raises:
        SceneError: the file cannot be written.
    """
    cut = [cut_faces(body) for body in scene.bodies]
    start = np.cumsum([0, *(len(one.vertices_m) for one in cut)])
    swatch = np.concatenate([one.swatch for one in cut]).astype(np.int16)
    colours = np.rint(255 * np.array([swatch.albedo_rgb for swatch in scene.swatches])).astype(np.uint8)
    mesh = Mesh(
        np.concatenate([_world(body, one.vertices_m) for body, one in zip(scene.bodies, cut, strict=True)]),
        np.concatenate([one.faces + at for one, at in zip(cut, start[:-1], strict=True)]).astype(np.int32),
        swatch,
        tuple(swatch.name for swatch in scene.swatches),
        colours[swatch],
    )
    write_whole(path, mesh_to_ply(mesh), SceneError)
    return [path]


def _world(body: Body, vertices_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vertices (n, 3) of a body in the world frame [m]."""
    return np.asarray(vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3])


def read_named(path: Path, unit: str | None, up: str | None = None, scale: float = 1.0) -> Scene:
    """Read a scene from any mesh file; faces with a name of the library are painted. Errors as `import_scene`."""
    scene = Scene()
    body = scene.add(scene.mesh_of(path, unit, up=up, scale=scale))
    for index, full in enumerate(body.mesh.group_names):
        # The last part is the material name, which takes precedence over the object name.
        known = next((name for name in full.split("/")[::-1] if known_swatch(name) is not None), None)
        if known is not None:
            body.face_swatch[body.mesh.group == index] = scene.swatch_index(known)
    return scene


@dataclass(frozen=True)
class Export:
    """An export format.

    Attributes:
        summary: one-line description of its use.
        write: writes a scene to a file, completely or not at all; returns the files.
        loses: properties of a scene that the format does not preserve; see the table in docs/reference/file-formats.md.
        beside: suffixes of additional files.
    """

    summary: str
    write: Callable[[Scene, Path], list[Path]]
    loses: tuple[str, ...]
    beside: tuple[str, ...] = ()


_LOOK = "colours and textures of the mesh file"
_ALWAYS = ("group names of the mesh file", "swatches of bodies before painting")
_BLENDS = "blends of two swatches"
_ATTACHED = "attached bodies"
_OTHER = tuple(f"{what} a swatch not in the library" for what in ("paint with", "parameters of", "texture of"))
_GLTF_LOSES = ("exact positions", "order of vertices", "order of faces", *_ALWAYS)
_PLAIN_LOSES = (
    *("bodies and their names", "poses", "two-sided", "shared meshes", _LOOK, *_ALWAYS),
    *(*_OTHER, "unused swatches", _BLENDS, _ATTACHED),
)
_OBJ_LOSES = (*_PLAIN_LOSES, "order of faces")
_PAGE_LOSES = ("data to import the page again", "stiffness, damping and friction", _BLENDS)

EXPORTS: Final[Mapping[str, Export]] = MappingProxyType(
    {
        "glb": Export("glTF in one binary file: viewers, game engines, Blender", write_gltf, _GLTF_LOSES),
        "ply": Export("PLY with the swatch on each face: MeshLab, scripts", write_ply, _PLAIN_LOSES),
        "obj": Export("OBJ with a material for each swatch, by name", write_obj, _OBJ_LOSES, beside=(".mtl",)),
        "html": Export("page to touch in any browser, one file", write_html, _PAGE_LOSES),
    }
)
"""Export formats by suffix without the dot, in the order of presentation."""


def _used(scene: Scene) -> list[Swatch]:
    """Return the swatches other than plain that are painted somewhere."""
    used = {int(index) for body in scene.bodies for index in swatches_of(body)}
    return [scene.swatches[index] for index in sorted(used - {0})]


def _in_library(swatch: Swatch) -> bool:
    known = known_swatch(swatch.name)
    return known is not None and digest_of(known) == digest_of(swatch)


_HAS: Final[Mapping[str, Callable[[Scene], bool]]] = {
    "poses": lambda scene: any((np.eye(4) != body.X_WB).any() for body in scene.bodies),
    "two-sided": lambda scene: any(body.two_sided for body in scene.bodies),
    "shared meshes": lambda scene: len({id(body.mesh) for body in scene.bodies}) < len(scene.bodies),
    **dict.fromkeys(_OTHER, lambda scene: not all(map(_in_library, _used(scene)))),
    "unused swatches": lambda scene: len(_used(scene)) < len(scene.swatches) - 1,
    _ATTACHED: lambda scene: any(body.parent is not None for body in scene.bodies),
    _BLENDS: lambda scene: any(body.fine is not None and parts(body.fine.paint)[2].any() for body in scene.bodies),
    _LOOK: lambda scene: any(body.mesh.colour_rgb is not None for body in scene.bodies),
    _ALWAYS[0]: lambda scene: any(len(body.mesh.group_names) > 1 for body in scene.bodies),
    _ALWAYS[1]: lambda scene: any(body.made_of is not None for body in scene.bodies),
}
"""Tests for properties of a scene that a format may lose; properties without a test are present in every scene."""


def losses(scene: Scene, name: str) -> tuple[str, ...]:
    """Return the properties of a scene that the format `name`, a key of `EXPORTS`, does not preserve."""
    return tuple(aspect for aspect in EXPORTS[name].loses if aspect not in _HAS or _HAS[aspect](scene))


def is_mesh_of(scene: Scene, path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a mesh or sidecar file of a scene, which an export must not replace."""
    path = Path(path)
    meshes = {body.mesh.path for body in scene.bodies if body.mesh.path is not None and body.mesh.path.exists()}
    return is_own(path) or (path.exists() and any(path.samefile(mesh) for mesh in meshes))


def format_of(path: str | os.PathLike[str]) -> str:
    """Return the export format, a key of `EXPORTS`, for the suffix of a path.

    Raises:
        SceneError: no format has this suffix.
    """
    suffix = Path(path).suffix
    if (name := suffix[1:].lower()) in EXPORTS:
        return name
    raise SceneError(f"{path}: unsupported export format {suffix!r}; expected one of: .{', .'.join(EXPORTS)}")


def export_scene(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    replace: bool = False,
    show: Show = "both",
    cut: bool = False,
) -> list[Path]:
    """Export a painted scene. Each file is written completely or not at all.

    Args:
        scene: scene with at least one body.
        path: file to write; its suffix, a key of `EXPORTS`, is the format.
        replace: replace existing files, except meshes of the scene.
        show: layers that a GLB file shows: look, the materials of the mesh files; feel, the paint; or both, the paint
            over the materials. The paint is stored in any case.
        cut: cut faces at painted borders in a GLB file, so that each face has one swatch, and show no layer over the
            faces. Programs that paint faces, such as Blender, need this. The faces stay cut on import.

    Returns:
        The files that were written.

    Raises:
        SaveConflict: a file exists, and `replace` is False.
        SceneError: the scene has no body, the suffix is unknown, the format has no layers, or the file cannot
            be written.
    """
    path, name = Path(path), format_of(path)
    if not scene.bodies:
        raise SceneError(f"{path}: cannot export: the scene has no bodies")
    check_file(path, SceneError)
    for file in (path, *(path.with_suffix(suffix) for suffix in EXPORTS[name].beside)):
        if is_mesh_of(scene, file):
            raise SceneError(f"{file}: is a mesh of a scene and cannot be replaced; choose another name")
        if file.exists() and not replace:
            raise SaveConflict(f"{file}: exists already; choose another name, or replace it")
    if name == "glb":
        return write_gltf(scene, path, show, cut)
    if show != "both" or cut:
        option = "cut=True" if cut else f"show={show!r}"
        raise SceneError(f"{path}: format {name} has no layers to show: export to .glb, or omit {option}")
    return EXPORTS[name].write(scene, path)


def painted_scene(
    path: str | os.PathLike[str], unit: str | None = None, *, up: str | None = None, scale: float = 1.0
) -> Scene | None:
    """Read a painted scene from a file that `export_scene` wrote; return None for other mesh files.

    Args:
        path: the file.
        unit, up, scale: must be omitted (or metres), since the file defines them.

    Raises:
        SceneError, MeshError, SwatchError: as in `import_scene`; or `unit`, `up` or `scale` contradicts the file.
    """
    path = Path(path)
    with naming(path):
        scene = read_gltf(path) if path.suffix.lower() == ".glb" else None
    if scene is not None and (up is not None or scale != 1.0):
        raise SceneError(f"{path}: contains a painted scene with axis and size; omit --up and --scale")
    if scene is not None and unit is not None and unit_name(unit) != "m":
        raise SceneError(f"{path}: contains a painted scene in metres; omit --unit {unit}")
    return scene


def import_scene(
    path: str | os.PathLike[str], unit: str | None = None, *, up: str | None = None, scale: float = 1.0
) -> Scene:
    """Import a scene from a file that `export_scene` wrote, or from any mesh file.

    A mesh file becomes one body. Its faces are painted if their material, object or group has the name of a swatch in
    the library; the others are plain.

    Args:
        path: GLB, or any mesh file.
        unit, up, scale: unit of length, vertical axis and scale of a mesh file, see `hapscene.load_mesh`; exported
            scenes define them.

    Raises:
        SceneError: the file is missing, damaged or not a scene, or `unit`, `up` or `scale` contradicts it.
        MeshError: a mesh in the file is invalid.
        SwatchError: a swatch in the file is invalid.
    """
    path = Path(path)
    scene = painted_scene(path, unit, up=up, scale=scale)
    if scene is not None:
        return scene
    with naming(path):
        return read_named(path, unit, up, scale)
