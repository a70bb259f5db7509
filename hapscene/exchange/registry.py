"""The formats a painted scene can be written to, and read from again."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from hapscene.errors import SceneError, no_such
from hapscene.scene.scene import Scene


@dataclass(frozen=True)
class Export:
    """One format.

    Attributes:
        suffix: that its files end in, with the dot.
        summary: what it is good for, in a line.
        write: writes a scene to a file, whole or not at all; gives the files made.
        loses: what does not come back from it, in the words of the table of docs/exchange.md.
        draft: whether it follows a draft of a standard that may still change.
    """

    suffix: str
    summary: str
    write: Callable[[Scene, Path], list[Path]]
    loses: tuple[str, ...]
    draft: bool = False


def _gltf(scene: Scene, path: Path) -> list[Path]:
    from hapscene.exchange.gltf import write_gltf

    return write_gltf(scene, path)


def _gltf_draft(scene: Scene, path: Path) -> list[Path]:
    from hapscene.exchange.gltf import write_gltf

    return write_gltf(scene, path, draft=True)


def _ply(scene: Scene, path: Path) -> list[Path]:
    from hapscene.exchange.painted_ply import write_ply

    return write_ply(scene, path)


def _x3d(scene: Scene, path: Path) -> list[Path]:
    from hapscene.exchange.x3d import write_x3d

    return write_x3d(scene, path)


def _obj(scene: Scene, path: Path) -> list[Path]:
    from hapscene.exchange.plain import write_obj

    return write_obj(scene, path)


def _stl(scene: Scene, path: Path) -> list[Path]:
    from hapscene.exchange.plain import write_stl

    return write_stl(scene, path)


_OF_THE_FILE = "names and colours of the mesh's file"
_PLY_LOSES = ("shared meshes", "texture of a swatch not in the library", _OF_THE_FILE)
_GLTF_LOSES = ("exact positions", "order of vertices", "order of faces", _OF_THE_FILE)
_X3D_LOSES = ("order of faces", "texture of a swatch not in the library", _OF_THE_FILE)
_PLAIN_LOSES = (
    *("bodies and their names", "poses", "two-sided", "shared meshes", _OF_THE_FILE),
    *("painting with a swatch not in the library", "numbers of a swatch not in the library"),
    "texture of a swatch not in the library",
)
_OBJ_LOSES = (*_PLAIN_LOSES, "order of faces")
_STL_LOSES = (
    *(*_PLAIN_LOSES, "exact positions", "order of vertices", "painting with a swatch in the library"),
    *("numbers of a swatch in the library", "texture of a swatch in the library"),
)

EXPORTS: Final[Mapping[str, Export]] = MappingProxyType(
    {
        "glb": Export(".glb", "glTF in one binary file: viewers, game engines, Blender", _gltf, _GLTF_LOSES),
        "gltf": Export(".gltf", "glTF in one text file", _gltf, _GLTF_LOSES),
        "gltf-haptics": Export(
            ".gltf",
            "glTF with MPEG_material_haptic, a draft extension that may still change",
            _gltf_draft,
            _GLTF_LOSES,
            draft=True,
        ),
        "ply": Export(".ply", "PLY with the swatch on each face: MeshLab, scripts", _ply, _PLY_LOSES),
        "x3d": Export(".x3d", "X3D with the surface nodes of H3D, stiffness in N/m", _x3d, _X3D_LOSES),
        "obj": Export(".obj", "OBJ with a material for each swatch, by name", _obj, _OBJ_LOSES),
        "stl": Export(".stl", "STL: the shape alone", _stl, _STL_LOSES),
    }
)
"""The formats by name, in the order to offer them."""


def export_scene(scene: Scene, path: str | os.PathLike[str], name: str | None = None) -> list[Path]:
    """Write a painted scene for other programs; the files made, each whole or not at all.

    Args:
        scene: with a body at least.
        path: the file; its suffix says the format.
        name: of the format, a key of `EXPORTS`, where the suffix leaves a choice: "gltf-haptics".

    Raises:
        SceneError: no body, an unknown format or suffix, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if name is None:
        name = next((n for n, export in EXPORTS.items() if export.suffix == suffix), None)
        if name is None:
            known = ", ".join(dict.fromkeys(export.suffix for export in EXPORTS.values()))
            raise SceneError(f"{path}: no format {path.suffix!r} to write a scene in; there are: {known}")
    elif name not in EXPORTS:
        raise SceneError(no_such("format", name, EXPORTS))
    takes = (".gltf", ".glb") if EXPORTS[name].draft else (EXPORTS[name].suffix,)
    if suffix not in takes:
        raise SceneError(f"{path}: a file of the format {name} ends in {' or '.join(takes)}")
    if not scene.bodies:
        raise SceneError(f"{path}: the scene has no body, so there is nothing to write")
    if not path.parent.is_dir():
        raise SceneError(f"{path}: cannot be written: there is no folder {path.parent}")
    return EXPORTS[name].write(scene, path)


def import_scene(path: str | os.PathLike[str], unit: str | None = None) -> Scene:
    """Read a scene from a file that `export_scene` wrote, or from a mesh with swatches' names on its materials.

    Of a file of ours comes back what its format keeps. Any other mesh file becomes one body; faces whose material,
    object or group in the file is called as a swatch of the library are painted with it, the others stay plain.

    Args:
        path: GLB, glTF, PLY, X3D, or any mesh file.
        unit: of the file's numbers, where it carries none: see `hapscene.load_mesh`. Files of ours are in metres.

    Raises:
        SceneError: the file is missing or damaged, or no scene.
        MeshError: a mesh in it cannot be touched.
        SwatchError: a swatch in it is broken.
    """
    path = Path(path)
    scene = None
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        from hapscene.exchange.gltf_read import read_gltf

        scene = read_gltf(path)
    elif suffix == ".ply":
        from hapscene.exchange.painted_ply import read_ply

        scene = read_ply(path)
    elif suffix == ".x3d":
        from hapscene.exchange.x3d_read import read_x3d

        return read_x3d(path)
    if scene is None:
        from hapscene.exchange.plain import read_named

        return read_named(path, unit)
    return scene
