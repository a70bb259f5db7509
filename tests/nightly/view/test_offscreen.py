"""Rendering without a screen."""

import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import ViewError
from hapscene.view import offscreen
from hapscene.view.offscreen import draw, started_ahead
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


def test_parts_at_the_same_place_are_drawn_in_the_same_order_each_time(drawing: Drawing) -> None:
    (cone,) = drawing.parts
    parts = [
        cone._replace(picture=np.full((2, 2, 3), 40 * k, np.uint8), uv=np.zeros((len(cone.corner_m), 2)))
        for k in range(7)
    ]
    frame = replace(drawing.frames[0], shown=[(k, np.eye(4)) for k in range(7)])
    every = replace(drawing, parts=parts, frames=[frame])
    try:
        pictures = [next(draw(every)) for _ in range(3)]
    except ViewError as error:
        pytest.skip(str(error))
    assert all(np.array_equal(pictures[0], picture) for picture in pictures[1:])


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
