"""Files that appear whole or not at all."""

import errno
import os
import stat
import sys
from pathlib import Path
from typing import Any

import pytest

from hapscene.errors import ViewError
from hapscene.io import files
from hapscene.io.files import check_file, whole_file, whole_folder


def test_broken_writer_leaves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / "a.txt") as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.txt", "old")]


def test_broken_folder_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "deep" / "deeper" / "out") as folder:
        (folder / "a.txt").write_text("half")
        raise KeyboardInterrupt
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
    with pytest.raises(NotADirectoryError), whole_folder(tmp_path / "out"):
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
    for place in (tmp_path / "none" / "x.png", tmp_path):
        with pytest.raises(ViewError):
            check_file(place, ViewError)
    monkeypatch.setattr("os.access", lambda path, kind: False)  # the superuser may write anywhere
    with pytest.raises(ViewError):
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
    with pytest.raises(ViewError):
        check_file(tmp_path / "theirs" / "b.png", ViewError)


def test_what_cannot_be_written_is_said_of_what_was_asked_for(tmp_path: Path) -> None:
    for place, writing in ((tmp_path / "none" / "a.txt", whole_file), (Path("/proc/a"), whole_folder)):
        if place.parent.name == "proc" and not place.parent.is_dir():
            continue
        with pytest.raises(OSError) as caught, writing(place):
            pass
        assert caught.value.filename == str(place)


# What is left of writers that were killed.


POSIX = pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")


def write_next(place: Path) -> None:
    """As a new process."""
    files._tidy.cache_clear()
    with whole_file(place / "other.txt") as part:
        part.write_text("other")


def test_what_is_tidied_before_it_is_locked_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lock, taken = files._open_locked, []

    def tidied_first(part: Path, wait: bool = True) -> int | None:
        if not taken:
            taken.append(part)
            part.unlink()
        return lock(part, wait)

    monkeypatch.setattr(files, "_open_locked", tidied_first)
    with whole_file(tmp_path / "a.txt") as part:
        assert part.exists()
        part.write_text("new")
    assert taken and [file.name for file in tmp_path.iterdir()] == ["a.txt"]


def test_where_nothing_can_be_locked_age_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_open_locked", lambda part, wait=True: None)
    names = [f".a.hapscene-{k:016x}" for k in range(2)]
    for name in names:
        (tmp_path / name).write_text("half")
    os.utime(tmp_path / names[0], times=(0, 0))
    write_next(tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == [names[1], "other.txt"]


@POSIX
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_signal_at_any_moment_leaves_nothing(tmp_path: Path, kind: str) -> None:
    """The moments: each line of what makes it; between lines signals are heard."""
    write = whole_file if kind == "file" else whole_folder
    code = {function.__wrapped__.__code__ for function in (whole_file, whole_folder)}  # type: ignore[attr-defined]
    code |= {files._make.__code__, files._open_locked.__code__}
    moment = -1
    while True:
        moment += 1
        seen = 0

        def interrupt(frame: Any, event: str, argument: object, last: int = moment) -> Any:
            nonlocal seen
            if frame.f_code in code and event == "line":
                seen += 1
                if seen > last:
                    sys.settrace(None)
                    raise KeyboardInterrupt
            return interrupt

        place = tmp_path / f"{moment}" / "deep"
        place.parent.mkdir()
        if kind == "file":
            place.mkdir()
        sys.settrace(interrupt)
        try:
            with write(place / "a") as part:
                sys.settrace(None)
        except KeyboardInterrupt:
            assert [file.name for file in place.parent.rglob("*")] == (["deep"] if kind == "file" else [])
            continue
        finally:
            sys.settrace(None)
        assert moment > 10 and part.name.startswith(".a.hapscene-")
        return


@pytest.mark.parametrize("whole", [whole_file, whole_folder])
@pytest.mark.parametrize("named", [False, True])
def test_what_has_no_room_is_said_of_the_file_that_was_meant(tmp_path: Path, whole: Any, named: bool) -> None:
    with pytest.raises(OSError) as caught, whole(tmp_path / "a.out") as part:
        raise OSError(errno.ENOSPC, "No room", *([str(part)] if named else []))
    assert caught.value.filename == str(tmp_path / "a.out")


def test_another_fault_within_keeps_its_words(tmp_path: Path) -> None:
    with pytest.raises(TimeoutError) as caught, whole_file(tmp_path / "a.out"):
        raise TimeoutError(errno.ETIMEDOUT, "the port is silent")
    assert caught.value.filename is None
