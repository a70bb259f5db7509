"""The formats a painted scene can be written to, and read from again."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from hapscene.errors import SaveConflict, SceneError, no_such
from hapscene.exchange.gltf import write_gltf
from hapscene.exchange.gltf_read import read_gltf
from hapscene.exchange.painted_ply import read_ply, write_ply
from hapscene.exchange.swatch_payload import digest_of, known_swatch, lose
from hapscene.exchange.unpainted import read_named, write_obj, write_stl
from hapscene.io.files import check_file, naming
from hapscene.scene.fine_paint import parts, swatches_of
from hapscene.scene.mesh import unit_name
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import is_own
from hapscene.surface.swatch import Swatch

__all__ = ["EXPORTS", "export_scene", "format_of", "import_scene", "is_mesh_of", "losses", "painted_scene"]


@dataclass(frozen=True)
class Export:
    """One format.

    Attributes:
        suffix: that its files end in, with the dot.
        summary: what it is good for, in a line.
        write: writes a scene to a file, whole or not at all; gives the files made.
        loses: what does not come back from it, in the words of the table of docs/exchange.md.
        beside: suffixes of the files that are written beside.
    """

    suffix: str
    summary: str
    write: Callable[[Scene, Path], list[Path]]
    loses: tuple[str, ...]
    beside: tuple[str, ...] = ()


_ALWAYS = ("names, colours and pictures of the mesh's file", "what bodies were made of before they were painted")
_SOFT = "soft borders, where two swatches blend"
_FINE = "painting finer than faces"
_HUNG = "what bodies hang on"
_PLY_LOSES = ("shared meshes", _HUNG, "texture of a swatch not in the library", _SOFT, *_ALWAYS)
_GLTF_LOSES = ("exact positions", "order of vertices", "order of faces", *_ALWAYS)
_PLAIN_LOSES = (
    *("bodies and their names", "poses", "two-sided", "shared meshes", *_ALWAYS),
    *("painting with a swatch not in the library", "numbers of a swatch not in the library"),
    *("texture of a swatch not in the library", "swatches that no face wears", _SOFT, _HUNG),
)
_OBJ_LOSES = (*_PLAIN_LOSES, "order of faces")
_STL_LOSES = (
    *(*_PLAIN_LOSES, "exact positions", "order of vertices", "painting with a swatch in the library"),
    *("numbers of a swatch in the library", "texture of a swatch in the library", _FINE),
)

EXPORTS: Final[Mapping[str, Export]] = MappingProxyType(
    {
        "glb": Export(".glb", "glTF in one binary file: viewers, game engines, Blender", write_gltf, _GLTF_LOSES),
        "gltf": Export(".gltf", "glTF in one text file", write_gltf, _GLTF_LOSES),
        "ply": Export(".ply", "PLY with the swatch on each face: MeshLab, scripts", write_ply, _PLY_LOSES),
        "obj": Export(".obj", "OBJ with a material for each swatch, by name", write_obj, _OBJ_LOSES, beside=(".mtl",)),
        "stl": Export(".stl", "STL: the shape alone", write_stl, _STL_LOSES),
    }
)
"""The formats by name, in the order to offer them."""


def _used(scene: Scene) -> list[Swatch]:
    """Swatches other than plain that faces wear, or pieces of them."""
    worn = {int(index) for body in scene.bodies for index in swatches_of(body)}
    return [scene.swatches[index] for index in sorted(worn - {0})]


def _in_library(swatch: Swatch) -> bool:
    known = known_swatch(swatch.name)
    return known is not None and digest_of(known) == digest_of(swatch)


_KNOWN = ("painting with a", "numbers of a", "texture of a")
_HAS: Final[Mapping[str, Callable[[Scene], bool]]] = {
    "poses": lambda scene: any((np.eye(4) != body.X_WB).any() for body in scene.bodies),
    "two-sided": lambda scene: any(body.two_sided for body in scene.bodies),
    "shared meshes": lambda scene: len({id(body.mesh) for body in scene.bodies}) < len(scene.bodies),
    **{f"{what} swatch in the library": lambda scene: any(map(_in_library, _used(scene))) for what in _KNOWN},
    **{f"{what} swatch not in the library": lambda scene: not all(map(_in_library, _used(scene))) for what in _KNOWN},
    "swatches that no face wears": lambda scene: len(_used(scene)) < len(scene.swatches) - 1,
    _HUNG: lambda scene: any(body.parent is not None for body in scene.bodies),
    _SOFT: lambda scene: any(body.fine is not None and parts(body.fine.paint)[2].any() for body in scene.bodies),
    _FINE: lambda scene: any(body.fine is not None for body in scene.bodies),
    _ALWAYS[0]: lambda scene: any(
        body.mesh.colour_rgb is not None or len(body.mesh.group_names) > 1 for body in scene.bodies
    ),
    _ALWAYS[1]: lambda scene: any(body.made_of is not None for body in scene.bodies),
}
"""Whether a scene has what a format may lose; what is not here every scene has."""


def losses(scene: Scene, name: str) -> tuple[str, ...]:
    """What of a scene does not come back from a format, in words: to be told before it is written.

    Args:
        scene: to be written.
        name: of the format, a key of `EXPORTS`.
    """
    return tuple(aspect for aspect in EXPORTS[name].loses if aspect not in _HAS or _HAS[aspect](scene))


_READERS: Final[Mapping[str, Callable[[Path], Scene | None]]] = MappingProxyType(
    {".glb": read_gltf, ".gltf": read_gltf, ".ply": read_ply}
)
"""What reads a painted scene, by suffix; None of a file of no such scene."""


def is_mesh_of(scene: Scene, path: str | os.PathLike[str]) -> bool:
    """Whether a file is one that a scene is made of, which no export may take the place of."""
    path = Path(path)
    meshes = {body.mesh.path for body in scene.bodies if body.mesh.path is not None and body.mesh.path.exists()}
    return is_own(path) or (path.exists() and any(path.samefile(mesh) for mesh in meshes))


def format_of(path: str | os.PathLike[str]) -> str:
    """The format, a key of `EXPORTS`, that a file's suffix says.

    Raises:
        SceneError: none has it.
    """
    suffix = Path(path).suffix
    for name, export in EXPORTS.items():
        if export.suffix == suffix.lower():
            return name
    known = ", ".join(export.suffix for export in EXPORTS.values())
    raise SceneError(f"{path}: no format {suffix!r} to write a scene in; there are: {known}")


def export_scene(
    scene: Scene, path: str | os.PathLike[str], name: str | None = None, *, replace: bool = False
) -> list[Path]:
    """Write a painted scene for other programs; the files made, each whole or not at all.

    Args:
        scene: with a body at least.
        path: the file; its suffix says the format.
        name: of the format, a key of `EXPORTS`; without it, the one of the suffix.
        replace: take the place of files that are there; never of a mesh of the scene.

    Raises:
        SaveConflict: a file is there already, and not to be replaced.
        SceneError: no body, an unknown format or suffix, or the file cannot be written.
    """
    path = Path(path)
    if name is None:
        name = format_of(path)
    elif name not in EXPORTS:
        raise SceneError(no_such("format", name, EXPORTS))
    if path.suffix.lower() != EXPORTS[name].suffix:
        raise SceneError(f"{path}: a file of the format {name} ends in {EXPORTS[name].suffix}")
    if not scene.bodies:
        raise SceneError(f"{path}: the scene has no body, so there is nothing to write")
    check_file(path, SceneError)
    for file in (path, *(path.with_suffix(suffix) for suffix in EXPORTS[name].beside)):
        if is_mesh_of(scene, file):
            raise SceneError(f"{file}: is a mesh that a scene is made of, so it stays; take another name")
        if file.exists() and not replace:
            raise SaveConflict(f"{file}: is there already; take another name, or replace it")
    return EXPORTS[name].write(scene, path)


def painted_scene(
    path: str | os.PathLike[str], unit: str | None = None, *, up: str | None = None, scale: float = 1.0
) -> Scene | None:
    """The scene of a file that says how its surfaces feel; None of any other mesh file.

    Args:
        path: of a scene as `export_scene` writes it.
        unit, up, scale: must be left out, or say what such a file says: metres, its own axis and size.

    Raises:
        SceneError, MeshError, SwatchError: as `import_scene`; or another unit than that of a file of ours.

    Warns:
        ExchangeWarning: what the file does not keep of a scene.
    """
    path = Path(path)
    scene = _own_scene(path, up, scale)
    if scene is None:
        return None
    if unit is not None and unit_name(unit) != "m":
        raise SceneError(f"{path}: holds a painted scene, in metres; leave the unit {unit} out")
    loses = EXPORTS[format_of(path)].loses
    lose(f"{path}: holds a painted scene, without what its format does not keep: {', '.join(loses)}")
    return scene


def _own_scene(path: Path, up: str | None, scale: float) -> Scene | None:
    """The scene of a file that `export_scene` wrote; None of any other file."""
    reader = _READERS.get(path.suffix.lower())
    with naming(path):
        scene = None if reader is None else reader(path)
    if scene is not None and (up is not None or scale != 1.0):
        raise SceneError(f"{path}: holds a painted scene, which says this itself; leave --up and --scale out")
    return scene


def import_scene(
    path: str | os.PathLike[str],
    unit: str | None = None,
    *,
    accept_damaged: bool = False,
    up: str | None = None,
    scale: float = 1.0,
) -> Scene:
    """Read a scene from a file that `export_scene` wrote, or from a mesh with swatches' names on its materials.

    Of a file of ours comes back what its format keeps. Any other mesh file becomes one body; faces whose material,
    object or group in the file is called as a swatch of the library are painted with it, the others stay plain.

    Args:
        path: GLB, glTF, PLY, or any mesh file.
        unit: of the file's numbers, where it carries none: see `hapscene.load_mesh`. Files of ours are in metres.
        accept_damaged: take what can be read of a damaged mesh: see `hapscene.load_mesh`.
        up, scale: of a mesh file: see `hapscene.load_mesh`. Files of ours say which axis is up, and are of their size.

    Raises:
        SceneError: the file is missing or damaged, or no scene.
        MeshError: a mesh in it cannot be touched.
        SwatchError: a swatch in it is broken.
    """
    path = Path(path)
    scene = _own_scene(path, up, scale)
    if scene is not None:
        return scene
    with naming(path):
        return read_named(path, unit, accept_damaged, up, scale)
