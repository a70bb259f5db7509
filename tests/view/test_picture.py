"""scene.png, where a GL can be had."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.errors import ViewError
from hapscene.recording import Recording
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.view import offscreen
from hapscene.view.picture import HEIGHTS, LEGEND_HEIGHT, WIDTH, _length, _round_down, write_picture


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.1, 0.02)), "m"), name="plate")
    scene.paint("plate", Swatch("green", albedo_rgb=(0.1, 0.8, 0.2)))
    return scene


def test_picture_shows_the_swatch_and_the_path_and_repeats(tmp_path: Path, scene: Scene, recording: Recording) -> None:
    try:
        write_picture(scene, recording, tmp_path / "a.png")
    except ViewError as error:
        pytest.skip(str(error))
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == WIDTH and HEIGHTS[0] <= image.height - LEGEND_HEIGHT <= HEIGHTS[1]
        pixels = np.asarray(image.convert("RGB")).astype(int)
    red, green, blue = np.moveaxis(pixels[:-LEGEND_HEIGHT], 2, 0)
    assert np.mean((green > 1.5 * red) & (green > 1.5 * blue)) > 0.1  # the plate
    assert np.count_nonzero((red > 1.2 * green) & (blue > 1.1 * green)) > 500  # the path on it
    write_picture(scene, recording, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_without_gl_one_line_names_the_packages(tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "_draw_with", lambda platform, job, out: "no library")
    with pytest.raises(ViewError) as caught:
        write_picture(scene, None, tmp_path / "a.png")
    assert "libosmesa6" in str(caught.value) and "libegl1 libgl1" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_driver_that_fails_gives_its_reason(tmp_path: Path) -> None:
    reason = offscreen._draw_with("osmesa", tmp_path / "missing.npz", tmp_path / "out.npy")
    assert reason and "\n" not in reason


def test_scale_bar_is_a_round_number() -> None:
    assert [_round_down(m) for m in (0.0123, 0.05, 0.199, 7.0)] == pytest.approx([0.01, 0.05, 0.1, 5.0])
    assert [_length(m) for m in (0.05, 2.0, 2e-5)] == ["50 mm", "2 m", "20 µm"]
