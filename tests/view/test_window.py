"""The window, without a display."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.errors import ViewError
from hapscene.render.recording import Recording
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.view.figure_parts import TOOL, make_figure_parts
from hapscene.view.palette import LIGHT
from hapscene.view.window import Player, check_display, play_in_window, with_hand


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.06, 0.02)), "m"), name="plate", swatch="wood")
    return scene


def test_missing_display_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("only X11 has a DISPLAY")
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(ViewError, match="DISPLAY"):
        check_display()


def test_invalid_display_raises(scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("only X11 has a DISPLAY")
    monkeypatch.setenv("DISPLAY", ":4242")
    with pytest.raises(ViewError) as caught:
        play_in_window(scene, recording)
    assert "\n" not in str(caught.value) and ("libgl1" in str(caught.value))


def test_player_is_in_real_time(scene: Scene, recording: Recording) -> None:
    player = Player(make_figure_parts(scene, recording, LIGHT, np.array([1999])), recording)
    for t_s in (0.0, 0.9004, 1.7, 5.0):
        shown, line = player.at(t_s)
        tick = min(int(t_s * 1e3), 1999)
        assert dict(shown)[TOOL][:3, 3] == pytest.approx(recording.p_WT_m[tick])
        assert line.split()[0] == f"{recording.t_s[tick]:.2f}"
    assert player.at(0.9)[1].endswith(f"0.50 N   {recording.swatch_names[recording.swatch[900]]}")
    assert player.at(0.0)[1].endswith("in the air")


def test_with_hand(tmp_path: Path, recording: Recording) -> None:
    p_W_m, f_motor_W_N = recording.p_WT_m + 1e-4, recording.f_W_N * 0.9
    np.savez(tmp_path / "hand.npz", p_W_m=p_W_m, f_motor_W_N=f_motor_W_N)
    true = with_hand(recording, tmp_path / "hand.npz")
    assert np.array_equal(true.p_WT_m, p_W_m) and np.array_equal(true.f_W_N, f_motor_W_N)
    assert np.array_equal(true.p_WP_m, recording.p_WP_m)
