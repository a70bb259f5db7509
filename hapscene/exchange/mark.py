"""What in a mesh file says how its surfaces feel."""

from pathlib import Path
from typing import Final

from hapscene.exchange.gltf_file import read_bounded
from hapscene.exchange.gltf_haptic import DRAFT_NAMES

OWN: Final = "hapscene"

_GLTF: Final = {'"hapscene_body"': OWN, **{f'"{name}"': name for name in DRAFT_NAMES}}

MARKS: Final = {
    ".glb": _GLTF,
    ".gltf": _GLTF,
    ".ply": {"\ncomment hapscene scene ": OWN},
    ".x3d": {"": OWN},  # read as ours, or not at all
}
"""By the suffix of a file: texts in it, and what they say."""


def mark_of(path: Path) -> str | None:
    """Who says in a mesh file how its surfaces feel: `OWN`, a draft of `DRAFT_NAMES`, or (None) nobody.

    Raises:
        SceneError: the file cannot be read.
    """
    return mark_in(path.suffix, read_bounded(path)) if path.suffix.lower() in MARKS else None


def mark_in(suffix: str, content: bytes) -> str | None:
    """The same of a file's content."""
    return next((told for text, told in MARKS[suffix.lower()].items() if text.encode() in content), None)
