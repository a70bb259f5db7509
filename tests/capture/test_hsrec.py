"""Record files: complete, truncated, damaged and invalid ones."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.capture import load_recording
from hapscene.capture.io.hsrec import RecordWriter, TruncatedWarning, load_record
from hapscene.errors import CaptureError
from hapscene.io.probe_protocol import Column, Header, Run

HEADER = Header(1000.0, (Column("acceleration", "g", 0.5), Column("force", "N", 1.0)))


def rows(start: int, stop: int) -> Run:
    n = np.arange(start, stop)
    return Run(start, np.stack([n, -n], axis=1))


def write(path: Path, end: bool = True) -> bytes:
    """Samples 0 to 29 and 40 to 49, in chunks of 10."""
    with RecordWriter(path, HEADER) as writer:
        for start in (0, 10, 20, 40):
            writer.write(rows(start, start + 10))
        if end:
            writer.end("stopped", dropped=10)
    return path.read_bytes()


def test_a_record_is_read_back_with_its_gap(tmp_path: Path) -> None:
    write(tmp_path / "a.hsrec")
    record = load_record(tmp_path / "a.hsrec")
    assert record.rate_Hz == 1000.0 and record.units == {"acceleration": "g", "force": "N"}
    assert record.ended == "stopped"
    assert np.flatnonzero(record.missing).tolist() == list(range(30, 40))
    there = ~record.missing
    assert (record.streams["acceleration"][there] == 0.5 * np.flatnonzero(there)).all()
    assert (record.streams["force"][there] == -np.flatnonzero(there)).all()


def test_long_runs_are_split_and_joined_again(tmp_path: Path) -> None:
    with RecordWriter(tmp_path / "a.hsrec", HEADER) as writer:
        writer.write(rows(0, 10_000))
    assert (load_record(tmp_path / "a.hsrec").streams["force"] == -np.arange(10_000)).all()


def test_complete_chunks_of_a_truncated_record_are_read(tmp_path: Path) -> None:
    data = write(tmp_path / "a.hsrec")
    cut = tmp_path / "cut.hsrec"
    lengths = []
    for size in [*range(0, len(data), 4), len(data) - 1]:
        cut.write_bytes(data[:size])
        try:
            record = load_record(cut)
        except CaptureError:
            lengths.append(0)
            continue
        assert record.ended is None
        there = np.flatnonzero(~record.missing)
        assert (record.streams["force"][there] == -there).all()
        lengths.append(len(record.missing))
    assert lengths == sorted(lengths) and sorted(set(lengths)) == [0, 10, 20, 30, 50]


def test_a_truncated_record_gives_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "cut.hsrec"
    with RecordWriter(path, HEADER) as writer:
        writer.write(rows(0, 100))
    with pytest.warns(TruncatedWarning, match="100 samples"):
        assert len(load_recording(path).acceleration_m_s2) == 100


def test_a_flipped_bit_never_gives_wrong_samples(tmp_path: Path) -> None:
    data = write(tmp_path / "a.hsrec")
    broken = tmp_path / "broken.hsrec"
    for at in range(0, len(data), 7):
        broken.write_bytes(data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :])
        try:
            record = load_record(broken)
        except CaptureError:
            continue
        there = np.flatnonzero(~record.missing)
        assert (record.streams["force"][there] == -there).all() and record.ended is None


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a probe record"),
        (b"RIFF", "not a probe record"),
        (b"hapscene record 2\n", "later version"),
        (b"hapscene record 1\n", "within its header"),
    ],
)
def test_invalid_files_are_refused(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "a.hsrec").write_bytes(data)
    with pytest.raises(CaptureError, match=f"a.hsrec: .*{message}"):
        load_record(tmp_path / "a.hsrec")


def test_an_invalid_record_needs_little_memory(tmp_path: Path) -> None:
    with RecordWriter(tmp_path / "a.hsrec", HEADER) as writer:
        writer.write(Run(1 << 60, np.zeros((1, 2), dtype=np.int64)))
    with pytest.raises(CaptureError, match="exceed"):
        load_record(tmp_path / "a.hsrec")
    with RecordWriter(tmp_path / "b.hsrec", Header(float("nan"), HEADER.columns)) as writer:
        writer.write(rows(0, 5))
    with pytest.raises(CaptureError, match="invalid sample rate"):
        load_record(tmp_path / "b.hsrec")


def test_existing_files_are_not_overwritten(tmp_path: Path) -> None:
    write(tmp_path / "a.hsrec")
    with pytest.raises(CaptureError, match=r"a\.hsrec: "):
        RecordWriter(tmp_path / "a.hsrec", HEADER)
    with pytest.raises(CaptureError, match=r"expected \.hsrec"):
        RecordWriter(tmp_path / "a.npz", HEADER)
    with pytest.raises(CaptureError, match=r"missing/a\.hsrec: cannot be written"):
        RecordWriter(tmp_path / "missing" / "a.hsrec", HEADER)


def test_a_full_disk_is_reported_and_earlier_samples_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    with RecordWriter(tmp_path / "a.hsrec", HEADER) as writer:
        writer.write(rows(0, 10))
        writer.sync()
        monkeypatch.setattr("os.fsync", full)
        with pytest.raises(CaptureError, match="No space left"):
            writer.sync()
    assert len(load_record(tmp_path / "a.hsrec").missing) == 10


def test_a_record_without_samples_is_refused(tmp_path: Path) -> None:
    with RecordWriter(tmp_path / "a.hsrec", HEADER) as writer:
        writer.end("stopped")
    with pytest.raises(CaptureError, match="no samples"):
        load_record(tmp_path / "a.hsrec")
