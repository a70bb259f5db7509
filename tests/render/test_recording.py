"""The recording and its file formats."""

import csv
import io
import os
import zipfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.render.recording import Recording, RecordingError


def make_recording(count: int = 7, block: int = 3) -> Recording:
    rng = np.random.default_rng(1)
    index = np.arange(count, dtype=np.int32) % 3 - 1
    return Recording(
        t_s=np.arange(count) * 1e-3,
        p_WT_m=rng.normal(size=(count, 3)),
        p_WP_m=rng.normal(size=(count, 3)),
        nhat_W=rng.normal(size=(count, 3)),
        depth_m=rng.random(count),
        touching=index >= 0,
        body=index,
        face=index,
        swatch=index,
        f_W_N=rng.normal(size=(count, 3)),
        flags=np.arange(count, dtype=np.uint32),
        tick_ns=rng.integers(1000, 9000, count),
        contact_ns=rng.integers(100, 900, count),
        slip_m_s=rng.random(count),
        normal_force_N=rng.random(count),
        a_m_s2=rng.normal(size=(count, block)),
        f_body_W_N=rng.normal(size=(count, 3)),
        a_rate_Hz=block / 1e-3,
        body_names=("plate, large", "ball"),
        swatch_names=("plain", 'oak "A"'),
        seed=2**60,
        effects=("wall", "tap"),
    )


def test_npz_is_lossless(tmp_path: Path) -> None:
    recording = make_recording()
    recording.save(tmp_path / "touch.npz")
    loaded = Recording.load(tmp_path / "touch.npz")
    for field in fields(Recording):
        before, after = getattr(recording, field.name), getattr(loaded, field.name)
        if isinstance(before, np.ndarray):
            assert before.dtype == after.dtype and np.array_equal(before, after), field.name
        else:
            assert before == after and type(before) is type(after), field.name
    assert len(loaded) == 7


def test_a_file_of_version_1_is_read(tmp_path: Path) -> None:
    """Version 1 lacks two columns: the start of contacts is recomputed, the force on the body is unknown."""
    recording = make_recording()
    recording.save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as held:
        old = {name: held[name] for name in held.files if name not in ("began", "f_body_W_N")} | {"format_version": 1}
    np.savez(tmp_path / "old.npz", **old)
    loaded = Recording.load(tmp_path / "old.npz")
    assert loaded.touching.tolist() == [False, True, True] * 2 + [False]
    assert np.flatnonzero(loaded.began).tolist() == [1, 4] and np.isnan(loaded.f_body_W_N).all()
    np.testing.assert_array_equal(loaded.f_W_N, recording.f_W_N)
    np.savez(tmp_path / "lacking.npz", **(old | {"format_version": 2}))
    with pytest.raises(RecordingError, match="began"):
        Recording.load(tmp_path / "lacking.npz")


def test_csv_export_and_import_are_inverse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.render.recording._CSV_ROWS", 3)
    recording = make_recording()
    make_recording(0).save_csv(tmp_path / "empty.csv")
    assert (tmp_path / "empty.csv").read_text().startswith("t_s,p_WT_x_m")
    recording.save_csv(tmp_path / "touch.csv")
    with (tmp_path / "touch.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 7

    def column(*names: str) -> np.ndarray:
        return np.array([[float(row[name]) for name in names] for row in rows])

    close = {"rtol": 1e-8, "atol": 0}
    np.testing.assert_allclose(column("t_s")[:, 0], recording.t_s, **close)
    np.testing.assert_allclose(column("p_WT_x_m", "p_WT_y_m", "p_WT_z_m"), recording.p_WT_m, **close)
    np.testing.assert_allclose(column("nhat_W_x", "nhat_W_y", "nhat_W_z"), recording.nhat_W, **close)
    np.testing.assert_allclose(column("f_W_x_N", "f_W_y_N", "f_W_z_N"), recording.f_W_N, **close)
    np.testing.assert_allclose(column("a0_m_s2", "a1_m_s2", "a2_m_s2"), recording.a_m_s2, **close)
    assert {row["a_rate_Hz"] for row in rows} == {"3000"}
    assert [row["flags"] for row in rows] == [str(flag) for flag in range(7)]
    assert [row["body"] for row in rows[:3]] == ["", "plate, large", "ball"]
    assert [row["swatch"] for row in rows[:3]] == ["", "plain", 'oak "A"']
    assert [row["touching"] for row in rows[:3]] == ["0", "1", "1"]


def test_acceleration_has_its_own_times() -> None:
    recording = make_recording(count=2, block=3)
    np.testing.assert_allclose(recording.a_t_s, np.arange(6) / 3000.0, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"depth_m": np.zeros(6)}, "depth_m"),
        ({"p_WT_m": np.zeros((7, 2))}, "p_WT_m"),
        ({"a_m_s2": np.zeros(7)}, "a_m_s2"),
        ({"swatch": np.array([0, 2, 1, 0, 0, 0, 0])}, "swatch"),
        ({"body": np.array([0, -2, 1, 0, 0, 0, 0])}, "body"),
    ],
)
def test_inconsistent_arrays_are_rejected(change: dict[str, np.ndarray], field: str) -> None:
    with pytest.raises(RecordingError, match=field):
        replace(make_recording(), **change)


