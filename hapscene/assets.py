"""Scenes and meshes that come with hapscene, by name, wherever it is installed: `hapscene.assets.path("toad")`."""

import json
from functools import cache
from importlib.resources import files
from pathlib import Path

from hapscene.errors import SceneError, no_such

__all__ = ["names", "path", "unit"]


def path(name: str) -> Path:
    """The file of an asset: a scene file, or a mesh, whose unit is `unit(name)`.

    Raises:
        SceneError: there is no asset of this name.
    """
    return _asset(name)[0]


def unit(name: str) -> str | None:
    """The unit of a mesh among the assets, as `Scene.add` takes it; None of a scene file, which has its own.

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
    """File and unit of each asset. Beside each mesh lies a JSON that says its unit."""
    folder = Path(str(files("hapscene_assets")))
    found: dict[str, tuple[Path, str | None]] = {
        file.name.removesuffix(".scene.json"): (file, None) for file in folder.glob("*.scene.json")
    }
    for file in folder.glob("meshes/*.json"):
        about = json.loads(file.read_text(encoding="utf-8"))
        found[file.stem] = file.with_name(about["file"]), about["unit"]
    return found
