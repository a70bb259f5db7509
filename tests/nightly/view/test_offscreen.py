"""Rendering without a screen."""

import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.errors import ViewError
from hapscene.view import offscreen
from hapscene.view.offscreen import draw, platforms, started_ahead
from hapscene.view.triangles import Drawing, Frame, fit_cameras, lathe, orbit


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    """A green cone from three sides."""
    cone = lathe([(0.05, 0.0), (0.0, 0.1)], "#009E73")
    poses, extent_m, _ = fit_cameras(cone.corner_m, orbit([0.0, 1.0, 2.0]), (80, 60))
    return Drawing([cone], [Frame(X_SC, [(0, np.eye(4))]) for X_SC in poses], extent_m, (80, 60), "#102030", 2)


def test_batches(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_process_started_ahead(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[object] = []
    start = subprocess.Popen

    def counted(*arguments: Any, **more: Any) -> object:
        started.append(arguments)
        return start(*arguments, **more)

    monkeypatch.setattr(offscreen.subprocess, "Popen", counted)
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


def test_working_folder_is_not_imported(drawing: Drawing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('of the working folder')\n")
    monkeypatch.chdir(tmp_path)
    try:
        list(draw(replace(drawing, frames=drawing.frames[:1])))
    except ViewError as error:
        assert "of the working folder" not in str(error)


def test_unused_process_ends() -> None:
    with started_ahead():
        (process,) = offscreen._ahead.values()
    assert process.returncode is not None and not offscreen._ahead


@pytest.mark.parametrize("ahead", [False, True])
def test_missing_libraries_raise(drawing: Drawing, monkeypatch: pytest.MonkeyPatch, ahead: bool) -> None:
    missing = {"osmesa": ("libosmesa6", ("NoSuchOSMesa",)), "egl": ("libegl1", ("NoSuchEGL",))}
    monkeypatch.setattr(offscreen, "PLATFORMS", missing)
    monkeypatch.setattr(offscreen, "platforms", lambda: ["osmesa", "egl"])
    monkeypatch.setattr(offscreen.sys, "executable", "/bin/false")
    with started_ahead() if ahead else nullcontext(), pytest.raises(ViewError, match="libosmesa6"):
        list(draw(drawing))


def test_crash_after_the_first_frame_raises(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    def one_frame(platform: str, job: Drawing) -> Iterator[np.ndarray]:
        yield np.zeros((60, 80, 3), np.uint8)
        raise offscreen._DrawingFailed("ended with code -11")

    monkeypatch.setattr(offscreen, "_draw_batch", one_frame)
    with pytest.raises(ViewError, match="-11"):
        list(draw(drawing))


def test_timeout_raises(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "TIMEOUT_S", 0.05)
    monkeypatch.setattr(offscreen, "platforms", lambda: ["osmesa"])
    with pytest.raises(ViewError):
        list(draw(drawing))


def test_platforms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: False)
    assert platforms() == ["osmesa", "egl"]
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: True)
    assert platforms() == ["egl", "osmesa"]
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    assert platforms() == ["osmesa", "egl"]


ALONE = """
import ctypes, sys
load = ctypes.CDLL.__init__
def refuse(self, name, *rest, **more):
    if name and any(lib in str(name) for lib in ("libGL.", "libGLX", "libEGL", "libX11")):
        raise OSError(f"{name}: not installed")
    load(self, name, *rest, **more)
ctypes.CDLL.__init__ = refuse
import pickle
from hapscene.view.gl import render
print(sum(frame.std() > 10 for frame in render(pickle.load(sys.stdin.buffer))), "pyglet" in sys.modules)
"""


def test_osmesa_needs_no_other_library(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    from ctypes.util import find_library

    if find_library("OSMesa") is None:
        pytest.skip("libosmesa6 is not installed")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    command = [sys.executable, "-c", ALONE]
    done = subprocess.run(command, input=pickle.dumps(drawing), capture_output=True, timeout=120.0)
    assert done.stdout.split() == [b"3", b"False"], done.stderr[-500:]


APPLICATION = """
import signal
from hapscene.interrupt import interrupted_by_ends
from hapscene.view.offscreen import started_ahead
with interrupted_by_ends(), started_ahead():
    print("started", flush=True)
    signal.pause()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no process can send these signals there")
@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
def test_process_ends_with_its_parent(kind: str, end_in_time: Callable[["subprocess.Popen[str]"], None]) -> None:
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", APPLICATION], stdout=pipe, stderr=pipe, text=True) as application:
        end_in_time(application)
        assert application.stdout is not None
        assert application.stdout.readline() == "started\n"
        application.send_signal(getattr(signal, kind))
        application.communicate(timeout=120.0)  # the pipe ends with the last process that has it
