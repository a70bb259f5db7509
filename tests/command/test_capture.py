"""`hapscene capture fit`, as typed."""

import argparse
import sys
from pathlib import Path

import numpy as np
import pytest

from hapscene.cli import main
from hapscene.command import capture
from hapscene.command.capture import add_fit, add_report
from hapscene.errors import CaptureError, HapsceneError, SwatchError
from hapscene.surface import texture
from hapscene.surface.swatch_summary import lines, sounding
from hapscene.swatches.library import load_swatch

UNITS = "acceleration=m/s2,speed=mm/s,force=N"


def run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    add_fit(parser.add_subparsers())
    options = parser.parse_args(["fit", *words])
    code: int = options.command(options)
    return code


def write(path: Path, seed: int = 0, count: int = 4000) -> Path:
    rng = np.random.default_rng(seed)
    speed, force = 150 + 20 * np.sin(np.arange(count) / 300), 1.5 + 0.3 * np.sin(np.arange(count) / 200)
    table = np.stack([speed, force, rng.standard_normal(count), np.full(count, 0.4)], axis=1)
    np.savetxt(path, table, delimiter=",", header="speed,force,accel,friction", comments="")
    return path


def test_a_swatch_a_plot_and_the_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    oak, plot = tmp_path / "oak.swatch", tmp_path / "states.png"
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS)
    assert run(str(write(tmp_path / "a.csv")), "--name", "Eiche", "-o", str(oak), "--plot", str(plot), *options) == 0
    swatch = load_swatch(oak)
    assert swatch.name == "Eiche" and swatch.texture is not None
    assert "a.csv" in swatch.provenance
    assert swatch.friction_dynamic == pytest.approx(0.4, rel=1e-6)
    said = capsys.readouterr().out
    for text in (
        "texture: order",
        "dynamic 0.400 [0.400, 0.400]",
        "absent: taps: no tap",
        "absent: stiffness_N_m",
        "oak.swatch",
    ):
        assert text in said
    assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_a_recording_of_an_undecodable_name_is_fitted(tmp_path: Path) -> None:
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS, "--order", "4")
    assert run(str(write(tmp_path / "a\udcff.csv")), "-o", str(tmp_path / "oak.swatch"), *options) == 0
    assert "to a\\udcff.csv" in load_swatch(tmp_path / "oak.swatch").provenance


def test_several_recordings_are_pooled(tmp_path: Path) -> None:
    files = [str(write(tmp_path / f"{i}.csv", i)) for i in range(3)]
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS, "--order", "4")
    run(*files, "-o", str(tmp_path / "oak.swatch"), *options)
    swatch = load_swatch(tmp_path / "oak.swatch")
    assert swatch.name == "oak" and swatch.texture is not None and swatch.texture.order == 4
    assert "0.csv, 1.csv, 2.csv" in swatch.provenance


