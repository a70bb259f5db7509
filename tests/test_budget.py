"""The size of the code stays within the budgets in pyproject.toml, and so does the public API."""

import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BUDGET = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hapscene"]["budget"]


def files(folder: str) -> list[Path]:
    return [path for path in (ROOT / folder).rglob("*.py") if "__pycache__" not in path.parts]


def public_names(stub: Path) -> set[str]:
    """Names that an `__init__.pyi` offers, without sub-packages."""
    tree = ast.parse(stub.read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module is not None]
    return {alias.name for node in imports for alias in node.names}


@pytest.mark.parametrize("folder", BUDGET["lines"])
def test_lines_stay_within_their_budget(folder: str) -> None:
    lines = sum(path.read_bytes().count(b"\n") for path in files(folder))
    assert lines <= BUDGET["lines"][folder]


@pytest.mark.parametrize("folder", BUDGET["files"])
def test_files_stay_within_their_budget(folder: str) -> None:
    assert len(files(folder)) <= BUDGET["files"][folder]


@pytest.mark.parametrize("document", BUDGET["words"])
def test_words_stay_within_their_budget(document: str) -> None:
    """Words of a document, or of all documents in a folder; marks of tables are not words."""
    path = ROOT / document
    texts = [file.read_text(encoding="utf-8") for file in ([path] if path.is_file() else path.rglob("*.md"))]
    assert sum(any(c.isalnum() for c in word) for text in texts for word in text.split()) <= BUDGET["words"][document]


def test_the_public_api_stays_small() -> None:
    top = public_names(ROOT / "hapscene" / "__init__.pyi")
    stubs = [public_names(stub) for stub in (ROOT / "hapscene").glob("*/__init__.pyi")]
    assert len(top) <= BUDGET["names"]["top"]
    assert len(top) + sum(map(len, stubs)) <= BUDGET["names"]["all"]
    assert not any(top & names for names in stubs), "one import path for each name"
