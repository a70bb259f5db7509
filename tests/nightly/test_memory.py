"""A note reports a memory limit that is too low."""

import subprocess
import sys

import pytest


def test_low_memory_limit_is_reported() -> None:
    resource = pytest.importorskip("resource", reason="this platform has no limits of processes")
    code = "import sys; from hapscene.cli import main; sys.exit(main(['check', 'none.stl']))"

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (300 << 20, 300 << 20))

    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, preexec_fn=limit, encoding="utf-8"
    )
    note, error = done.stderr.splitlines()
    assert note.startswith("hapscene: note: the memory limit of this process is 300 MiB; touching a small scene takes")
    assert error == "hapscene: none.stl: no such file"
