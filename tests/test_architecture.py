"""Dependencies point one way: read from the sources, not from what happens to be imported."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hapscene"

CORE = (
    "tick",
    "describe",
    "records",
    "constants",
    "errors",
    "native",
    "clock",
    "contact",
    "surface",
    "device",
    "scene",
)
OUTER = ("capture", "view", "bench", "touch", "cli", "gesture", "path")


def imported_modules(source: Path) -> set[str]:
    """Full names of all modules that a file imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def sources(room: str) -> list[Path]:
    """The files of a room: a folder of modules, or one module."""
    folder = PACKAGE / room
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [PACKAGE / f"{room}.py"]


@pytest.mark.parametrize("room", CORE)
def test_core_knows_no_outer_room(room: str) -> None:
    for source in sources(room):
        for name in imported_modules(source):
            assert not any(name.startswith(f"hapscene.{outer}") for outer in OUTER), f"{source.name} imports {name}"


def test_core_imports_no_plugin_by_name() -> None:
    for source in PACKAGE.rglob("*.py"):
        for name in imported_modules(source):
            assert not name.startswith("hapscene_plugins"), f"{source.name} imports {name}"


@pytest.mark.parametrize(("library", "allowed"), [("embreex", "contact/embree.py"), ("pyrender", "view/offscreen.py")])
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
