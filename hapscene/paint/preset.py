"""Presets of hand and brush: under names, in the user's folder, beside the library of swatches."""

import json
from pathlib import Path
from typing import Any, Final

from hapscene.errors import FormatError
from hapscene.files import parse_json, read_bytes, refusing, write_whole
from hapscene.surface.library import library_folder

NAME_MAX: Final = 60
"""Longest name [characters]."""

PRESET_MAX: Final = 200
"""Most presets [count]."""

Preset = dict[str, Any]
"""Numbers and texts by name; who uses them checks them."""


class PresetError(FormatError):
    """A preset that cannot be kept, or a list of them that cannot be read."""


def presets_file() -> Path:
    """Where they are."""
    return library_folder() / "presets.json"


def load_presets() -> dict[str, Preset]:
    """All, by name; none where there is no file.

    Raises:
        PresetError: the file is damaged.
    """
    file = presets_file()
    if not file.is_file():
        return {}
    with refusing(PresetError, file):
        content = parse_json(read_bytes(file, 1_000_000, "list of presets"), "a list of presets")
        if not isinstance(content, dict) or not all(isinstance(preset, dict) for preset in content.values()):
            raise PresetError("not a list of presets; remove the file to begin anew")
    return content


def save_preset(name: str, preset: Preset | None) -> None:
    """Keep a preset under a name, in the place of one that is there; None removes it.

    Raises:
        PresetError: the name is none, there are too many, or the file cannot be written.
    """
    presets = load_presets()
    if preset is None:
        presets.pop(name, None)
    elif not 1 <= len(name) <= NAME_MAX or not name.isprintable():
        raise PresetError(f"a preset's name must be 1 to {NAME_MAX} printable characters, is {name[:NAME_MAX]!r}")
    else:
        presets[name] = preset
    if len(presets) > PRESET_MAX:
        raise PresetError(f"{PRESET_MAX} presets are kept at most: delete one first")
    file = presets_file()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PresetError(f"{file}: cannot be written: {error.strerror}") from None
    write_whole(file, (json.dumps(presets, indent=2, ensure_ascii=False) + "\n").encode(), PresetError)
