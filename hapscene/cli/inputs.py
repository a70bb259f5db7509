"""Inputs and outputs of the commands: checks of paths before slow imports, and loading of scenes and meshes."""

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from hapscene.cli.console import format_size, print_progress
from hapscene.constants import SCENE_SUFFIXES
from hapscene.errors import HapsceneError, MeshError, SceneError
from hapscene.io.files import is_unitless

if TYPE_CHECKING:
    from hapscene.cli.options import MeshOptions, ReadOptions
    from hapscene.scene.scene import Scene

__all__ = [
    "SCENES",
    "base_name",
    "check_out_folder",
    "check_scene",
    "check_swatch",
    "check_there",
    "find_asset",
    "load_input",
    "loading",
    "new_file",
    "print_size_advice",
]


SCENES: Final = SCENE_SUFFIXES
"""Suffixes of scene files."""


def check_there(path: str | Path, what: str = "file") -> None:
    """Check that a path exists and is of the kind `what`: "file", "folder", or "file or folder".

    Raises:
        HapsceneError: it does not exist, or is of another kind.
    """
    path = Path(path)
    if path.is_dir():
        if "folder" not in what:
            raise HapsceneError(f"{path}: is a folder; expected a {what}")
    elif not path.exists():
        raise HapsceneError(f"{path}: no such {what}")
    elif not path.is_file():
        raise HapsceneError(f"{path}: is a pipe or a device file; expected a regular {what}")
    elif what == "folder":
        raise HapsceneError(f"{path}: is a file; expected a folder")


def check_swatch(name: str | Path) -> None:
    """Check that a .swatch file exists. Names of library swatches are looked up later."""
    if str(name).endswith(".swatch") or "/" in str(name) or os.sep in str(name):
        check_there(name)


def check_out_folder(path: str | Path) -> None:
    """Check that an output folder is not an existing file."""
    if Path(path).is_file():
        raise HapsceneError(f"{path}: is a file; expected a folder or a new name")


def base_name(path: str | Path) -> str:
    """The file name without folder and suffix: "bunny" for meshes/bunny.ply and for bunny.scene.json."""
    name = Path(path).name
    end = next((end for end in SCENES if name.endswith(end)), None)
    return name.removesuffix(end) if end else Path(path).stem


def new_file(name: str) -> Path:
    """The default output file. A default never replaces an existing file. Raises HapsceneError: the file exists."""
    if Path(name).exists():
        raise HapsceneError(f"{name}: exists already; use -o {name} to replace it, or -o with another name")
    return Path(name)


_Options = TypeVar("_Options", bound="ReadOptions")

UNITS: Final = ("m", "cm", "mm", "um", "in", "ft")  # as in scene.mesh


def check_scene(path: str, options: "ReadOptions | None" = None) -> None:
    """Check that a scene or mesh exists and that its unit and swatch are known, before it is loaded.

    Raises:
        HapsceneError: the file is missing, has no unit, or an option names an unknown unit or swatch.
    """
    check_there(path)
    unit = None if options is None else options.unit
    if unit is not None:
        if unit not in UNITS:
            from hapscene.scene.mesh import unit_name

            unit_name(unit)
    elif is_unitless(path):
        raise MeshError(
            f"{path}: {Path(path).suffix[1:].upper()} files do not store a unit of length; add one, as in --unit mm "
            f"(one of {', '.join(UNITS)})"
        )
    swatch = getattr(options, "swatch", None)
    if swatch is not None:
        from hapscene.swatches.library import load_swatch

        load_swatch(swatch)


def find_asset(scene: str, options: _Options) -> tuple[str, _Options]:
    """Return the path of a scene or mesh, and the options to read it with.

    Args:
        scene: a path, or the name of a bundled asset such as demo or toad.
        options: as given on the command line; an asset sets the unit.

    Raises:
        SceneError: `scene` is a bare name, and neither a file nor an asset has that name.
    """
    if Path(scene).suffix or Path(scene).name != scene or Path(scene).is_file():
        return scene, options
    from hapscene import assets

    try:
        return str(assets.path(scene)), replace(options, unit=options.unit or assets.unit(scene))
    except SceneError as unknown:
        raise SceneError(f"{scene}: no such file; {unknown}") from None


def load_input(path: str, options: "MeshOptions", device: str = "omni") -> "Scene":
    """Load a scene, or a mesh as a scene; print progress and advice about an unsuitable size.

    Raises:
        HapsceneError: the file is missing or cannot be loaded.
    """
    check_scene(path, options)
    from hapscene.touch import open_scene, step

    with step(print_progress, loading(path)):
        scene = open_scene(path, options.unit, options.swatch, options.two_sided, **options.reading())
    print_size_advice(scene, path, device)
    return scene


def print_size_advice(scene: "Scene", path: str, device: str = "omni") -> None:
    """Print advice if the size of a scene does not suit a hand or a device."""
    from hapscene.scene.size_advice import size_advice

    files = {body.mesh.path for body in scene.bodies}
    of_meshes = len(files) == len(scene.bodies) and not path.endswith(SCENES)
    for what in [body.mesh for body in scene.bodies] if of_meshes else [scene]:
        if words := size_advice(what, device).words:
            print_progress(f"{words}\n")


def loading(path: str | Path) -> str:
    """The progress text while a file is loaded: "loading bunny.stl (65.5 MB)"."""
    return f"loading {path} ({format_size(Path(path).stat().st_size)})"
