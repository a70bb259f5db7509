"""Batch fits: each recording is fitted once, unchanged ones are skipped, errors are reported."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.batch import JOURNAL, BatchResult, find_recordings, fit_batch, fit_file, swatch_names
from hapscene.capture.fit.swatch import FitOptions
from hapscene.cli import main
from hapscene.errors import CaptureError
from hapscene.swatches.library import load_swatch

READING = {"rate_Hz": 1000.0, "units": {"acceleration": "m/s2"}}
OPTIONS = FitOptions(order=3)
WORDS = ["--rate", "1000", "--units", "acceleration=m/s2", "--order", "3", "--jobs", "1"]


def write_recording(path: Path, seed: int) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    path.write_text("acceleration\n" + "\n".join(f"{a:.6f}" for a in rng.standard_normal(1500)))
    return path


def write_recordings(folder: Path, count: int) -> list[Path]:
    return find_recordings([write_recording(folder / f"r{i:02}.csv", i) for i in range(count)])


def fitted(items: list[Path], out: Path, options: FitOptions = OPTIONS) -> BatchResult:
    return fit_batch(items, out, READING, options, jobs=1)


def check_swatch(item: Path, out: Path) -> None:
    """The swatch equals that of a fit of the recording alone."""
    made = out.parent / "alone.swatch"
    fit_file(str(item), str(made), READING, {"name": item.stem, "order": 3}, [])
    assert (out / f"{item.stem}.swatch").read_bytes() == made.read_bytes()


def test_unchanged_recordings_are_skipped_and_changed_ones_fitted_again(tmp_path: Path) -> None:
    items, out = write_recordings(tmp_path / "in", 5), tmp_path / "out"
    items[1].write_text("acceleration\n1\nx\n")
    first = fitted(items, out)
    assert len(first.fitted) == 4 and first.count == 5
    (reason,) = first.failed
    assert str(items[1]) in reason
    write_recording(items[1], 11)
    write_recording(items[2], 12).write_text("acceleration\n" + "0.1\n0.2\n" * 900)
    (out / "r03.swatch").unlink()
    again = fitted(items, out)
    assert again.skipped == ["r00.swatch", "r04.swatch"] and not again.failed
    assert again.fitted == ["r01.swatch", "r02.swatch", "r03.swatch"]
    assert fitted(items, out).count == len(fitted(items, out).skipped) == 5
    assert len(fitted(items, out, replace(OPTIONS, order=4)).fitted) == 5
    fitted(items, out)
    check_swatch(items[3], out)
    assert sorted(f.name for f in out.iterdir()) == [JOURNAL, *(f"r{i:02}.swatch" for i in range(5))]


def test_an_interrupted_batch_is_resumed(tmp_path: Path) -> None:
    items, out = write_recordings(tmp_path / "in", 4), tmp_path / "out"

    def interrupt(result: BatchResult) -> None:
        if result.count == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_batch(items, out, READING, OPTIONS, jobs=1, after=interrupt)
    with (out / JOURNAL).open("a") as file:
        file.write('{"key": "cut')
    last = fitted(items, out)
    assert last.skipped == ["r00.swatch", "r01.swatch"] and last.fitted == ["r02.swatch", "r03.swatch"]
    check_swatch(items[2], out)


def test_a_swatch_of_another_recording_is_not_replaced(tmp_path: Path) -> None:
    (one,), (two,) = write_recordings(tmp_path / "a", 1), write_recordings(tmp_path / "b", 1)
    fitted([one], tmp_path / "out")
    before = (tmp_path / "out" / "r00.swatch").read_bytes()
    with pytest.raises(CaptureError, match=r"r00\.swatch"):
        fitted([two], tmp_path / "out")
    assert (tmp_path / "out" / "r00.swatch").read_bytes() == before
    assert fitted([one, two], tmp_path / "both").fitted == ["a/r00.swatch", "b/r00.swatch"]
    with pytest.raises(CaptureError, match="cannot be created"):
        fitted([one], two)


@pytest.mark.nightly
def test_worker_processes_give_the_same_swatches(tmp_path: Path) -> None:
    items, out = write_recordings(tmp_path / "in", 5), tmp_path / "out"
    items.append(tmp_path / "in" / "none.csv")
    result = fit_batch(items, out, READING, OPTIONS, jobs=2)
    assert sorted(result.fitted) == [f"{item.stem}.swatch" for item in items[:5]] and "none.csv" in result.failed[0]
    check_swatch(items[3], out)


@pytest.mark.filterwarnings("ignore")  # the notes do not depend on the filter
def test_the_command_reports_failures_and_interpolated_samples(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = np.random.default_rng(0).standard_normal(1500)
    stream[7] = np.nan
    np.savez(tmp_path / "oak.npz", acceleration=stream)
    (tmp_path / "bad.csv").write_text("acceleration\n")
    words = ["capture", "batch", str(tmp_path / "oak.npz"), str(tmp_path / "bad.csv"), "--out", str(tmp_path / "out")]
    assert main([*words, *WORDS]) == 1
    said = capsys.readouterr().out
    assert "1 fitted, 0 skipped, 1 failed" in said and "bad.csv" in said and "1 of acceleration" in said
    texture = load_swatch(tmp_path / "out" / "oak.swatch").texture
    assert texture is not None and texture.order == 3
    assert main(["capture", "batch", "--out", str(tmp_path / "out")]) == 2


def test_folders_are_searched_recursively(tmp_path: Path) -> None:
    for name in ("b.csv", "a.wav", "sub/c.hsrec", "notes.md", ".hidden/d.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    items = find_recordings([tmp_path, tmp_path / "b.csv"])
    assert [i.relative_to(tmp_path).as_posix() for i in items] == ["a.wav", "b.csv", "sub/c.hsrec"]
    assert swatch_names(items) == ["a.swatch", "b.swatch", "sub/c.swatch"]
    (tmp_path / "empty").mkdir()
    for place in ("empty", "none.csv"):
        with pytest.raises(CaptureError, match=place):
            find_recordings([tmp_path / place])


def test_the_suffix_distinguishes_recordings_of_the_same_name(tmp_path: Path) -> None:
    items = [tmp_path / p for p in ("a/x.csv", "a/X.wav", "a/y.csv", "b/x.csv")]
    assert swatch_names(items) == ["a/x.csv.swatch", "a/X.wav.swatch", "a/y.swatch", "b/x.swatch"]
