"""`hapscene check` examines third-party meshes or refuses them in one line, with the matching exit code."""

from pathlib import Path

import pytest

from hapscene import cli
from hapscene.constants import UNITLESS
from hapscene.scene.mesh_file import FORMATS

QUICK_MAX_B = 150_000
"""Largest file in the short run [bytes]."""


def checked(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    unit = ["--unit", "mm"] if file.suffix.lower().lstrip(".") in UNITLESS else []
    code = cli.main(["check", str(file), *unit])
    said = capsys.readouterr()
    assert "Traceback" not in said.out + said.err, file
    assert (code in (0, 1) and "faces" in said.out) or (code == 2 and file.name in said.err.splitlines()[-1]), (
        file,
        said,
    )


def meshes(shared: Path) -> list[Path]:
    return [f for f in sorted((shared / "data/meshes").iterdir()) if f.suffix.lower().lstrip(".") in FORMATS]


@pytest.mark.parametrize("large", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_third_party_meshes_are_examined(shared: Path, capsys: pytest.CaptureFixture[str], large: bool) -> None:
    for file in (f for f in meshes(shared) if (f.stat().st_size > QUICK_MAX_B) == large):
        checked(file, capsys)
