"""Frames without a screen."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import ViewError
from hapscene.view import offscreen
from hapscene.view.camera import looks, place
from hapscene.view.offscreen import draw, job_folder, platforms, start_drawer, started_ahead
from hapscene.view.triangles import Drawing, Frame, lathe

pytestmark = pytest.mark.nightly


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


def test_one_that_failed_ahead_is_told_like_any(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen.sys, "executable", "/bin/false")
    with started_ahead(), pytest.raises(ViewError, match="install one of these"):
        list(draw(drawing))


def test_where_nothing_draws_one_line_names_the_packages(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "PLATFORMS", {"osmesa": "libosmesa6", "egl": "libegl1 libgl1"})
    monkeypatch.setattr(offscreen.sys, "executable", "/bin/false")
    with pytest.raises(ViewError) as caught:
        list(draw(drawing))
    assert "libosmesa6" in str(caught.value) and "libegl1 libgl1" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_library_that_is_not_there_is_told_without_the_words_of_ours(
    drawing: Drawing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(offscreen, "LIBRARIES", {"osmesa": ("NoSuchOSMesa",), "egl": ("NoSuchEGL",)})
    monkeypatch.setattr(offscreen, "platforms", lambda: ["osmesa", "egl"])
    monkeypatch.setattr(offscreen.sys, "executable", "/bin/false")
    with pytest.raises(ViewError) as caught:
        list(draw(drawing))
    assert str(caught.value) == (
        "no GL can draw here; install one of these system packages: osmesa (not installed) needs libosmesa6; "
        "egl (not installed) needs libegl1 libgl1"
    )


def test_driver_that_crashes_midway_is_told(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    def one_frame(platform: str, job: Drawing) -> Iterator[np.ndarray]:
        yield np.zeros((60, 80, 3), np.uint8)
        raise offscreen._Undrawn("ended with code -11")

    monkeypatch.setattr(offscreen, "_draw_with", one_frame)
    with pytest.raises(ViewError, match=r"midway: ended with code -11"):
        list(draw(drawing))


def test_frame_that_takes_too_long_is_given_up(drawing: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "TIMEOUT_S", 0.05)
    monkeypatch.setattr(offscreen, "platforms", lambda: ["osmesa"])
    with pytest.raises(ViewError, match=r"took longer than 0\.05 s"):
        list(draw(drawing))


def test_platform_is_chosen_by_the_machine_and_by_wish(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: False)
    assert platforms() == ["osmesa", "egl"]
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: True)
    assert platforms() == ["egl", "osmesa"]
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    assert platforms() == ["osmesa", "egl"]


def test_one_gpu_is_enough_whosever_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "Path", lambda path: tmp_path / path.lstrip("/"))
    assert not offscreen._has_gpu()
    (tmp_path / "dev" / "dri").mkdir(parents=True)
    for name in ("nvidia0", "dri/renderD128"):
        (tmp_path / "dev" / name).touch()
        assert offscreen._has_gpu()
        (tmp_path / "dev" / name).unlink()
    (tmp_path / "dev" / "nvidiactl").touch()  # the driver without a card
    assert not offscreen._has_gpu()


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