def _rewrite(path: Path, name: str, array: np.ndarray | None) -> None:
    """Replace or remove one array of the archive."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = dict(archive)
    arrays.pop(name)
    if array is not None:
        arrays[name] = array
    np.savez(path, **arrays)


def _forge_header(path: Path) -> None:
    """Make t_s claim 10^15 numbers."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = dict(archive)
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            stream = io.BytesIO()
            np.lib.format.write_array(stream, array)
            content = stream.getvalue()
            if name == "t_s":
                content = content.replace(b"(7,), }         ", b"(7" + b"0" * 9 + b",), }")
            archive.writestr(f"{name}.npy", content)


def _pack(path: Path) -> None:
    """Make a file that decompresses to a thousand times its size."""
    with np.load(path, allow_pickle=False) as archive:
        np.savez_compressed(path, **dict(archive) | {"t_s": np.zeros(10_000_000)})


SPOILERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: path.unlink(), ""),
    "text": (lambda path: path.write_text("t,x,y,z\n"), ""),
    "truncated": (lambda path: path.write_bytes(path.read_bytes()[:3000]), ""),
    "bit": (lambda path: path.write_bytes(path.read_bytes().replace(b"NUMPY", b"NUMPX", 3)), ""),
    "folder": (lambda path: (path.unlink(), path.mkdir()), ""),
    "later": (lambda path: _rewrite(path, "format_version", np.array(99)), "version 99"),
    "lacking": (lambda path: _rewrite(path, "f_W_N", None), "f_W_N"),
    "pickled": (lambda path: _rewrite(path, "t_s", np.array([{}] * 7)), "t_s"),
    "flat": (lambda path: _rewrite(path, "p_WT_m", np.zeros(21)), "p_WT_m"),
    "short": (lambda path: _rewrite(path, "depth_m", np.zeros(5)), "depth_m"),
    "words": (lambda path: _rewrite(path, "depth_m", np.array(["a"] * 7)), "depth_m"),
    "packed": (_pack, "80,"),
    "small": (lambda path: _rewrite(path, "tick_ns", np.zeros(60_000_000, np.int8)), "MB"),
    "nameless": (lambda path: _rewrite(path, "effects", np.ndarray((1 << 26,), "U0")), ""),
    "forged": (_forge_header, "t_s"),
}


@pytest.mark.parametrize("name", SPOILERS)
def test_an_invalid_file_is_one_line_that_names_the_file_and_the_column(tmp_path: Path, name: str) -> None:
    path = tmp_path / "touch.npz"
    make_recording().save(path)
    spoil, place = SPOILERS[name]
    spoil(path)
    with pytest.raises(RecordingError) as caught:
        Recording.load(path)
    assert "touch.npz" in str(caught.value) and place in str(caught.value) and "\n" not in str(caught.value)


def test_huge_archive_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_recording().save(tmp_path / "touch.npz")
    monkeypatch.setattr("hapscene.render.recording.BYTES_MAX", 1000)
    with pytest.raises(RecordingError, match="touch"):
        Recording.load(tmp_path / "touch.npz")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_named_pipe_is_rejected(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "touch.npz")
    with pytest.raises(RecordingError, match="touch"):
        Recording.load(tmp_path / "touch.npz")
