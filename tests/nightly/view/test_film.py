"""GIF and MP4."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.errors import ViewError
from hapscene.render.recording import Recording
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.view.film import Film, _compose, write_film

SMALL = Film(size=(320, 240), frame_count=6)


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.06, 0.02)), "m"), name="plate")
    scene.paint("plate", Swatch("green", albedo_rgb=(0.1, 0.8, 0.2)))
    return scene


def write(*arguments: object, **named: object) -> None:
    try:
        write_film(*arguments, **named)  # type: ignore[arg-type]
    except ViewError as error:
        if "no GL" not in str(error):
            raise
        pytest.skip(str(error))


def test_gif_turns_and_lasts_as_long_as_asked(tmp_path: Path, scene: Scene) -> None:
    said: list[str] = []
    write(scene, None, tmp_path / "a.gif", film=replace(SMALL, seconds=1.0), say=said.append)
    assert "".join(said).split("%")[0].strip().isdigit() and "100 %" in "".join(said)
    with Image.open(tmp_path / "a.gif") as image:
        assert image.size == (320, 240) and image.n_frames == 6
        frames, duration_ms = [], 0
        for k in range(image.n_frames):
            image.seek(k)
            duration_ms += image.info["duration"]
            frames.append(np.asarray(image.convert("RGB")).astype(int))
    assert duration_ms == 1000
    assert all((np.abs(a - b)[:100] > 30).any() for a, b in pairwise(frames))
    assert all(np.array_equal(frames[0][-30:], frame[-30:]) for frame in frames)  # the legend stands still


def test_mp4_has_the_frames_the_rate_and_the_size(tmp_path: Path, scene: Scene, recording: Recording) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra `video` is not installed")
    write(scene, recording, tmp_path / "a.mp4", film=replace(SMALL, seconds=0.5))
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    about = next(reader)
    assert about["size"] == (320, 240) and about["fps"] == pytest.approx(12.0) and len(list(reader)) == 6


def test_touch_is_played_in_its_own_time_after_the_painting(scene: Scene, recording: Recording) -> None:
    drawing, _ = _compose(scene, recording, Film(size=(320, 240), turn_rad=0.0, painting=True), 40)
    shown = [dict(frame.shown) for frame in drawing.frames]
    assert [0 in parts for parts in shown] == [False] * 10 + [True] * 30  # the tool comes when all is painted
    tips_m = np.array([parts[0][:3, 3] for parts in shown[10:]])
    ticks = np.linspace(0, 1999, 30).round().astype(int)
    np.testing.assert_allclose(np.diff(tips_m, axis=0), np.diff(recording.p_WT_m[ticks], axis=0), atol=1e-12)
    assert all(np.array_equal(frame.X_SC, drawing.frames[0].X_SC) for frame in drawing.frames)
    stages = [tuple(part for part in sorted(parts) if part >= 4) for parts in shown[:11]]
    assert len(set(stages)) > 5


@pytest.mark.parametrize(
    ("name", "film"),
    [("a.mp4", Film(size=(241, 200))), ("a.gif", Film(seconds=1.0, frame_count=60)), ("a.mp4", Film())],
    ids=["odd size", "too many frames", "no encoder"],
)
def test_an_impossible_film_is_refused_before_it_is_drawn(
    tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch, name: str, film: Film
) -> None:
    monkeypatch.setattr("hapscene.view.film.find_spec", lambda name: None)
    with pytest.raises(ViewError):
        write_film(scene, None, tmp_path / name, film=film)
    assert list(tmp_path.iterdir()) == []


def test_film_that_is_interrupted_leaves_nothing(tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(drawing: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr("hapscene.view.film.draw", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_film(scene, None, tmp_path / "a.gif", film=SMALL)
    assert list(tmp_path.iterdir()) == []
