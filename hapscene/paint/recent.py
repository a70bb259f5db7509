"""The scenes that a user painted last, in a file of the user's data folder, so that any page can open them again."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Final

from hapscene.errors import SceneError
from hapscene.files import read_bytes, write_whole

KEPT: Final = 12
"""Most scenes that are remembered [count]."""

BYTES_MAX: Final = 100_000
"""Largest list that is read [bytes]."""


def recent_file() -> Path:
    """Where the list is: NAME beside the library of swatches, in the user's data folder."""
    from platformdirs import user_data_path

    return user_data_path("hapscene", appauthor=False) / "recent.json"


def recent_scenes() -> list[Path]:
    """Scene files that were painted, the last first; those that are gone are left out, and so is a damaged list."""
    found: list[Path] = []
    with suppress(Exception):  # whatever somebody wrote there: it is a convenience
        listed = json.loads(read_bytes(recent_file(), BYTES_MAX, "list of scenes"))
        found = [Path(name) for name in listed if isinstance(name, str)][:KEPT]
    return [path for path in found if path.is_file()]


def note_scene(path: Path) -> None:
    """Remember a scene file as the last one; nothing where the list cannot be written."""
    path = path.resolve()
    names = [str(path), *(str(other) for other in recent_scenes() if other != path)][:KEPT]
    with suppress(OSError, SceneError):
        file = recent_file()
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, json.dumps(names, indent=1).encode(errors="backslashreplace"), SceneError)
