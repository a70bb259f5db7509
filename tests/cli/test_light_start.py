"""Imports of the command line that are put off."""

import importlib
import sys
from pathlib import Path

import pytest

from hapscene.cli import light_start
from hapscene.cli.light_start import _Deferred, _import_without

HEAVY = """
class Tree:
    def __init__(self, size):
        self.size = size

class TreeError(Exception):
    pass

class part:
    two = 2
"""

LIGHT = """
import heavy_one as h
from heavy_one import Tree, part
try:
    from heavy_one import TreeError
except ImportError:
    TreeError = BaseException
{use}
"""


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the module `heavy_one`, which is not imported."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "heavy_one.py").write_text(HEAVY)
    for name in ("heavy_one", "light_one"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


def test_deferred_module_is_imported_when_it_is_used(packages: Path) -> None:
    (packages / "light_one.py").write_text(LIGHT.format(use=""))
    _import_without("light_one", {"heavy_one": _Deferred("heavy_one")})
    assert "light_one" in sys.modules and "heavy_one" not in sys.modules
    light = sys.modules["light_one"]
    tree = light.Tree(size=3)
    assert type(tree).__module__ == "heavy_one" and tree.size == 3
    assert isinstance(tree, light.Tree) and not isinstance(3, light.Tree)
    assert light.h.Tree(1).size == 1 and light.part.two == 2 and light.TreeError is BaseException


def test_package_that_uses_a_module_at_once_is_imported_in_full(packages: Path) -> None:
    (packages / "light_one.py").write_text(LIGHT.format(use="class Oak(Tree): pass"))
    _import_without("light_one", {"heavy_one": _Deferred("heavy_one")})
    light = importlib.import_module("light_one")
    assert light.Oak(2).size == 2 and light.Tree is sys.modules["heavy_one"].Tree


def test_imported_packages_stay_as_they_are(packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (packages / "light_one.py").write_text("import heavy_one")
    heavy = importlib.import_module("heavy_one")
    _import_without("light_one", {"heavy_one": _Deferred("heavy_one")})
    assert vars(sys.modules["light_one"])["heavy_one"] is heavy is sys.modules["heavy_one"]
    before = sys.modules["trimesh"] = importlib.import_module("trimesh")
    light_start.import_trimesh()
    assert sys.modules["trimesh"] is before
