"""Scenes that a command opens: checked before anything heavy is imported, and loaded."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from hapscene.cli.console import say, size_words
from hapscene.cli.options import MeshOptions, ReadOptions
from hapscene.cli.paths import SCENES, check_there, missing
from hapscene.errors import MeshError, SceneError

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["check_scene", "find_asset", "load_input", "loading", "tell_size"]

_Options = TypeVar("_Options", bound=ReadOptions)

UNITLESS: Final = ("stl", "obj", "ply", "off")  # as in scene.mesh_file, which is slow to import
UNITS: Final = ("m", "cm", "mm", "um", "in", "ft")  # as in scene.mesh


def check_scene(path: str, options: ReadOptions | None = None) -> None:
    """Raise where a scene or mesh is missing, or its unit or swatch is unknown, before it is loaded."""
    check_there(path)
    suffix = Path(path).suffix.lower().lstrip(".")
    unit = None if options is None else options.unit
    if unit is not None:
        if unit not in UNITS:
            from hapscene.scene.mesh import unit_name

            unit_name(unit)
    elif suffix in UNITLESS and not (suffix == "ply" and _is_painted(path)):
        raise MeshError(
            f"{path}: {suffix.upper()} files carry no unit of length: say which one its numbers are in, as --unit mm; "
            f"known are {', '.join(UNITS)}"
        )
    swatch = getattr(options, "swatch", None)
    if swatch is not None:
        from hapscene.swatches.library import load_swatch

        load_swatch(swatch)


def _is_painted(path: str) -> bool:
    """Whether a PLY file is a painted scene of hapscene, which says its unit."""
    with Path(path).open("rb") as file:
        return b"comment hapscene" in file.read(4096)


def find_asset(scene: str, options: _Options) -> tuple[str, _Options]:
    """The file of a scene or mesh, and how it is read; `scene` is a file, or the name of an asset as demo or toad.

    Raises:
        SceneError: it is a bare name, and there is neither a file nor an asset of this name.
    """
    if Path(scene).suffix or Path(scene).name != scene or Path(scene).is_file():
        return scene, options
    from hapscene import assets

    try:
        return str(assets.path(scene)), replace(options, unit=options.unit or assets.unit(scene))
    except SceneError as unknown:
        raise SceneError(f"{missing(Path(scene))}; {unknown}") from None


def load_input(path: str, options: MeshOptions, device: str = "omni") -> "Scene":
    """A scene from its file, or around a mesh. Its loading is printed, and a size that does not suit a hand.

    Raises:
        HapsceneError: it is missing, or cannot be loaded.
    """
    check_scene(path, options)
    from hapscene.touch import open_scene, step

    with step(say, loading(path)):
        scene = open_scene(path, options.unit, options.swatch, options.two_sided, say, **options.reading())
    tell_size(scene, path, device)
    return scene


def tell_size(scene: "Scene", path: str, device: str = "omni") -> None:
    """Print what to change where a scene's size does not suit a hand and a device."""
    from hapscene.scene.size_advice import size_advice

    files = {body.mesh.path for body in scene.bodies}
    of_meshes = len(files) == len(scene.bodies) and not path.endswith(SCENES)
    for what in [body.mesh for body in scene.bodies] if of_meshes else [scene]:
        if words := size_advice(what, device).words:
            say(f"{words}\n")


def loading(path: str | Path) -> str:
    """The progress text of a file that is loaded: "loading bunny.stl (65.5 MB)"."""
    return f"loading {path} ({size_words(Path(path).stat().st_size)})"
