"""Atomic writes of files and folders."""

import errno
import io
import os
import stat
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from hapscene.errors import FormatError, ViewError
from hapscene.io import files
from hapscene.io.files import check_file, whole_file, whole_folder


def test_failed_write_preserves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / "a.txt") as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.txt", "old")]


def test_failed_folder_is_removed(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "deep" / "deeper" / "out") as folder:
        (folder / "a.txt").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_other_files_in_a_folder_are_kept(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in ("a.txt", "stale.txt", "kept.txt"):
        (out / name).write_text("old")
    with whole_folder(out, ours=("a.txt", "stale.txt")) as folder:
        (folder / "a.txt").write_text("new")
        assert (out / "a.txt").read_text() == "old"
    assert {file.name: file.read_text() for file in out.iterdir()} == {"a.txt": "new", "kept.txt": "old"}
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_folder_permissions(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "out") as folder:
        (folder / "a.txt").write_text("new")
    (tmp_path / "usual").mkdir()
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_file_instead_of_folder_raises(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(NotADirectoryError), whole_folder(tmp_path / "out"):
        pass
    assert (tmp_path / "out").read_text() == "a file"


@pytest.mark.skipif(sys.platform == "win32", reason="not on Windows")
def test_permissions_are_inherited(tmp_path: Path) -> None:
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


def test_symbolic_link_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("old")
    (tmp_path / "other").chmod(0o600)
    (tmp_path / "usual").touch()
    (tmp_path / "link").symlink_to("other")
    with whole_file(tmp_path / "link") as part:
        part.write_text("new")
    assert (tmp_path / "other").read_text() == "old" and not (tmp_path / "link").is_symlink()
    assert (tmp_path / "link").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_check_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_file(tmp_path / "new", ViewError)
    for place in (tmp_path / "none" / "x.png", tmp_path):
        with pytest.raises(ViewError):
            check_file(place, ViewError)
    monkeypatch.setattr("os.access", lambda path, kind: False)  # the superuser may write anywhere
    with pytest.raises(ViewError):
        check_file(tmp_path / "new", ViewError)


def test_check_file_does_not_follow_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("mine", "other"):
        (tmp_path / name).mkdir()
    (tmp_path / "other" / "a.png").touch()
    (tmp_path / "mine" / "a.png").symlink_to(tmp_path / "other" / "a.png")
    (tmp_path / "other" / "b.png").symlink_to(tmp_path / "mine" / "b.png")
    monkeypatch.setattr("os.access", lambda where, kind: Path(where).name != "other")
    check_file(tmp_path / "mine" / "a.png", ViewError)
    with pytest.raises(ViewError):
        check_file(tmp_path / "other" / "b.png", ViewError)


def test_error_names_the_requested_path(tmp_path: Path) -> None:
    for place, writing in ((tmp_path / "none" / "a.txt", whole_file), (Path("/proc/a"), whole_folder)):
        if place.parent.name == "proc" and not place.parent.is_dir():
            continue
        with pytest.raises(OSError) as caught, writing(place):
            pass
        assert caught.value.filename == str(place) and files.FULL_HINT not in str(caught.value)


def test_the_directory_of_an_archive_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("a.txt", b"content")
        archive.comment = b"a comment"
    size_B = len(packed.getvalue()) - packed.getvalue().rindex(b"PK\x01\x02") - 22 - len(archive.comment)
    for limit_B in (size_B, size_B - 1):
        monkeypatch.setattr(files, "LISTING_MAX_B", limit_B)
        if limit_B == size_B:
            assert files.open_zip(packed, 1000, "").read("a.txt") == b"content"
            continue
        with pytest.raises(FormatError, match="directory"):
            files.open_zip(packed, 1000, "")


def test_limits_and_short_values() -> None:
    limits = [files.unpacked_most_B(packed_B, 20_000_000) for packed_B in (1, 100_000, 10**9)]
    assert limits == [5_000_000, 10_000_000, 20_000_000]
    texts = [files.short(value) for value in ("a\n", 0.5, None, [1], "x" * 90)]
    assert texts == [repr("a\n"), "0.5", "None", "list", "'" + "x" * 56 + "…"]
    for number, words in ((3, "later than 2"), (0, "from 1 to 2"), (1.0, "not 1.0"), ("true", "not True")):
        with pytest.raises(FormatError, match=words):
            files.parse_format(f'{{"format": "swatch", "version": {number}}}', "a swatch", "swatch", 2)


# Temporary files of processes that were killed.


POSIX = pytest.mark.skipif(sys.platform == "win32", reason="not on Windows")


def write_next(place: Path) -> None:
    """Write a file as a new process would."""
    files._tidy.cache_clear()
    with whole_file(place / "other.txt") as part:
        part.write_text("other")


def test_old_temporary_files_are_removed(tmp_path: Path) -> None:
    new, old, folder = (f".a.hapscene-{k:016x}" for k in range(3))
    theirs = (".a.txt.swp", f"theirs{old}", ".a.txt.hapscene-notes.txt")
    for name in (new, old, *theirs):
        (tmp_path / name).write_text("half")
    (tmp_path / folder).mkdir()
    for name in (old, folder, *theirs):
        os.utime(tmp_path / name, times=(0, 0))
    write_next(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {new, "other.txt", *theirs}


@POSIX
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_interrupt_at_any_line_leaves_no_files(tmp_path: Path, kind: str) -> None:
    """Interrupt at each line of the functions that create the temporary file."""
    write = whole_file if kind == "file" else whole_folder
    code = {function.__wrapped__.__code__ for function in (whole_file, whole_folder)}  # type: ignore[attr-defined]
    code.add(files._errors_name.__wrapped__.__code__)  # type: ignore[attr-defined]
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
        assert moment > 4 and part.name.startswith(".a.hapscene-")
        return


@pytest.mark.parametrize("whole", [whole_file, whole_folder])
@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("hint", ["", files.FULL_HINT])
def test_disk_full_error_names_the_requested_path(tmp_path: Path, whole: Any, named: bool, hint: str) -> None:
    with pytest.raises(OSError) as caught, whole(tmp_path / "a.out") as part:
        raise OSError(errno.ENOSPC, f"No room{hint}", *([str(part)] if named else []))
    assert caught.value.filename == str(tmp_path / "a.out") and str(caught.value).count(files.FULL_HINT) == 1
    assert str(part) not in str(caught.value)


def test_other_errors_are_unchanged(tmp_path: Path) -> None:
    with pytest.raises(TimeoutError) as caught, whole_file(tmp_path / "a.out"):
        raise TimeoutError(errno.ETIMEDOUT, "the port is silent")
    assert caught.value.filename is None
