"""`hapscene lab reproduce`."""

import csv
from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene_evidence.paper import reproduction
from hapscene_evidence.paper.prediction_figure import two_materials
from hapscene_evidence.paper.reproduction import END, FILES, START


def test_page_and_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduction, "FIGURES", {"fig2": ("two materials", two_materials)})
    assert main(["lab", "reproduce", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "1 of 1: two materials" in said and all(name in said for name in FILES)
    html = (tmp_path / "out" / FILES[0]).read_text(encoding="utf-8")
    assert html.count("<svg") == 2 and "wood, synthesised" in html and 'id="fig2"' in html
    with (tmp_path / "out" / FILES[1]).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 and rows[0]["unit"] == "N" and 1.0 < float(rows[0]["here"]) < 1.4


def test_summary_is_written_between_its_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduction, "FIGURES", {})
    assert main(["lab", "reproduce", "--out", str(tmp_path / "out"), "--docs", str(tmp_path)]) == 2  # no paper.md
    page = tmp_path / "paper.md"
    page.write_text(f"before\n{START}old\n{END}after\n", encoding="utf-8")
    assert main(["lab", "reproduce", "--out", str(tmp_path / "out"), "--docs", str(tmp_path)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"before\n{START}# The haptography paper") and text.endswith(f"{END}after\n")
    assert "old\n" not in text


def test_installed_package_reports_that_a_checkout_is_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapscene.cli.lab.find_spec", lambda name: None)
    for command in ("bench", "chart", "reproduce"):
        assert main(["lab", command, "--out", str(tmp_path / "out")]) == 2
        assert "clone" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_interrupt_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(reproduction, "FIGURES", {"fig2": ("two materials", interrupt)})
    assert main(["lab", "reproduce", "--out", str(tmp_path / "a" / "out")]) == 130
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (["--recordings", "missing"], "missing: no such folder"),
        (["--recordings", "empty"], "empty: no recording found; expected one or more of cdp_wood.csv"),
        (["--recordings", "file"], "file: is a file; expected a folder"),
        (["--out", "file"], "file: is a file; expected a folder"),
    ],
)
def test_invalid_options(
    arguments: list[str],
    output: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    assert main(["lab", "reproduce", *arguments]) == 2
    assert output in capsys.readouterr().err and not (tmp_path / "out").exists()
