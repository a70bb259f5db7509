"""Atomic writes by processes that are killed."""

import subprocess
import sys
import time
from pathlib import Path
from random import Random

import pytest

from tests.io.test_files import write_next

WRITER = """
import pathlib, sys, time
from hapscene.io.files import whole_file, whole_folder
place, kind = pathlib.Path(sys.argv[1]), sys.argv[2]
print("ready", flush=True)
while True:
    with (whole_file(place / "a.txt") if kind == "file" else whole_folder(place / "a")) as part:
        target = part if kind == "file" else part / "b.txt"
        target.write_text("x" * 1000)
        time.sleep(0.001)
"""


POSIX = pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")


def writer(place: Path, kind: str) -> "subprocess.Popen[str]":
    words = [sys.executable, "-c", WRITER, str(place), kind]
    process = subprocess.Popen(words, text=True, stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


@pytest.mark.soak
@POSIX
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_writers_killed_at_random_times(tmp_path: Path, kind: str) -> None:
    random = Random(0)
    for _ in range(30):
        with writer(tmp_path, kind) as process, writer(tmp_path, kind) as beside:
            time.sleep(random.uniform(0.0, 0.2))
            process.kill()
            process.wait()
            write_next(tmp_path)
            beside.kill()
        names = {file.name for file in tmp_path.iterdir() if not file.name.startswith(".a")}
        assert names <= {"a.txt", "a", "other.txt"}
        for file in (tmp_path / "a.txt", tmp_path / "a" / "b.txt"):
            assert not file.exists() or file.read_text() == "x" * 1000
