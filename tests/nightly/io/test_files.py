"""Atomic writes by processes that are killed."""

import subprocess
import sys
import time
from pathlib import Path
from random import Random

import pytest

from hapscene.io import files
from tests.io.test_files import write_next

WRITER = """
import os, pathlib, signal, sys, time
from hapscene.io.files import whole_file, whole_folder
place, kind, wait_s, end = pathlib.Path(sys.argv[1]), sys.argv[2], float(sys.argv[3]), sys.argv[4]
print("ready", flush=True)
while True:
    with (whole_file(place / "a.txt") if kind == "file" else whole_folder(place / "a")) as part:
        target = part if kind == "file" else part / "b.txt"
        target.write_text("x" * 1000)
        if end == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if end == "open":
            print("open", flush=True)
            sys.stdin.read()
        time.sleep(wait_s)
"""


POSIX = pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")


def writer(place: Path, kind: str, wait_s: float, end: str = "") -> "subprocess.Popen[str]":
    words = [sys.executable, "-c", WRITER, str(place), kind, str(wait_s), end]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    process: subprocess.Popen[str] = subprocess.Popen(words, text=True, **pipes)  # type: ignore[call-overload]
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


@POSIX
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_temporary_files_of_killed_processes_are_removed(tmp_path: Path, kind: str) -> None:
    with writer(tmp_path, kind, 0.0, "killed") as process:
        process.wait()
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".a") and ".hapscene-" in left.name
    for name in (".a.txt.swp", f".theirs{left.name}", ".a.txt.hapscene-notes.txt"):
        (tmp_path / name).write_text("theirs")
    (tmp_path / ".link.hapscene-0123456789abcdef").symlink_to(tmp_path / ".a.txt.swp")
    (tmp_path / f".theirs{left.name}").rename(tmp_path / f"theirs{left.name}")
    write_next(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        *(".a.txt.swp", f"theirs{left.name}", ".a.txt.hapscene-notes.txt", "other.txt"),
        ".link.hapscene-0123456789abcdef",
    }


@POSIX
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_files_in_use_are_kept(tmp_path: Path, kind: str) -> None:
    with writer(tmp_path, kind, 0.0, "open") as process:
        assert process.stdout is not None and process.stdout.readline() == "open\n"
        (part,) = tmp_path.iterdir()
        write_next(tmp_path)
        assert part.exists()
        process.kill()
        process.wait()
    write_next(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["other.txt"]


@pytest.mark.soak
@POSIX
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_writers_killed_at_random_times(tmp_path: Path, kind: str) -> None:
    random = Random(0)
    for _ in range(30):
        with writer(tmp_path, kind, 0.001) as process, writer(tmp_path, kind, 0.001) as beside:
            time.sleep(random.uniform(0.0, 0.2))
            process.kill()
            process.wait()
            write_next(tmp_path)
            beside.kill()
        files._tidy.cache_clear()
        write_next(tmp_path)
        names = {file.name for file in tmp_path.iterdir()}
        assert names <= {"a.txt", "a", "other.txt"}
        for file in (tmp_path / "a.txt", tmp_path / "a" / "b.txt"):
            assert not file.exists() or file.read_text() == "x" * 1000
