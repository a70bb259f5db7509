"""`hapscene paint` as a process."""

import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
from hapscene.paint.model.document import find_recovery
from tests.cli.test_paint import folder

__all__ = ["folder"]  # fixtures

ENDS = [signal.SIGINT, *(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))]


@contextmanager
def served(folder: Path, *command: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A painter of the cube in a process, and its address."""
    words = [*command, "paint", "cube.ply", "--unit", "m", "--port", "0", "--no-browser"]
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, *words], text=True, cwd=folder, start_new_session=True, **pipes) as process:
        try:
            assert process.stdout is not None
            end_s = time.monotonic() + 120.0
            while "http://127.0.0.1:" not in (line := process.stdout.readline()):
                assert line and time.monotonic() < end_s
            yield process, line.split()[0]
        finally:
            process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is no signal there")
@pytest.mark.parametrize("kind", ENDS)
def test_signals_end_the_painter_without_files(folder: Path, kind: signal.Signals) -> None:
    with served(folder, "-m", "hapscene") as (process, url):
        with urllib.request.urlopen(url, timeout=60.0) as answer:
            assert b"/hapscene.js" in answer.read()
        os.killpg(process.pid, kind)  # as a terminal, a service manager and `timeout` do; the hand may still start
        assert process.wait(120.0) == 0
        assert process.stderr is not None and process.stderr.read() == ""
        assert process.stdout is not None
        assert "cube.scene.json was not written" in process.stdout.read()
    assert sorted(path.name for path in folder.iterdir()) == ["cube.ply"]


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is no signal there")
def test_unsaved_changes_are_kept(folder: Path) -> None:
    (folder / "painter.py").write_text(
        "import sys\n"
        "from hapscene.cli import main\n"
        "from hapscene.paint import opening\n"
        "def painted(*arguments, opened=opening.open_session, **more):\n"
        "    session = opened(*arguments, **more)\n"
        "    session.fill_body(0, session.add_swatch('wood'))\n"
        "    return session\n"
        "if __name__ == '__main__':\n"
        "    opening.open_session = painted\n"
        "    sys.exit(main([*sys.argv[1:], '--no-hand']))\n"
    )
    with served(folder, "painter.py") as (process, _):
        process.send_signal(signal.SIGTERM)
        output, complained = process.communicate(timeout=120.0)
    assert process.returncode == 0 and complained == "" and "offers to restore" in output
    kept = find_recovery(folder / "cube.scene.json")
    assert kept is not None and [s.name for s in kept.load().swatches][1:] == ["wood"]
