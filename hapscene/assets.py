"""Scenes and meshes that are installed with hapscene, by name: `hapscene.assets.path("toad")`."""

import json
from functools import cache
from importlib.resources import files
from pathlib import Path

from hapscene.constants import SCENE_SUFFIX
from hapscene.errors import SceneError, no_such

__all__ = ["names", "path", "unit"]


def path(name: str) -> Path:
    """File of an asset: a scene file, or a mesh with the unit `unit(name)`.

    Raises:
        SceneError: there is no asset of this name.
    """
    return _asset(name)[0]


def unit(name: str) -> str | None:
    """Unit of a mesh, for `Scene.add`; None for a scene file, which contains its units.

    Raises:
        SceneError: there is no asset of this name.
    """
    return _asset(name)[1]


def names() -> list[str]:
    """Names of all assets."""
    return sorted(_assets())


def _asset(name: str) -> tuple[Path, str | None]:
    if name not in _assets():
        raise SceneError(no_such("asset", name, names()))
    return _assets()[name]


@cache
def _assets() -> dict[str, tuple[Path, str | None]]:
    """File and unit of each asset. A JSON file next to each mesh contains its unit."""
    folder = Path(str(files("hapscene_assets")))
    found: dict[str, tuple[Path, str | None]] = {
        file.name.removesuffix(SCENE_SUFFIX): (file, None) for file in folder.glob(f"*{SCENE_SUFFIX}")
    }
    for file in folder.glob("meshes/*.json"):
        about = json.loads(file.read_text(encoding="utf-8"))
        found[file.stem] = file.with_name(about["file"]), about["unit"]
    return found
