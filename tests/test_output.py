"""Files that appear whole or not at all."""

from pathlib import Path

import pytest

from hapscene.output import whole_file, whole_folder


class Broken(Exception):
    """What a failing writer raises here."""


def test_file_appears_at_the_end(tmp_path: Path) -> None:
    with whole_file(tmp_path / "a.txt") as part:
        part.write_text("new")
        assert not (tmp_path / "a.txt").exists()
    assert (tmp_path / "a.txt").read_text() == "new"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("error", [Broken, KeyboardInterrupt])
def test_broken_writer_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(error), whole_file(tmp_path / "a.txt") as part:
        part.write_text("half")
        raise error
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.txt", "old")]


@pytest.mark.parametrize("error", [Broken, KeyboardInterrupt])
def test_broken_folder_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), whole_folder(tmp_path / "deep" / "deeper" / "out") as folder:
        (folder / "a.txt").write_text("half")
        raise error
    assert list(tmp_path.iterdir()) == []


def test_folder_with_others_files_keeps_them(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in ("a.txt", "stale.txt", "yours.txt"):
        (out / name).write_text("old")
    with whole_folder(out, ours=("a.txt", "stale.txt")) as folder:
        (folder / "a.txt").write_text("new")
        assert (out / "a.txt").read_text() == "old"
    assert {file.name: file.read_text() for file in out.iterdir()} == {"a.txt": "new", "yours.txt": "old"}
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_folder_is_readable_as_any_other(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "out") as folder:
        (folder / "a.txt").write_text("new")
    (tmp_path / "usual").mkdir()
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(NotADirectoryError, match="expected a folder"), whole_folder(tmp_path / "out"):
        pass
    assert (tmp_path / "out").read_text() == "a file"
