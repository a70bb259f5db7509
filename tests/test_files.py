"""Files that appear whole or not at all."""

import stat
import sys
from pathlib import Path

import pytest

from hapscene.errors import ViewError
from hapscene.files import check_file, memory_left_B, whole_file, whole_folder


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


@pytest.mark.skipif(sys.platform == "win32", reason="no such permissions there")
def test_permissions_of_what_is_replaced_stay(tmp_path: Path) -> None:
    for name in ("file", "out/file", "usual"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("old")
    (tmp_path / "file").chmod(0o640)
    (tmp_path / "out" / "file").chmod(0o600)
    with whole_file(tmp_path / "file") as part:
        part.write_text("new")
    with whole_folder(tmp_path / "out") as folder:
        for name in ("file", "usual"):
            (folder / name).write_text("new")

    def mode(name: str) -> int:
        return stat.S_IMODE((tmp_path / name).stat().st_mode)

    assert (mode("file"), mode("out/file")) == (0o640, 0o600) and mode("out/usual") == mode("usual")
    assert (tmp_path / "file").read_text() == (tmp_path / "out" / "file").read_text() == "new"


def test_a_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "theirs").write_text("old")
    (tmp_path / "theirs").chmod(0o600)
    (tmp_path / "usual").touch()
    (tmp_path / "link").symlink_to("theirs")
    with whole_file(tmp_path / "link") as part:
        part.write_text("new")
    assert (tmp_path / "theirs").read_text() == "old" and not (tmp_path / "link").is_symlink()
    assert (tmp_path / "link").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_place_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_file(tmp_path / "new", ViewError)
    with pytest.raises(ViewError, match=r"none/x\.png: cannot be written: there is no folder"):
        check_file(tmp_path / "none" / "x.png", ViewError)
    with pytest.raises(ViewError, match="is a folder"):
        check_file(tmp_path, ViewError)
    monkeypatch.setattr("os.access", lambda path, kind: False)  # the superuser may write anywhere
    with pytest.raises(ViewError, match="nothing may be written into"):
        check_file(tmp_path / "new", ViewError)


def test_where_a_link_is_counts_and_not_where_it_leads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is replaced, not followed."""
    for name in ("mine", "theirs"):
        (tmp_path / name).mkdir()
    (tmp_path / "theirs" / "a.png").touch()
    (tmp_path / "mine" / "a.png").symlink_to(tmp_path / "theirs" / "a.png")
    (tmp_path / "theirs" / "b.png").symlink_to(tmp_path / "mine" / "b.png")
    monkeypatch.setattr("os.access", lambda where, kind: Path(where).name != "theirs")
    check_file(tmp_path / "mine" / "a.png", ViewError)
    with pytest.raises(ViewError, match="nothing may be written into"):
        check_file(tmp_path / "theirs" / "b.png", ViewError)


def test_what_cannot_be_written_is_said_of_what_was_asked_for(tmp_path: Path) -> None:
    for place, writing in ((tmp_path / "none" / "a.txt", whole_file), (Path("/proc/a"), whole_folder)):
        if place.parent.name == "proc" and not place.parent.is_dir():
            continue
        with pytest.raises(OSError) as caught, writing(place):
            pass
        assert caught.value.filename == str(place)


def test_memory_that_is_left_is_within_what_is_allowed() -> None:
    resource = pytest.importorskip("resource")
    before = memory_left_B()
    assert before > 0.0
    allowed = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 40, allowed[1]))
        assert memory_left_B() <= min(before, 1 << 40) * 1.5
    finally:
        resource.setrlimit(resource.RLIMIT_AS, allowed)
