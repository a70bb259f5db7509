"""`hapscene swatch compare`."""

from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene.swatches.library import add, load_swatch


@pytest.fixture(autouse=True)
def _no_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use an empty library."""
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))


def test_two_surfaces(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "paper"]) == 0
    text = capsys.readouterr().out
    assert "paper is clearly different from wood" in text
    for unit in ("m/s²", "dB", "%", "Hz"):
        assert unit in text
    assert "not compared: compliance" in text  # assumed, not measured, in both


def test_one_surface_is_ranked_against_the_library(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wood = load_swatch("wood")
    grippier = 1.17 * wood.friction_dynamic
    oak = replace(wood, name="oak", friction_static=grippier, friction_dynamic=grippier)
    add(oak)
    broken = tmp_path / "library" / add(replace(oak, name="broken")).file
    broken.write_text("{}")
    assert main(["swatch", "compare", "wood"]) == 0
    output = capsys.readouterr()
    header, nearest, *others = output.out.splitlines()
    assert "distance" in header and nearest.startswith("1  oak") and "1.4 JND" in nearest
    assert [line[:1] for line in others[:3]] == ["2", "3", "4"]
    assert "broken.swatch" in output.err


def test_several_surfaces_are_ranked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "leather", "paper"]) == 0
    assert {line.split()[1] for line in capsys.readouterr().out.splitlines()[1:3]} == {"leather", "paper"}


def test_an_unknown_surface_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "oka", "wood"]) == 2
    output = capsys.readouterr()
    assert "no swatch 'oka'" in output.err and output.out == ""
