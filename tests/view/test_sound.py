"""Recorded acceleration as WAV."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile
from scipy.signal import welch

from hapscene.render.recording import Recording
from hapscene.view.sound import write_wave


def test_spectrum(tmp_path: Path, recording: Recording) -> None:
    noise = np.random.default_rng(4).normal(size=recording.a_m_s2.shape)
    recording = replace(recording, a_m_s2=recording.a_m_s2 + noise)
    full_scale_m_s2 = write_wave(recording.a_m_s2.ravel(), recording.a_rate_Hz, tmp_path / "feel.wav")
    rate_Hz, wave = wavfile.read(tmp_path / "feel.wav")
    assert rate_Hz == recording.a_rate_Hz and wave.dtype == np.int16 and wave.shape == (20_000,)
    _, wave_density = welch(wave / 32767 * full_scale_m_s2, rate_Hz, nperseg=1000)
    _, recorded_density = welch(recording.a_m_s2.ravel(), recording.a_rate_Hz, nperseg=1000)
    np.testing.assert_allclose(10 * np.log10(wave_density / recorded_density)[1:], 0.0, atol=0.1)


@pytest.mark.parametrize(("count", "rises"), [(100, 5), (7, 3), (1, 0)])
def test_both_ends_fade_over_5_ms_or_half_of_the_signal(tmp_path: Path, count: int, rises: int) -> None:
    full_scale_m_s2 = write_wave(np.full(count, -2.0), 1000.0, tmp_path / "feel.wav")
    rate_Hz, wave = wavfile.read(tmp_path / "feel.wav")
    share = np.minimum(1.0, np.minimum(np.arange(count), np.arange(count)[::-1]) / max(rises, 1e-9))
    expected = share if rises else np.ones(1)
    assert rate_Hz == 1000
    np.testing.assert_allclose(wave / 32767 * full_scale_m_s2, -2.0 * expected, atol=1e-4)


def test_level(tmp_path: Path, recording: Recording) -> None:
    full_scale_m_s2 = write_wave(recording.a_m_s2.ravel(), recording.a_rate_Hz, tmp_path / "feel.wav")
    assert full_scale_m_s2 == pytest.approx(3.0 * 10 ** (1 / 20), rel=1e-3)
    _, wave = wavfile.read(tmp_path / "feel.wav")
    assert 20 * np.log10(np.abs(wave).max() / 32767) == pytest.approx(-1.0, abs=0.01)
    assert wave[0] == 0 and abs(int(wave[-1])) < 700
