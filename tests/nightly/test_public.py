"""Public names are available after `import hapscene`, which loads no large dependency."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


PACKAGES = sorted(path.parent.name for path in (ROOT / "hapscene").glob("*/__init__.pyi"))


def public_of(package: str) -> list[str]:
    return list(import_module(f"hapscene.{package}").__all__)


@pytest.mark.parametrize("package", PACKAGES)
def test_subpackage_is_available_after_importing_hapscene(package: str) -> None:
    names = public_of(package)
    assert names
    code = f"import hapscene; print(*(type(getattr(hapscene.{package}, name)).__name__ for name in {names!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == len(names)


def test_documented_modules_are_available() -> None:
    code = "import hapscene; print(hapscene.scene.region.Box, hapscene.stability.closed_form, hapscene.device.model)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_import_loads_no_large_dependency() -> None:
    heavy = "{'numba', 'scipy', 'trimesh', 'matplotlib', 'pyrender', 'numpy'}"
    code = f"import sys, hapscene; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
