"""Loading of scenes and meshes for the commands, with checks before slow imports."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from hapscene.cli.console import format_size, print_progress
from hapscene.cli.options import MeshOptions, ReadOptions
from hapscene.cli.paths import SCENES, check_there, missing
from hapscene.constants import is_unitless
from hapscene.errors import MeshError, SceneError

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["check_scene", "find_asset", "load_input", "loading", "print_size_advice"]

_Options = TypeVar("_Options", bound=ReadOptions)

UNITS: Final = ("m", "cm", "mm", "um", "in", "ft")  # as in scene.mesh


def check_scene(path: str, options: ReadOptions | None = None) -> None:
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
        raise SceneError(f"{missing(Path(scene))}; {unknown}") from None


def load_input(path: str, options: MeshOptions, device: str = "omni") -> "Scene":
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
