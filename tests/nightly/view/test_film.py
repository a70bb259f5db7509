"""Films as GIF and MP4."""

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
from hapscene.view.picture import write_picture

SMALL = {"size": (320, 240), "seconds": 0.48}


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.06, 0.02)), "m"), name="plate")
    scene.paint("plate", Swatch("green", albedo_rgb=(0.1, 0.8, 0.2)))
    return scene


def write(*arguments: object, **named: object) -> None:
    try:
        write_picture(*arguments, **named)  # type: ignore[arg-type]
    except ViewError as error:
        if "no GL" not in str(error):
            raise
        pytest.skip(str(error))


def test_gif(tmp_path: Path, scene: Scene) -> None:
    write(scene, None, tmp_path / "a.gif", **SMALL)
    with Image.open(tmp_path / "a.gif") as image:
        assert image.size == (320, 240) and image.n_frames == 6
        frames, duration_ms = [], 0
        for k in range(image.n_frames):
            image.seek(k)
            duration_ms += image.info["duration"]
            frames.append(np.asarray(image.convert("RGB")).astype(int))
    assert duration_ms == 480
    assert all((np.abs(a - b)[:100] > 30).any() for a, b in pairwise(frames))
    assert all(np.array_equal(frames[0][-30:], frame[-30:]) for frame in frames)  # the legend stands still


def test_mp4(tmp_path: Path, scene: Scene, recording: Recording) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra `video` is not installed")
    write(scene, recording, tmp_path / "a.mp4", **SMALL | {"seconds": 0.5})
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    about = next(reader)
    assert about["size"] == (320, 240) and about["fps"] == pytest.approx(25.0) and len(list(reader)) == 12
