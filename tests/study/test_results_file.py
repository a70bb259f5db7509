"""The results file: plain CSV, incomplete rows, one writer at a time."""

import csv
import io
from pathlib import Path

import pytest
from filelock import FileLock

from hapscene.errors import StudyError
from hapscene.study.session import COLUMNS, ResultsFile, load_rows

ROW = {"person": "P01", "trial": 0, "block": "real", "choice": 'so, "so"', "rating": None, "level": 0.5}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = ResultsFile(tmp_path / "results.csv")
    for trial in range(3):
        file.add(ROW | {"trial": trial})
    file.close()
    return tmp_path / "results.csv"


def test_format_is_rfc_4180(path: Path) -> None:
    """CR LF line ends, a plain header, equal numbers of fields, doubled quotes, UTF-8 without a byte order mark."""
    content = path.read_bytes()
    assert content.decode("utf-8") and not content.startswith(b"\xef\xbb\xbf")
    assert content.count(b"\r\n") == content.count(b"\n") == 4 and content.endswith(b"\r\n")
    lines = list(csv.reader(io.StringIO(content.decode(), newline=""), strict=True))
    assert lines[0] == list(COLUMNS) and all(name.isidentifier() and name.isascii() for name in COLUMNS)
    assert {len(line) for line in lines} == {len(COLUMNS)}
    assert b'"so, ""so"""' in content and load_rows(path)[1]["choice"] == 'so, "so"'


def test_an_incomplete_last_row_is_removed(path: Path) -> None:
    content = path.read_bytes()
    last = content.rstrip().rindex(b"\n") + 1
    for end in range(last, len(content)):
        path.write_bytes(content[:end])
        file = ResultsFile(path)
        file.add(ROW | {"trial": 2})
        file.close()
        assert [row["trial"] for row in file.rows] == ["0", "1"]
        assert path.read_bytes() == content


def test_an_incomplete_header_is_replaced(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:20])
    ResultsFile(path).close()
    assert path.read_bytes() == ",".join(COLUMNS).encode() + b"\r\n"


def test_reading_warns_of_an_incomplete_row(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.warns(UserWarning):
        assert len(load_rows(path)) == 2


def test_there_is_one_writer_at_a_time(path: Path) -> None:
    file = ResultsFile(path)
    with pytest.raises(StudyError, match=r"results\.csv"):
        ResultsFile(path)
    assert len(load_rows(path)) == 3
    file.close()
    ResultsFile(path).close()
    with pytest.raises(ValueError, match="closed"):
        file.add(ROW)


@pytest.mark.parametrize(
    "content",
    [b"my own notes", b"x" * 200_000, b"a,b\r\n1,2\r\n", b"\xff\xfe\r\n", ",".join(COLUMNS).encode() + b"\r\n1,2\r\n3"],
)
def test_another_file_is_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    kept: list[object] = []  # an error that is kept does not keep the lock
    for read in (load_rows, ResultsFile):
        with pytest.raises(StudyError, match=r"results\.csv") as caught:
            read(path)
        kept.append(caught)
    assert path.read_bytes() == content
    with pytest.raises(StudyError, match="cannot be written") as caught:
        ResultsFile(path.parent)
    for file in (path, path.parent):
        FileLock(f"{file}.lock").acquire(blocking=False).lock.release()


def test_no_part_of_a_row_that_could_not_be_written_remains(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, file = path.read_bytes(), ResultsFile(path)

    def refuse(file: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", refuse)
        with pytest.raises(StudyError, match="No space left"):
            file.add(ROW)
    assert path.read_bytes() == before
    file.add(ROW | {"trial": 3})
    file.close()
    assert [row["trial"] for row in load_rows(path)] == ["0", "1", "2", "3"]
