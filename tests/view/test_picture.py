"""Pictures and films with a stand-in for the renderer. tests/nightly/view draws them."""

from collections.abc import Iterator
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
from hapscene.view import picture
from hapscene.view.figure_parts import BODIES, HEAD, SHAFT, TOOL
from hapscene.view.picture import WIDTH, write_picture
from hapscene.view.triangles import VIEW_FROM, Drawing

SMALL = (320, 240)


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.06, 0.02)), "m"), name="plate")
    scene.paint("plate", Swatch("green", albedo_rgb=(0.1, 0.8, 0.2)))
    return scene


@pytest.fixture
def drawings(monkeypatch: pytest.MonkeyPatch) -> list[Drawing]:
    """The drawings that are rendered; each frame is a grey of its angle."""
    asked: list[Drawing] = []

    def draw(drawing: Drawing) -> Iterator[np.ndarray]:
        asked.append(drawing)
        for frame in drawing.frames:
            grey = round(100.0 + 50.0 * frame.X_SC[0, 2])
            yield np.full((drawing.size[1], drawing.size[0], 3), grey, np.uint8)

    monkeypatch.setattr(picture, "draw", draw)
    return asked


def test_picture_shows_the_whole_touch_above_a_legend(
    tmp_path: Path, scene: Scene, recording: Recording, drawings: list[Drawing]
) -> None:
    write_picture(scene, recording, tmp_path / "a.png")
    (drawing,) = drawings
    with Image.open(tmp_path / "a.png") as image:
        legend_px = image.size[1] - drawing.size[1]
        assert image.size[0] == drawing.size[0] == WIDTH and 60 < legend_px < 200
        assert np.ptp(np.asarray(image)[: drawing.size[1]]) == 0 and np.ptp(np.asarray(image)[drawing.size[1] :]) > 200
    (frame,) = drawing.frames
    shown = [part for part, _ in frame.shown]
    assert shown == [*drawing.casters, len(drawing.parts) - 2, len(drawing.parts) - 1]  # bodies, path and arrows
    assert drawing.casters == range(BODIES, len(drawing.parts) - 2)
    arrows = drawing.parts[-1].corner_m
    assert len(arrows) > 10 * len(drawing.parts[HEAD].corner_m) and arrows[:, 2].max() > 0.01
    write_picture(scene, None, tmp_path / "b.png", size=SMALL)
    assert [part for part, _ in drawings[1].frames[0].shown] == list(drawings[1].casters)
    with pytest.raises(ViewError, match="too small"):
        write_picture(scene, None, tmp_path / "c.png", size=(320, 80))


def test_film_without_a_touch_turns_once(tmp_path: Path, scene: Scene, drawings: list[Drawing]) -> None:
    write_picture(scene, None, tmp_path / "a.gif", size=SMALL, seconds=0.48)
    with Image.open(tmp_path / "a.gif") as image:
        assert image.size == SMALL and image.n_frames == 6 and image.info["loop"] == 0
        frames = []
        for k in range(image.n_frames):
            image.seek(k)
            assert image.info["duration"] == 80
            frames.append(np.asarray(image.convert("RGB")).astype(int))
    x, y = np.array([frame.X_SC[:2, 2] for frame in drawings[-1].frames]).T
    turned = np.unwrap(np.arctan2(y, x)) - np.arctan2(*VIEW_FROM[1::-1])
    assert turned == pytest.approx(np.arange(6) * np.pi / 3)
    np.testing.assert_allclose([frame[0, 0, 0] for frame in frames], 100.0 + 50.0 * x, atol=6.0)
    assert all(np.array_equal(frames[0][-20:], frame[-20:]) for frame in frames)  # the legend


def test_film_of_a_touch_is_in_real_time(
    tmp_path: Path, scene: Scene, recording: Recording, drawings: list[Drawing]
) -> None:
    write_picture(scene, recording, tmp_path / "a.gif", size=SMALL)
    frames = drawings[-1].frames
    ticks = np.linspace(0, 1999, 25).round().astype(int)
    assert len(frames) == 25  # two seconds
    tips_m = np.array([dict(frame.shown)[TOOL][:3, 3] for frame in frames])
    np.testing.assert_allclose(np.diff(tips_m, axis=0), np.diff(recording.p_WT_m[ticks], axis=0), atol=1e-12)
    assert all(np.array_equal(frame.X_SC, frames[0].X_SC) for frame in frames)
    assert [SHAFT in dict(frame.shown) for frame in frames] == recording.touching[ticks].tolist()
    assert [len(frame.shown) for frame in frames[:2]] == [4, 5]  # body, tool, proxy, path so far


def test_mp4_without_encoder_raises(tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.view.picture.find_spec", lambda name: None)
    with pytest.raises(ViewError, match="video"):
        write_picture(scene, None, tmp_path / "a.mp4", size=SMALL)
    assert list(tmp_path.iterdir()) == []
