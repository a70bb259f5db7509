"""`hapscene swatch compare`."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene.surface.swatch_file import save_swatch
from hapscene.swatches.library import load_swatch


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


def test_the_same_surface(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "wood", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["distance_jnd"] == 0.0
    assert {row["unit"] for row in found["differences"]} == {"dB", "%"}


def test_one_surface_is_ranked_against_the_library(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "library").mkdir()
    wood = load_swatch("wood")
    grippier = 1.17 * wood.friction_dynamic
    oak = replace(wood, name="oak", friction_static=grippier, friction_dynamic=grippier)
    save_swatch(oak, tmp_path / "library" / "oak.swatch")
    (tmp_path / "library" / "broken.swatch").write_text("{}")
    assert main(["swatch", "compare", "wood", "--json"]) == 0
    output = capsys.readouterr()
    ranked = json.loads(output.out)["ranked"][0]
    assert ranked[0]["second"] == "oak" and len(ranked) == 4
    assert "broken.swatch" in output.err
    assert main(["swatch", "compare", "wood", "--library", str(tmp_path / "library")]) == 0
    assert "1.4 JND" in capsys.readouterr().out


def test_several_surfaces_are_ranked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "leather", "wood"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("1  wood")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["oka", "wood"], "no swatch 'oka'"),
        (["wood", "--library", "/none"], "no such folder"),
    ],
)
def test_errors(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", *words]) == 2
    output = capsys.readouterr()
    assert message in output.err and output.out == ""
