"""The programs in examples/ run and use only public names."""

import ast
import re
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_no_path_is_deeper_than_two_dots(example: Path) -> None:
    """`hapscene.scene.Box` at the most; nothing is imported from inside."""
    tree = ast.parse(example.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert (node.module or "").partition(".")[0] != "hapscene", node.module
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("hapscene.") for alias in node.names)
        if isinstance(node, ast.Attribute):
            path = ast.unparse(node)
            assert not re.fullmatch(r"hapscene(\.\w+){3,}", path), path
