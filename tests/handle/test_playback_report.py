"""What would be felt: the sound's scale, and that the plot draws."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.io import wavfile

from hapscene.handle import playback_report
from hapscene.handle.plant import Plant
from hapscene.handle.playback import play
from hapscene.handle.playback_report import write_playback, write_wave


def test_the_wave_times_its_scale_is_the_acceleration(tmp_path: Path) -> None:
    acceleration = 3.0 * np.sin(np.arange(1000) * 0.1)
    full = write_wave(acceleration, 5000.0, tmp_path / "a.wav")
    rate, wave = wavfile.read(tmp_path / "a.wav")
    assert rate == 5000 and np.abs(wave).max() < 32767
    np.testing.assert_allclose(wave / 32767 * full, acceleration, atol=1e-3)


def test_silence_stays_silent(tmp_path: Path) -> None:
    assert write_wave(np.zeros(100), 5000.0, tmp_path / "a.wav") == 0.0
    assert not wavfile.read(tmp_path / "a.wav")[1].any()


def test_the_plot_is_drawn(tmp_path: Path) -> None:
    desired = np.random.default_rng(0).standard_normal(2000)
    played = play(desired, 10_000.0, compensator="naive")
    write_playback(desired, played, 10_000.0, Plant(), "noise", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_what_is_drawn_is_what_was_played_within_its_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(playback_report, "save_chart", lambda figure, path: figures.append(figure))
    desired = np.random.default_rng(0).standard_normal(2000)
    desired[1500] = 9.0
    played = play(desired, 10_000.0, compensator="naive")
    write_playback(desired, replace(played, hits=1), 10_000.0, Plant(), "noise", tmp_path / "a.png")
    moment, _, _, force, travel, _ = figures[0].axes
    first, last = moment.get_xlim()
    assert first < 0.15 < last  # the strongest moment
    part = slice(round(first * 10_000), round(last * 10_000) + 1)
    for line, row in zip(moment.lines, (desired, played.acceleration_m_s2), strict=True):
        assert np.array_equal(line.get_ydata(), row[part])
    for ax, values, limit in ((force, played.force_N, 6.6), (travel, 1e3 * played.travel_m, 5.0)):
        assert sorted(line.get_ydata()[0] for line in ax.lines) == pytest.approx([-limit, limit])
        drawn = ax.collections[0].get_paths()[0].vertices[:, 1]
        assert (drawn.min(), drawn.max()) == pytest.approx((values.min(), values.max()))
