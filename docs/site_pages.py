"""Pages of the web site that are no file of docs/: the README, which is the first, and a reference of each public room.

mkdocs.yml names this file as its hook; `make docs` builds the site.
"""

import re
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from griffe import Extension, Object
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import hapscene

ROOT = Path(__file__).resolve().parents[1]

DOCUMENTS = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Documents outside docs/, and their pages."""

PICTURE = re.compile(r'<picture>\s*<source [^>]*srcset="([^"]+)">\s*<img src="([^"]+)"([^>]*)>\s*</picture>')

SHARED_LINE = re.compile(r"^    (\w+(?:, \w+)+): (.+(?:\n {5,}.+)*)", re.MULTILINE)
"""A line of a docstring's section that tells of several names at once."""


class SharedLine(Extension):
    """For griffe, which reads the docstrings: such a line is told of each name, so that each has its type."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = SHARED_LINE.sub(
                lambda line: "\n".join(f"    {name}: {line[2]}" for name in line[1].split(", ")), obj.docstring.value
            )


def public_rooms() -> list[ModuleType]:
    """hapscene, the modules that its stub names and that have an `__all__`, and the errors."""
    found = [getattr(hapscene, name) for name in sorted(hapscene.__all__)]
    rooms = [value for value in found if isinstance(value, ModuleType) and getattr(value, "__all__", None)]
    return [hapscene, *rooms, import_module("hapscene.errors")]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for document, page in DOCUMENTS.items():
        text = (ROOT / document).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=linked(text)))
    rooms = public_rooms()
    home: dict[int, str] = {}
    for room in rooms:
        page = f"reference/{room.__name__}.md"
        files.append(File.generated(config, page, content=reference(room, rooms, home)))
    assert config.nav is not None
    config.nav.append({"Reference": [{room.__name__: f"reference/{room.__name__}.md"} for room in rooms]})
    return files


def linked(text: str) -> str:
    """A document of the root with links as they are on the site: what is no page of it is code."""
    text = re.sub(r'(?<=[("])docs/', "", text)
    for document, page in DOCUMENTS.items():
        text = text.replace(f"]({document})", f"]({page})")
    return re.sub(r"\[([^]]+)\]\((?!\w+://)([^)#]+)(?<!\.md)\)", r"`\1`", text)


def reference(room: ModuleType, rooms: list[ModuleType], home: dict[int, str]) -> str:
    """The page of a room: its docstring, then every public name but other rooms.

    What is public in two rooms is told in the first; `home` has where that was, by the object's identity. What a room
    has from a module that is public in it is told of the room alone.
    """
    parts = [f"::: {room.__name__}\n    options: {{heading_level: 1, members: false, show_root_full_path: true}}"]
    for name in room.__all__:
        path, value = f"{room.__name__}.{name}", getattr(room, name)
        if isinstance(value, ModuleType):
            if value not in rooms:
                parts.append(f"::: {path}\n    options: {{filters: ['!^_', '!^({'|'.join(room.__all__)})$']}}")
            continue
        first = home.setdefault(id(value), path) if isinstance(value, type | FunctionType) else path
        parts.append(f"::: {path}" if first == path else f"## {name} {{#{path}}}\nThe same as `{first}`.")
    return "\n\n".join(parts) + "\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Pictures that come in two versions follow the palette that is chosen, not the system's alone."""
    return PICTURE.sub(r'<img src="\2#only-light"\3 loading="lazy"><img src="\1#only-dark"\3 loading="lazy">', markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Public names in the text lead to the reference."""
    return re.sub(r"<code>(hapscene\.[\w.]+)</code>", r'<autoref identifier="\1" optional>\g<0></autoref>', html)
