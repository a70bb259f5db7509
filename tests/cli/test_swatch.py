"""`hapscene swatch compare`, as typed."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene.surface.swatch_file import save_swatch
from hapscene.swatches.library import load_swatch


@pytest.fixture(autouse=True)
def _no_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The user's own library stays out of it."""
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))


def test_two_surfaces_are_set_side_by_side(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "paper"]) == 0
    text = capsys.readouterr().out
    assert "paper is clearly different from wood: most by" in text
    for unit in ("m/s²", "dB", "%", "Hz"):
        assert unit in text
    assert "not compared: compliance" in text  # assumed, not recorded, in both


def test_the_same_surface_cannot_be_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "wood", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "cannot be distinguished" and found["distance_jnd"] == 0.0
    assert {row["unit"] for row in found["differences"]} == {"dB", "%"}


def test_one_surface_is_ranked_against_the_shipped_and_the_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "library").mkdir()
    wood = load_swatch("wood")
    grippier = 1.17 * wood.friction_dynamic
    oak = replace(wood, name="oak", friction_static=grippier, friction_dynamic=grippier)
    save_swatch(oak, tmp_path / "library" / "oak.swatch")
    (tmp_path / "library" / "broken.swatch").write_text("{}")
    assert main(["swatch", "compare", "wood", "--json"]) == 0
    told = capsys.readouterr()
    ranked = json.loads(told.out)["ranked"][0]
    assert ranked[0]["second"] == "oak" and len(ranked) == 4
    assert "broken.swatch" in told.err
    assert main(["swatch", "compare", "wood", "--library", str(tmp_path / "library")]) == 0
    assert "can be distinguished" in capsys.readouterr().out


def test_several_are_ranked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", "wood", "leather", "wood"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("1  wood")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["oka", "wood"], "no swatch 'oka'"),
        (["wood", "--library", "/none"], "no such folder"),
    ],
)
def test_errors_are_one_sentence(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["swatch", "compare", *words]) == 2
    told = capsys.readouterr()
    assert message in told.err and told.out == ""
