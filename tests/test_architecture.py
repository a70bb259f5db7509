"""Dependencies point one way: read from the sources, not from what happens to be imported."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hapscene"

FOUNDATION = {
    *("clock", "compiled", "constants", "dsp", "errors", "flags", "geometry", "io", "parallel"),
    *("perception", "plugin_registry", "records", "wall_clock", "web"),
}
"""Imports nothing above it."""

CORE = {"contact", "device", "fidelity", "render", "scene", "surface", "swatches"}
"""What a loop with a real device needs."""

INNER = {"handle", "interrupt", "loop", "motion"}
"""What the core does not need, and others build on."""

APPLICATIONS = {
    *("assets", "bridge", "capture", "cli", "exchange", "paint", "play", "stability", "study", "teleoperation"),
    *("touch", "view", "warm_up"),
}

LAYERS = {
    **{name: CORE | INNER | APPLICATIONS for name in FOUNDATION},
    **{name: INNER | APPLICATIONS for name in CORE},
    **{name: APPLICATIONS for name in INNER},
    **{name: {"cli", "paint", "play", "stability", "study", "teleoperation"} for name in APPLICATIONS - {"cli"}},
}
"""What each package or module must not import."""

APART = {
    "contact": {"surface", "device", "render"},
    "device": {"surface", "scene", "render"},
    "handle": {"contact", "scene", "render", "loop"},
    "exchange": {"device", "render", "handle", "loop"},
}
"""Packages that are independent of others in or below their layer."""

EXCEPTIONS = {
    "fidelity/trial.py": {"motion"},  # strokes that the search tries
    "fidelity/tune.py": {"motion", "touch"},  # progress, and the words for what cannot be touched
    "handle/measure.py": {"capture"},  # recordings of a sweep are read like other recordings
    "handle/handle_file.py": {"view"},  # plots of the report
    "handle/live_process.py": {"loop"},  # reads the samples in the servo's memory
    "swatches/site.py": {"exchange", "view"},  # pages to touch, and plots
    "swatches/sound.py": {"capture", "view"},  # synthesis of a stroke
    "warm_up.py": {"paint", "teleoperation"},  # uses all that is compiled
}
"""Files that import more than their layer allows, and why."""


@cache
def imported_modules(source: Path, types: bool = True) -> frozenset[str]:
    """Return the full names of all modules that a file imports; with `types`, also those imported for type checkers."""
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


def sources(package: str) -> list[Path]:
    """The files of a package, or of a module."""
    folder = PACKAGE / package
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [PACKAGE / f"{package}.py"]


def known(source: Path) -> set[str]:
    """Return the packages that a file imports at run time, without imports for type checkers."""
    names = (name.split(".") for name in imported_modules(source, types=False))
    return {parts[1] for parts in names if parts[0] == "hapscene" and len(parts) > 1}


def violations(package: str, forbidden: set[str]) -> list[str]:
    found = []
    for source in sources(package):
        file = source.relative_to(PACKAGE).as_posix()
        others = (known(source) & forbidden) - {package} - EXCEPTIONS.get(file, set())
        found += [f"{file} imports {other}" for other in sorted(others)]
    return found


@pytest.mark.parametrize("package", sorted(LAYERS))
def test_a_layer_imports_nothing_above_it(package: str) -> None:
    assert violations(package, LAYERS[package]) == []


@pytest.mark.parametrize("package", sorted(APART))
def test_independent_packages(package: str) -> None:
    assert violations(package, APART[package]) == []


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


def test_the_documents_name_files_that_exist() -> None:
    """Every file and folder that docs/explanation/architecture.md and CONTRIBUTING.md name is there."""
    documents = (ROOT / "docs" / "explanation" / "architecture.md", ROOT / "CONTRIBUTING.md")
    text = "\n".join(document.read_text(encoding="utf-8") for document in documents)
    for name in sorted(set(re.findall(r"[\w./]+(?:\.py|\.js|/)(?=[\s`,:)])", text))):
        assert (ROOT / name).exists() or (PACKAGE / name).exists() or list(PACKAGE.rglob(name.strip("/"))), name


def test_every_package_has_a_layer() -> None:
    names = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert names - {"__init__", "__main__", "__pycache__"} == FOUNDATION | CORE | INNER | APPLICATIONS


def test_no_exception_is_left_over() -> None:
    for file, others in EXCEPTIONS.items():
        assert others <= known(PACKAGE / file), file


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


FOLDERS = {"hapscene": "hapscene", "hapscene_plugins": "plugins", "hapscene_evidence": "evidence", "tests": "tests"}
"""Our packages, and the folders that they are in."""


def test_what_tests_and_evidence_import_exists() -> None:
    """Also where the gate does not run it, as in tests/nightly."""
    sources = [path for folder in ("tests", "evidence", "examples", "docs") for path in (ROOT / folder).rglob("*.py")]
    missing = []
    for source in sources:
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                package, _, rest = node.module.partition(".")
                if package in FOLDERS:
                    place = ROOT / FOLDERS[package] / rest.replace(".", "/")
                    if not (place.is_dir() or place.with_suffix(".py").is_file()):
                        missing.append(f"{source.relative_to(ROOT)}: {node.module}")
    assert missing == []
