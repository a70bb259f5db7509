"""Choice of the GL platform and batches of frames, without GL. tests/nightly/view renders."""

import numpy as np
import pytest

from hapscene.errors import ViewError
from hapscene.view import offscreen
from hapscene.view.offscreen import draw, platforms
from hapscene.view.triangles import Drawing, Frame

DRAWING = Drawing((), [Frame(k * np.eye(4), []) for k in range(5)], (1.0, 1.0, 1.0), (4, 3), "#ffffff", 1)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """The platforms and numbers of frames of the batches; "late" fails at the last frame."""
    batches: list[tuple[str, int]] = []

    def draw_batch(platform: str, drawing: Drawing) -> np.ndarray:
        batches.append((platform, len(drawing.frames)))
        if platform == "broken" or (drawing.frames[-1].X_SC[0, 0] == 4 and platform == "late"):
            raise offscreen._DrawingFailed(f"no {platform}")
        return np.array([frame.X_SC[0, 0] for frame in drawing.frames])

    monkeypatch.setattr(offscreen, "_draw_batch", draw_batch)
    monkeypatch.setattr(offscreen, "PLATFORMS", {name: (f"lib{name}", ()) for name in ("broken", "late", "good")})
    return batches


def test_frames_are_drawn_in_batches_on_the_first_platform_that_works(
    asked: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(offscreen, "platforms", lambda: ["broken", "good", "late"])
    monkeypatch.setattr(offscreen, "BATCH_B", 2 * 3 * 4 * 3)
    assert list(draw(DRAWING)) == [0, 1, 2, 3, 4]
    assert asked == [("broken", 2), ("good", 2), ("good", 2), ("good", 1)]


def test_without_a_platform_all_reasons_are_given(
    asked: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(offscreen, "platforms", lambda: ["broken", "late"])
    with pytest.raises(ViewError, match=r"no broken.* libbroken.*no late.* liblate"):
        list(draw(DRAWING))
    assert asked == [("broken", 5), ("late", 5)]
    monkeypatch.setattr(offscreen, "BATCH", 4)
    with pytest.raises(ViewError, match="late failed after the first frame: no late"):
        list(draw(DRAWING))


@pytest.mark.parametrize("gpu", [True, False])
def test_the_platform_of_the_environment_comes_first(gpu: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "_has_gpu", lambda: gpu)
    usual = ["egl", "osmesa"] if gpu else ["osmesa", "egl"]
    for preferred, order in (("", usual), ("glx", usual), ("egl", ["egl", "osmesa"]), ("osmesa", ["osmesa", "egl"])):
        monkeypatch.setenv("PYOPENGL_PLATFORM", preferred)
        assert platforms() == order
