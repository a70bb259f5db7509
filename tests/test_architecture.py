"""Dependencies point one way: read from the sources, not from what happens to be imported."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hapscene"

CORE = (
    "clock",
    "constants",
    "contact",
    "describe",
    "device",
    "dsp",
    "errors",
    "files",
    "geometry",
    "native",
    "old_spellings",
    "recording",
    "records",
    "renderer",
    "scene",
    "surface",
    "tick",
)
"""What a loop with a real device needs; `errors`, `files`, `geometry` and `dsp` are the ground floor of it."""

INNER = ("handle", "interrupt", "motion", "servo", "twin", "wire")
"""What the core does not need, and others build on."""

OUTER = ("capture", "cli", "command", "exchange", "paint", "stability", "teleoperation", "touch", "view")
"""Uses of the house."""

TOP = ("cli", "command", "paint", "stability", "teleoperation")
"""Rooms that no other room knows but commands."""

APART = {
    "tick": ("renderer", "recording"),
    "dsp": ("contact", "device", "scene", "surface", "tick", "renderer"),
    "contact": ("surface", "device", "tick", "renderer"),
    "device": ("surface", "scene", "tick", "renderer"),
    "handle": ("contact", "device", "scene", "tick", "renderer", "twin", "servo"),
    "twin": ("servo",),
    "wire": ("contact", "device", "scene", "surface", "tick", "renderer", "handle", "twin", "servo"),
    "exchange": ("device", "tick", "renderer", "handle", "twin", "servo"),
}
"""Rooms that know nothing of some that would not be forbidden to them otherwise."""

BETWEEN = {
    "handle/measure.py": {"capture"},  # recordings of a sweep are read as other recordings are
    "handle/identification_report.py": {"view"},  # plots beside what they show
    "handle/playback_report.py": {"view"},
}
"""Files that know more than their room, and why."""


@cache
def imported_modules(source: Path) -> frozenset[str]:
    """Full names of all modules that a file imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def sources(room: str) -> list[Path]:
    """The files of a room: a folder of modules, or one module."""
    folder = PACKAGE / room
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [PACKAGE / f"{room}.py"]


def known(source: Path) -> set[str]:
    """The rooms that a file imports from."""
    names = (name.split(".") for name in imported_modules(source))
    return {parts[1] for parts in names if parts[0] == "hapscene" and len(parts) > 1}


def stray(room: str, forbidden: tuple[str, ...]) -> list[str]:
    """Which files of a room know what they must not."""
    found = []
    for source in sources(room):
        file = source.relative_to(PACKAGE).as_posix()
        rooms = (known(source) & set(forbidden)) - {room} - BETWEEN.get(file, set())
        found += [f"{file} imports {other}" for other in sorted(rooms)]
    return found


@pytest.mark.parametrize("room", CORE)
def test_core_knows_no_outer_room(room: str) -> None:
    assert stray(room, INNER + OUTER) == []


@pytest.mark.parametrize("room", INNER)
def test_inner_room_knows_no_outer_one(room: str) -> None:
    assert stray(room, OUTER) == []


@pytest.mark.parametrize("room", sorted({*OUTER} - {"cli", "command"}))
def test_nobody_but_a_command_knows_the_top(room: str) -> None:
    assert stray(room, TOP) == []


@pytest.mark.parametrize("room", sorted(APART))
def test_rooms_that_are_apart(room: str) -> None:
    assert stray(room, APART[room]) == []


def test_every_room_has_its_place() -> None:
    rooms = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert rooms - {"__init__", "__pycache__"} == {*CORE, *INNER, *OUTER}


def test_no_exception_is_left_over() -> None:
    for file, rooms in BETWEEN.items():
        assert rooms <= known(PACKAGE / file), file


def test_core_imports_no_plugin_by_name() -> None:
    for source in PACKAGE.rglob("*.py"):
        for name in imported_modules(source):
            assert not name.startswith("hapscene_plugins"), f"{source.name} imports {name}"


@pytest.mark.parametrize(("library", "allowed"), [("embreex", "contact/embree.py"), ("pyrender", "view/gl.py")])
def test_library_has_one_importer(library: str, allowed: str) -> None:
    importers = {
        source.relative_to(PACKAGE).as_posix()
        for source in PACKAGE.rglob("*.py")
        if any(name.split(".")[0] == library for name in imported_modules(source))
    }
    assert importers <= {allowed}


def test_import_loads_nothing_heavy() -> None:
    heavy = "{'numba', 'scipy', 'trimesh', 'matplotlib', 'pyrender', 'numpy'}"
    code = f"import sys, hapscene; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_every_public_name_is_there() -> None:
    import hapscene

    for name in hapscene.__all__:
        assert getattr(hapscene, name) is not None
