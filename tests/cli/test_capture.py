"""`hapscene capture`."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.recorder import REACHED, STOPPED, RecordingResult
from hapscene.cli import main
from hapscene.cli.capture import _remembered
from hapscene.io.probe_protocol import Count
from hapscene.surface.swatch_summary import lines
from hapscene.swatches.library import load_swatch

UNITS = "acceleration=m/s2,speed=mm/s,force=N"


def run(*words: str) -> int:
    return main(["capture", "fit", *words])


def write(path: Path, seed: int = 0, count: int = 4000) -> Path:
    rng = np.random.default_rng(seed)
    speed, force = 150 + 20 * np.sin(np.arange(count) / 300), 1.5 + 0.3 * np.sin(np.arange(count) / 200)
    table = np.stack([speed, force, rng.standard_normal(count), np.full(count, 0.4)], axis=1)
    np.savetxt(path, table, delimiter=",", header="speed,force,accel,friction", comments="")
    return path


def test_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    oak = tmp_path / "oak.swatch"
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS)
    assert run(str(write(tmp_path / "a.csv")), "--name", "Eiche", "-o", str(oak), *options) == 0
    swatch = load_swatch(oak)
    assert swatch.name == "Eiche" and swatch.texture is not None
    assert "a.csv" in swatch.provenance
    assert swatch.friction_dynamic == pytest.approx(0.4, rel=1e-6)
    output = capsys.readouterr().out
    for text in (
        "of order",
        "0.4 dynamic (no interval: the recording has too few strokes",
        "taps        not measured: no tap",
        "oak.swatch",
    ):
        assert text in output


def test_record_prints_the_result_and_what_is_wrong_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, count = tmp_path / "a.hsrec", Count(dropped=40, restarts=2)
    words = ["capture", "record", "--port", "none", "-o", str(file)]
    for measured_Hz, ended, code in ((2000.0, STOPPED, 0), (None, REACHED, 0), (2100.0, "the probe is silent", 1)):
        made = RecordingResult(file, 2000.0, 4000, count, measured_Hz, ended)
        monkeypatch.setattr("hapscene.capture.recorder.record", lambda *given, made=made: made)
        file.touch()
        assert main(words) == code
        output = capsys.readouterr()
        assert "a.hsrec" in output.out and f"2.000 s; dropped 40 (1 %), torn 0, garbage 0: {ended}" in output.out
        assert ("measured with the clock of this computer: 2100 Hz" in output.err) == (measured_Hz == 2100.0)
        assert ("restarted 2 times" in output.err) == (count.restarts > 0)
        count = Count(dropped=40)
    file.unlink()

    def interrupted(*given: object) -> None:
        file.touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("hapscene.capture.recorder.record", interrupted)
    assert main(words) == 130 and "recorded so far are in" in capsys.readouterr().err


def test_several_recordings_are_pooled(tmp_path: Path) -> None:
    files = [str(write(tmp_path / f"{i}.csv", i)) for i in range(3)]
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS, "--order", "4")
    run(*files, "-o", str(tmp_path / "oak.swatch"), *options)
    swatch = load_swatch(tmp_path / "oak.swatch")
    assert swatch.name == "oak" and swatch.texture is not None and swatch.texture.order == 4
    assert "0.csv, 1.csv, 2.csv" in swatch.provenance


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fit", "a.csv"], "a.csv: no such file"),
        (["fit"], "RECORDINGS"),
        (["fit", __file__, "-o", "oak"], "oak: "),
        (["batch", "none", "-o", "out/"], "none: no such file or folder"),
        (["batch", "-o", "out/"], "no recordings"),
    ],
)
def test_invalid_options(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["capture", *words]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_missing_input_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = str(write(tmp_path / "a.csv")), str(tmp_path / "oak.swatch")
    given = ("--columns", "acceleration=accel", "--units", UNITS)
    for words, output in (
        ((path, *given), "--rate HZ"),
        ((path, "--rate", "2000", "--columns", "acceleration=accel"), "--units acceleration=m/s2"),
        ((path, "--rate", "2000", "--units", UNITS), "--columns acceleration="),
        ((path, "--rate", "2000", *given, "--name", "a/b"), "slash"),
        ((str(write(tmp_path / "b.csv", count=100)), "--rate", "2000", *given), "at least 0.5 s"),
    ):
        assert run(*words, "-o", out) == 2
        assert output in capsys.readouterr().err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.csv", "b.csv"]


# `hapscene capture report`, as typed.


def run_report(*words: str) -> int:
    return main(["capture", "report", *words])


def test_a_report_reads_the_recording_as_the_fit_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    oak, page, oak_csv = tmp_path / "oak.swatch", tmp_path / "oak.html", write(tmp_path / "oak.csv")
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS)
    assert run(str(oak_csv), "-o", str(oak), "--order", "4", *options) == 0
    assert run_report(str(oak), str(oak_csv), "-o", str(page)) == 0
    assert "oak.csv: 2.00 s at 2000 Hz" in page.read_text(encoding="utf-8")
    assert run_report(str(oak), str(oak_csv), "-o", str(page), "--rate", "4000") == 0  # a given option counts more
    assert "oak.csv: 1.00 s at 4000 Hz" in page.read_text(encoding="utf-8")
    other = oak_csv.rename(tmp_path / "pine.csv")  # of another file nothing is known
    assert (
        run_report(str(oak), str(other), "-o", str(page)) == 2 and 'no column "acceleration"' in capsys.readouterr().err
    )


@pytest.mark.parametrize("stored", ["", "[1]", '{"rate_Hz": []}', '{"columns": 3}', '{"units": {"force": 1}}', "{"])
def test_options_of_a_stranger_are_no_error(stored: str) -> None:
    found = _remembered(f"Fitted to oak.csv. Read with {stored}.", "oak.csv")
    assert found in ({}, {"units": {"force": "1"}})


def test_invalid_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "a.html"
    (tmp_path / "silent.csv").write_text("acceleration\n" + "0\n" * 2000)
    silent = [str(tmp_path / "silent.csv"), "--rate", "1000", "--units", "acceleration=g"]
    for words, output in (
        (["oka"], "no swatch 'oka'"),
        (["wood", "none.csv"], "none.csv"),
        (["wood", *silent], "silent"),
    ):
        assert run_report(*words, "-o", str(page)) == 2
        assert output in capsys.readouterr().err
    assert not page.exists()


@pytest.mark.nightly
def test_tool_and_tip_are_stored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = np.loadtxt(write(tmp_path / "a.csv"), delimiter=",", skiprows=1)
    more = np.stack([np.linspace(3.0, 8.0, len(table)), np.linspace(0.0, 25.0, len(table))], axis=1)
    head = "speed,force,acceleration,friction,grip_force,contact_angle"
    np.savetxt(tmp_path / "b.csv", np.hstack([table, more]), delimiter=",", header=head, comments="")
    options = ["--rate", "2000", "--units", f"{UNITS},grip_force=N,contact_angle=deg", "--order", "4"]
    oak = tmp_path / "oak.swatch"
    words = [str(tmp_path / "b.csv"), "-o", str(oak), "--tool", "steel probe", "--tip", "3.2 mm ball", *options]
    assert run(*words) == 0
    output = capsys.readouterr().out
    for text in ("steel probe", "3.2 mm ball", "grip force 3.25 to 7.75 N, contact angle 1.25"):
        assert text in output
    swatch = load_swatch(oak)
    assert (swatch.tool, swatch.tip) == ("steel probe", "3.2 mm ball")
    assert "contact angle 1.25 to 23.7°." in "".join(lines(swatch))
    page = tmp_path / "oak.html"
    assert main(["capture", "report", str(oak), str(tmp_path / "b.csv"), "-o", str(page), *options[:4]]) == 0
    shown = page.read_text(encoding="utf-8")
    assert "<dd>3.2 mm ball</dd>" in shown and "friction" in shown and "grip force, contact angle" in shown