@pytest.mark.nightly
def test_into_a_folder_each_recording_has_a_swatch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As `capture batch` does, which goes on with what `capture fit` began."""
    folder, out = tmp_path / "in", tmp_path / "swatches"
    folder.mkdir()
    for i in range(3):
        write(folder / f"r{i}.csv", i)
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS, "--order", "4", "--jobs", "1")
    assert run(str(folder / "r0.csv"), str(folder / "r1.csv"), "-o", f"{out}/", *options) == 0
    assert "2 fitted" in capsys.readouterr().out
    assert [load_swatch(out / f"r{i}.swatch").name for i in range(2)] == ["r0", "r1"]
    assert main(["capture", "batch", str(folder), "--out", str(out), *options]) == 0
    assert "1 fitted, 2 skipped, 0 failed" in capsys.readouterr().out
    assert run(str(folder), "-o", str(out), *options) == 0  # the folder is there: no slash is needed
    assert "0 fitted, 3 skipped, 0 failed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.csv", "-o", "oak.swatch", "--jobs", "2"], r"--jobs is for .* -o names a folder, as in .*, not oak"),
        (["a.csv", "-o", "oak.swatch", "--scheduler", "tcp://x:1"], r"--scheduler is for a swatch of each recording"),
        (["-o", "oak.swatch", "--list", "files.csv"], r"--list is for a swatch of each recording"),
        ([".", "-o", "oak.swatch"], r"^\.: a folder: .* name a folder, as in -o swatches/; to pool .* name its files"),
        (["-o", "oak.swatch"], r"no recordings: name one or more files"),
        (["a.csv", "b.csv", "-o", "oak"], r"must end in \.swatch; a folder, .* with a slash: -o oak/"),
        (["a.csv", "b.csv", "-o", "out/", "--name", "oak"], r"--name is for one swatch: .* -o oak\.swatch"),
        (["a.csv", "b.csv", "-o", "out/", "--plot", "x.png"], r"--plot is for one swatch"),
        (["a.csv"], r"^a\.csv: no such file$"),
        (["a.csv", "-o", "oak.swatch"], r"^a\.csv: no such file$"),
        ([], r"no recordings: name one or more files"),
        (["-o", "out/", "--list", "files.csv"], r"^files\.csv: no such file$"),
        (["none", "-o", "out/"], r"^none: no such file or folder$"),
        (["a.csv", "-o", "out", "--jobs", "2", "--scheduler", "tcp://x:1"], r"give one of the two"),
        (["-o", "out/"], r"no recordings: name files or folders, or --list files\.csv"),
    ],
)
def test_options_that_do_not_fit_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(HapsceneError, match=message):
        run(*words)
    assert not list(tmp_path.iterdir())


def test_what_is_missing_is_said_and_nothing_is_written(tmp_path: Path) -> None:
    path, out = str(write(tmp_path / "a.csv")), str(tmp_path / "oak.swatch")
    given = ("--columns", "acceleration=accel", "--units", UNITS)
    with pytest.raises(CaptureError, match="--rate HZ"):
        run(path, "-o", out, *given)
    with pytest.raises(CaptureError, match="--units acceleration=m/s2"):
        run(path, "-o", out, "--rate", "2000", "--columns", "acceleration=accel")
    with pytest.raises(CaptureError, match="--columns acceleration=accel"):
        run(path, "-o", out, "--rate", "2000", "--units", UNITS)
    with pytest.raises(CaptureError, match=r"a\.csv: .*at least 0\.5 s"):
        run(str(write(tmp_path / "a.csv", count=100)), "-o", out, "--rate", "2000", *given)
    lone = tmp_path / "a.csv"
    lone.write_text("accel,force\n" + "0.001,0\n" * 2000 + "1,1\n-1,1\n" * 200 + "0.001,0\n" * 2000)
    with pytest.raises(CaptureError, match=r"a\.csv, .*a\.csv: the tool slides for 0\.4"):
        run(str(lone), str(lone), "-o", out, "--rate", "2000", *given)
    with pytest.raises(SwatchError, match=r"must end in \.swatch"):
        run(path, "-o", str(tmp_path / "oak.json"))
    with pytest.raises(SystemExit):
        run(path, "-o", out, "--order", "0")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


@pytest.mark.nightly
def test_without_a_name_the_swatch_is_called_as_the_recording_and_replaces_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS, "--order", "4")
    assert run(str(write(tmp_path / "in" / "oak.csv")), *options) == 0
    assert "  oak.swatch  (" in capsys.readouterr().out
    before = (tmp_path / "oak.swatch").read_bytes()
    with pytest.raises(HapsceneError, match=r"oak\.swatch: is there already; -o oak\.swatch takes its place"):
        run("in/oak.csv", *options)
    assert (tmp_path / "oak.swatch").read_bytes() == before
    assert run("in", *options, "--jobs", "1") == 0
    assert load_swatch(tmp_path / "out" / "swatches" / "oak.swatch").name == "oak"


def test_how_the_texture_is_fitted_can_be_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = str(write(tmp_path / "a.csv")), tmp_path / "oak.swatch"
    options = ("--rate", "2000", "--columns", "acceleration=accel", "--units", UNITS, "--order", "4")
    run(path, "-o", str(out), *options, "--interpolation", "direct")
    texture = load_swatch(out).texture
    assert texture is not None and texture.interpolation == "direct"
    told = capsys.readouterr()
    said = next(line for line in told.out.splitlines() if "texture:" in line)
    count = sounding(texture)
    assert f"{count} model" in said
    assert f"{count} model{'s' if count != 1 else ''} of order 4" in "\n".join(lines(load_swatch(out)))


def test_the_choices_are_those_of_the_fit() -> None:
    assert capture.INTERPOLATIONS == texture.INTERPOLATIONS


# `hapscene capture report`, as typed.


def run_report(*words: str) -> int:
    parser = argparse.ArgumentParser()
    add_report(parser.add_subparsers())
    options = parser.parse_args(["report", *words])
    code: int = options.command(options)
    return code


def test_a_swatch_alone_makes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_report("wood", "-o", str(tmp_path / "wood.html")) == 0
    assert "wood.html" in capsys.readouterr().out
    assert (tmp_path / "wood.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_a_recording_is_named_on_the_page(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal(4000)
    np.savetxt(tmp_path / "noise.csv", noise, header="a", comments="")
    options = ("--rate", "2000", "--columns", "acceleration=a", "--units", "acceleration=m/s2")
    run_report("wood", str(tmp_path / "noise.csv"), "-o", str(tmp_path / "wood.html"), *options)
    assert "noise.csv: 2.00 s at 2000 Hz" in (tmp_path / "wood.html").read_text(encoding="utf-8")


def test_what_is_missing_is_said_and_nothing_is_written_capture_report(tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    with pytest.raises(SwatchError, match="there are"):
        run_report("oka", "-o", str(page))
    with pytest.raises(CaptureError):
        run_report("wood", str(tmp_path / "none.csv"), "-o", str(page), "--rate", "1000")
    (tmp_path / "silent.csv").write_text("acceleration\n" + "0\n" * 2000)
    with pytest.raises(CaptureError, match=r"silent\.csv: .*silent above"):
        run_report("wood", str(tmp_path / "silent.csv"), "-o", str(page), "--rate", "1000", "--units", "acceleration=g")
    with pytest.raises(SystemExit):
        run_report("wood", "-o", str(page), "--units", "acceleration")
    assert not page.exists()


@pytest.mark.nightly
def test_tool_tip_and_what_was_recorded_beside_are_kept_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = np.loadtxt(write(tmp_path / "a.csv"), delimiter=",", skiprows=1)
    more = np.stack([np.linspace(3.0, 8.0, len(table)), np.linspace(0.0, 25.0, len(table))], axis=1)
    head = "speed,force,acceleration,friction,grip_force,contact_angle"
    np.savetxt(tmp_path / "b.csv", np.hstack([table, more]), delimiter=",", header=head, comments="")
    options = ["--rate", "2000", "--units", f"{UNITS},grip_force=N,contact_angle=deg", "--order", "4"]
    oak = tmp_path / "oak.swatch"
    words = [str(tmp_path / "b.csv"), "-o", str(oak), "--tool", "steel probe", "--tip", "3.2 mm ball", *options]
    assert run(*words) == 0
    said = capsys.readouterr().out
    for text in (
        "  tool: steel probe\n  tip: 3.2 mm ball\n",
        "recorded with grip force 3.25 to 7.75 N, contact angle 1.25",
    ):
        assert text in said
    swatch = load_swatch(oak)
    assert (swatch.tool, swatch.tip) == ("steel probe", "3.2 mm ball")
    assert "contact angle 1.25 to 23.7°." in "".join(lines(swatch))
    page = tmp_path / "oak.html"
    assert main(["capture", "report", str(oak), str(tmp_path / "b.csv"), "-o", str(page), *options[:4]]) == 0
    shown = page.read_text(encoding="utf-8")
    assert "<dd>3.2 mm ball</dd>" in shown and "friction" in shown and "grip force, contact angle" in shown
    assert (
        run(str(tmp_path / "b.csv"), "-o", str(tmp_path / "many") + "/", "--jobs", "1", "--tip", "nail", *options) == 0
    )
    assert load_swatch(tmp_path / "many" / "b.swatch").tip == "nail"
