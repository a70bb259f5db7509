"""Pictures and films, if OpenGL is available."""

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
from hapscene.view.palette import DARK, rgb
from hapscene.view.picture import write_picture


def scene_of(shape: trimesh.Trimesh) -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(shape, "m"), name="body")
    scene.paint("body", Swatch("green", albedo_rgb=(0.1, 0.8, 0.2)))
    return scene


def drawn(path: Path, *arguments: object, **named: object) -> np.ndarray:
    try:
        write_picture(*arguments, **named)  # type: ignore[arg-type]
    except ViewError as error:
        pytest.skip(str(error))
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def test_swatch_path_and_force(tmp_path: Path, recording: Recording) -> None:
    scene = scene_of(trimesh.creation.box((0.1, 0.1, 0.02)))
    pixels = drawn(tmp_path / "a.png", scene, recording, tmp_path / "a.png", size=(640, 480))
    red, green, blue = np.moveaxis(pixels[:400], 2, 0)
    assert np.mean((green > 1.5 * red) & (green > 1.5 * blue)) > 0.1  # the plate
    assert np.count_nonzero((red > 1.2 * green) & (blue > 1.1 * green)) > 60  # the path on it
    assert np.count_nonzero((red < 10) & (green > 90) & (blue > 0.6 * green)) > 60  # arrows
    write_picture(scene, recording, tmp_path / "b.png", size=(640, 480))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_scale_bar(tmp_path: Path) -> None:
    ball = scene_of(trimesh.creation.icosphere(5, 0.05))
    pixels = drawn(tmp_path / "a.png", ball, None, tmp_path / "a.png", size=(500, 400), theme=DARK)
    assert pixels.shape == (400, 500, 3)
    ink = np.round(rgb(DARK.ink) * 255)
    bar_px = max(_longest_run((row == ink).all(axis=1)) for row in pixels[347:])
    red, green, blue = np.moveaxis(pixels[:347], 2, 0)
    ball_px = np.ptp(np.flatnonzero(((green > 1.5 * red) & (green > 1.5 * blue)).any(axis=0))) + 1
    assert bar_px / ball_px == pytest.approx(20 / 100, rel=0.03)  # 20 mm of 100: a fifth of the width is not quite 50


def test_mp4(tmp_path: Path, recording: Recording) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra `video` is not installed")
    plate = scene_of(trimesh.creation.box((0.1, 0.06, 0.02)))
    try:
        write_picture(plate, recording, tmp_path / "a.mp4", size=(320, 240), seconds=0.5)
    except ViewError as error:
        pytest.skip(str(error))
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    about = next(reader)
    assert about["size"] == (320, 240) and about["fps"] == pytest.approx(25.0) and len(list(reader)) == 12


def _longest_run(mask: np.ndarray) -> int:
    edges = np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0)).reshape(-1, 2)
    return int(np.diff(edges, axis=1).max(initial=0))
