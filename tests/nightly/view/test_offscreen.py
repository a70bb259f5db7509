"""Frames without a screen."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import ViewError
from hapscene.view import offscreen
from hapscene.view.camera import looks, place
from hapscene.view.offscreen import draw, job_folder, platforms, start_drawer, started_ahead
from hapscene.view.triangles import Drawing, Frame, lathe


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    """A green cone from three sides."""
    cone = lathe([(0.05, 0.0), (0.0, 0.1)], "#009E73")
    poses, extent_m, _ = place(cone.corner_m, looks([0.0, 1.0, 2.0]), (80, 60))
    return Drawing([cone], [Frame(X_SC, [(0, np.eye(4))]) for X_SC in poses], extent_m, (80, 60), "#102030", 2)


def test_frames_come_one_by_one_and_batches_make_no_difference(
    drawing: Drawing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(offscreen, "BATCH", 2)
    first, second, _ = drawing.frames
    try:
        whole = list(draw(replace(drawing, frames=[first, second, first])))
    except ViewError as error:
        pytest.skip(str(error))
    assert len(whole) == 3 and whole[0].shape == (60, 80, 3)
    assert whole[0][0, 0].tolist() == [0x10, 0x20, 0x30]
    assert (whole[0][..., 1] > 100).mean() > 0.1
    assert np.array_equal(whole[0], whole[2]) and not np.array_equal(whole[0], whole[1])  # of two processes


def test_a_process_that_was_started_ahead_draws_the_same_and_once(
    drawing: Drawing, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []
    start = offscreen.start_drawer

    def counted(module: str, *arguments: object, **more: object) -> object:
        started.append(module)
        return start(module, *arguments, **more)

    monkeypatch.setattr(offscreen, "start_drawer", counted)
    try:
        (expected,) = draw(replace(drawing, frames=drawing.frames[:1]))
    except ViewError as error:
        pytest.skip(str(error))
    with started_ahead():
        assert len(started) == 2
        (ahead,) = draw(replace(drawing, frames=drawing.frames[:1]))
        assert len(started) == 2
        (after,) = draw(replace(drawing, frames=drawing.frames[:1]))
        assert len(started) == 3
    assert np.array_equal(ahead, expected) and np.array_equal(after, expected)


def test_a_process_that_was_started_ahead_goes_unused_with_its_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    with started_ahead():
        ((job, drawer),) = offscreen._ahead.values()
        assert job.is_dir()
    assert drawer.process.returncode is not None and not job.exists() and not offscreen._ahead
    with started_ahead(wanted=False):
        assert not offscreen._ahead


@pytest.mark.parametrize("ahead", [False, True])
def test_where_nothing_draws_the_error_names_the_packages(
    drawing: Drawing, monkeypatch: pytest.MonkeyPatch, ahead: bool
) -> None:
    monkeypatch.setattr(offscreen, "LIBRARIES", {"osmesa": ("NoSuchOSMesa",), "egl": ("NoSuchEGL",)})
    monkeypatch.setattr(offscreen, "platforms", lambda: ["osmesa", "egl"])
    monkeypatch.setattr(offscreen.sys, "executable", "/bin/false")
    with started_ahead(wanted=ahead), pytest.raises(ViewError, match="libosmesa6"):
        list(draw(drawing))


def test_driver_that_crashes_midway_is_told(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    def one_frame(platform: str, job: Drawing) -> Iterator[np.ndarray]:
        yield np.zeros((60, 80, 3), np.uint8)
        raise offscreen._Undrawn("ended with code -11")

    monkeypatch.setattr(offscreen, "_draw_with", one_frame)
    with pytest.raises(ViewError, match="-11"):
        list(draw(drawing))


def test_frame_that_takes_too_long_is_given_up(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "TIMEOUT_S", 0.05)
    monkeypatch.setattr(offscreen, "platforms", lambda: ["osmesa"])
    with pytest.raises(ViewError):
        list(draw(drawing))


def test_platform_is_chosen_by_the_machine_and_by_wish(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: False)
    assert platforms() == ["osmesa", "egl"]
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: True)
    assert platforms() == ["egl", "osmesa"]
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    assert platforms() == ["osmesa", "egl"]


# The process that draws goes with the one that started it, however that ends, and leaves nothing.


DRAWER = """
import sys, time
from pathlib import Path
from hapscene.view.offscreen import go_with_the_other
go_with_the_other(Path(sys.argv[1]))
print("drawing", flush=True)
time.sleep(600.0)
"""

FAILING = "import sys\nprint('GL is at fault', file=sys.stderr)\nsys.exit(3)\n"


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Where the drawer is found, and temporary folders are made."""
    (tmp_path / "drawer.py").write_text(DRAWER)
    (tmp_path / "temporary").mkdir()
    return os.environ | {"PYTHONPATH": str(tmp_path), "TMPDIR": str(tmp_path / "temporary")}


def test_why_it_failed_is_its_last_line(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "drawer.py").write_text(FAILING)
    with job_folder() as job, start_drawer("drawer", job, environment) as drawer:
        assert drawer.reason() == "GL is at fault"
        assert drawer.process.returncode == 3
    assert not job.exists()


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
