"""Frames without a screen."""

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hapscene.view.triangles import Drawing
from tests.view.test_offscreen import drawing, environment

__all__ = ["drawing", "environment"]  # fixtures


ALONE = """
import ctypes, sys
load = ctypes.CDLL.__init__
def refuse(self, name, *rest, **more):
    if name and any(lib in str(name) for lib in ("libGL.", "libGLX", "libEGL", "libX11")):
        raise OSError(f"{name}: not installed")
    load(self, name, *rest, **more)
ctypes.CDLL.__init__ = refuse
from hapscene.view.triangles import Drawing
from hapscene.view.gl import render
from pathlib import Path
print(sum(frame.std() > 10 for frame in render(Drawing.load(Path(sys.argv[1])))), "pyglet" in sys.modules)
"""


def test_osmesa_needs_no_other_library(tmp_path: Path, drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    from ctypes.util import find_library

    if find_library("OSMesa") is None:
        pytest.skip("libosmesa6 is not installed")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    drawing.save(tmp_path / "job.npz")
    done = subprocess.run(
        [sys.executable, "-c", ALONE, tmp_path / "job.npz"], capture_output=True, text=True, timeout=120.0
    )
    assert done.stdout.split() == ["3", "False"], done.stderr[-500:]


APPLICATION = """
import os
from hapscene.interrupt import interrupted_by_ends
from hapscene.view.offscreen import start_drawer, job_folder
with interrupted_by_ends(), job_folder() as job:
    (job / "stage.npz").touch()
    with start_drawer("drawer", job, os.environ) as drawer:
        drawer.process.wait()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no process can send these signals there")
@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
def test_it_goes_with_the_one_that_started_it(
    tmp_path: Path,
    environment: dict[str, str],
    kind: str,
    end_in_time: Callable[["subprocess.Popen[str]"], None],
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", APPLICATION],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as application:
        end_in_time(application)
        assert application.stdout is not None
        assert application.stdout.readline() == "drawing\n"
        assert len(list((tmp_path / "temporary").glob("hapscene-*/stage.npz"))) == 1
        application.send_signal(getattr(signal, kind))
        assert application.communicate(timeout=120.0) == ("", None)  # the pipe ends with the last process that has it
    assert list((tmp_path / "temporary").iterdir()) == []


def test_nothing_but_a_job_of_ours_is_removed(tmp_path: Path, environment: dict[str, str]) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").touch()
    command = [sys.executable, "-m", "drawer", str(precious)]
    assert subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, check=False, timeout=60.0).returncode == 1
    assert (precious / "thesis.txt").exists()
