"""`hapscene capture report`, as typed."""

import argparse
from pathlib import Path

import numpy as np
import pytest

from hapscene.command.capture_report import add_capture_report
from hapscene.errors import CaptureError, SwatchError


def run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    add_capture_report(parser.add_subparsers())
    options = parser.parse_args(["report", *words])
    code: int = options.command(options)
    return code


def test_a_swatch_alone_makes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("wood", "-o", str(tmp_path / "wood.html")) == 0
    assert "wood.html" in capsys.readouterr().out
    assert (tmp_path / "wood.html").read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_recording_is_named_on_the_page(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal(4000)
    np.savetxt(tmp_path / "noise.csv", noise, header="a", comments="")
    options = ("--rate", "2000", "--columns", "acceleration=a", "--units", "acceleration=m/s2")
    run("wood", str(tmp_path / "noise.csv"), "-o", str(tmp_path / "wood.html"), *options)
    assert "noise.csv: 2.00 s at 2000 Hz" in (tmp_path / "wood.html").read_text(encoding="utf-8")


def test_what_is_missing_is_said_and_nothing_is_written(tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    with pytest.raises(SwatchError, match="there are"):
        run("oka", "-o", str(page))
    with pytest.raises(CaptureError):
        run("wood", str(tmp_path / "none.csv"), "-o", str(page), "--rate", "1000")
    (tmp_path / "silent.csv").write_text("acceleration\n" + "0\n" * 2000)
    with pytest.raises(CaptureError, match=r"silent\.csv: .*silent above"):
        run("wood", str(tmp_path / "silent.csv"), "-o", str(page), "--rate", "1000", "--units", "acceleration=g")
    with pytest.raises(SystemExit):
        run("wood", "-o", str(page), "--units", "acceleration")
    assert not page.exists()
