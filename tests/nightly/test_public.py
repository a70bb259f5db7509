"""The public face: reached at once after `import hapscene`, told in a line, and called by its older spellings too."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


ROOMS = sorted(path.parent.name for path in (ROOT / "hapscene").glob("*/__init__.pyi"))


def public_of(room: str) -> list[str]:
    return list(import_module(f"hapscene.{room}").__all__)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_reached_after_import_alone(room: str) -> None:
    names = public_of(room)
    assert names
    code = f"import hapscene; print(*(type(getattr(hapscene.{room}, name)).__name__ for name in {names!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == len(names)


def test_regions_are_reached_as_documented() -> None:
    code = "import hapscene; print(hapscene.scene.region.Box, hapscene.stability.closed_form, hapscene.device.model)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_import_loads_nothing_heavy() -> None:
    heavy = "{'numba', 'scipy', 'trimesh', 'matplotlib', 'pyrender', 'numpy'}"
    code = f"import sys, hapscene; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
