"""What would be felt: the sound's scale, and that the plot draws."""

from pathlib import Path

import numpy as np
from scipy.io import wavfile

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
