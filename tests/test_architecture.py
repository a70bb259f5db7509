"""Dependencies point one way: read from the sources, not from what happens to be imported."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hapscene"

FLOOR = (
    *(
        "bound_call",
        "c_call",
        "clock",
        "compiled",
        "confined",
        "constants",
        "dsp",
        "errors",
        "files",
        "flags",
        "geometry",
        "memory",
    ),
    *(
        "native",
        "number_files",
        "parallel",
        "perception",
        "plugin_registry",
        "wall_clock",
        "web",
        "web_listener",
    ),
)
"""The ground floor: knows nobody above it."""

CORE = (
    *FLOOR,
    "contact",
    "contact_events",
    "contact_info",
    "describe",
    "device",
    "fidelity",
    "moving_bodies",
    "reaction",
    "recording",
    "records",
    "renderer",
    "scene",
    "surface",
    "swatches",
    "tick",
)
"""What a loop with a real device needs."""

INNER = ("handle", "interrupt", "loop", "motion", "servo", "twin", "wire")
"""What the core does not need, and others build on."""

OUTER = (
    "assets",
    "bridge",
    "capture",
    "cli",
    "exchange",
    "paint",
    "play",
    "stability",
    "study",
    "teleoperation",
    "touch",
    "view",
    "warm_up",
)
"""Uses of the house."""

TOP = ("cli", "paint", "play", "stability", "study", "teleoperation", "warm_up")
"""Rooms that no other room knows but commands."""

APART = {
    "tick": ("renderer", "recording"),
    "dsp": ("contact", "device", "scene", "surface", "tick", "renderer"),
    "contact": ("surface", "device", "tick", "renderer"),
    "device": ("surface", "scene", "tick", "renderer"),
    "handle": ("contact", "device", "scene", "tick", "renderer", "twin", "servo"),
    "loop": ("servo", "twin"),
    "twin": ("servo",),
    "wire": ("contact", "device", "scene", "surface", "tick", "renderer", "handle", "twin", "servo"),
    "exchange": ("device", "tick", "renderer", "handle", "twin", "servo"),
}
"""Rooms that know nothing of some that would not be forbidden to them otherwise."""

BETWEEN = {
    "fidelity/trial.py": {"motion"},  # draws paths; no renderer knows the search, which stands beside what it finds
    "fidelity/tune.py": {"handle", "motion", "touch"},  # the same, and it prints progress
    "handle/measure.py": {"capture"},  # recordings of a sweep are read as other recordings are
    "handle/identification_report.py": {"view"},  # plots beside what they show
    "handle/playback_report.py": {"view"},
    "handle/live_process.py": {"device", "servo"},  # drivers by name; what a servo's channel asks for, by its memory's
    "swatches/site.py": {"view"},  # draws pictures and plots of swatches
    "swatches/sound.py": {"capture", "view"},  # synthesizes the texture, at the levels of other sounds
    "warm_up.py": {"paint", "teleoperation"},  # uses all that is compiled
}
"""Files that know more than their room, and why."""


@cache
def imported_modules(source: Path, types: bool = True) -> frozenset[str]:
    """Full names of all modules that a file imports, wherever in it; without `types`, not for type checkers alone."""
    names: set[str] = set()
    tree = ast.parse(source.read_text(encoding="utf-8"))
    checks = (node for node in ast.walk(tree) if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    left_out = set() if types else {inner for check in checks for inner in ast.walk(check)}
    for node in ast.walk(tree):
        if node in left_out:
            continue
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
    """The rooms that a file imports from when it runs; types alone tie nothing."""
    names = (name.split(".") for name in imported_modules(source, types=False))
    return {parts[1] for parts in names if parts[0] == "hapscene" and len(parts) > 1}


def stray(room: str, forbidden: tuple[str, ...]) -> list[str]:
    """Which files of a room know what they must not."""
    found = []
    for source in sources(room):
        file = source.relative_to(PACKAGE).as_posix()
        rooms = (known(source) & set(forbidden)) - {room} - BETWEEN.get(file, set())
        found += [f"{file} imports {other}" for other in sorted(rooms)]
    return found


@pytest.mark.parametrize("room", FLOOR)
def test_ground_floor_knows_nobody_above(room: str) -> None:
    assert stray(room, tuple({*CORE, *INNER, *OUTER} - {*FLOOR})) == []


@pytest.mark.parametrize("room", CORE)
def test_core_knows_no_outer_room(room: str) -> None:
    assert stray(room, INNER + OUTER) == []


@pytest.mark.parametrize("room", INNER)
def test_inner_room_knows_no_outer_one(room: str) -> None:
    assert stray(room, OUTER) == []


@pytest.mark.parametrize("room", sorted({*OUTER} - {"cli"}))
def test_nobody_but_a_command_knows_the_top(room: str) -> None:
    assert stray(room, TOP) == []


@pytest.mark.parametrize("room", sorted(APART))
def test_rooms_that_are_apart(room: str) -> None:
    assert stray(room, APART[room]) == []


def modules() -> dict[str, Path]:
    """Each module of the package by its full name."""
    return {
        ".".join(("hapscene", *source.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): source
        for source in sorted(PACKAGE.rglob("*.py"))
    }


def test_no_module_imports_itself_through_others() -> None:
    known = modules()
    imports = {name: imported_modules(source, types=False) & set(known) for name, source in known.items()}
    free: set[str] = set()  # those that lead to no circle
    while more := {name for name in known if name not in free and imports[name] - {name, "hapscene"} <= free}:
        free |= more
    assert sorted(set(known) - free) == []


def test_the_map_of_the_house_is_true() -> None:
    """Every file and folder that docs/architecture.md and CONTRIBUTING.md name is there."""
    documents = (ROOT / "docs" / "architecture.md", ROOT / "CONTRIBUTING.md")
    text = "\n".join(document.read_text(encoding="utf-8") for document in documents)
    for name in sorted(set(re.findall(r"[\w./]+(?:\.py|\.js|/)(?=[\s`,:)])", text))):
        assert (ROOT / name).exists() or (PACKAGE / name).exists() or list(PACKAGE.rglob(name.strip("/"))), name


def test_every_room_has_its_place() -> None:
    rooms = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert rooms - {"__init__", "__main__", "__pycache__"} == {*CORE, *INNER, *OUTER}


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


def test_what_a_module_imports_can_be_read() -> None:
    """By full names: relative ones, or those of the package itself, loaded when used, would be seen by no test."""
    for source in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            assert not (isinstance(node, ast.ImportFrom) and node.level), source
            assert not (isinstance(node, ast.Import) and any(alias.name == "hapscene" for alias in node.names)), source
