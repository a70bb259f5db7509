"""The programs of examples/ run, and reach what they use through public paths alone."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs_and_its_own_physics_hold(example: Path, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, example], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.strip() and "Warning" not in done.stderr, done.stderr


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
