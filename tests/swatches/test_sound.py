"""Sounds of swatches."""

import io
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.io import wavfile

import hapscene
from hapscene.capture.fit.synthesis import synthesize
from hapscene.surface.swatch import Swatch
from hapscene.swatches.sound import EASE_S, FULL_SCALE_M_S2, START_S, Sound, swatch_sound, wav_bytes
from hapscene.view.sound import FADE_S

WOOD = hapscene.load_swatch("wood")


def steady(sound, seconds: float) -> np.ndarray:
    """Part of the sound in which the stroke has its full speed."""
    start, stop = START_S + EASE_S + 0.05, START_S + seconds - EASE_S - 0.05
    return sound.a_m_s2[round(start * sound.rate_Hz) : round(stop * sound.rate_Hz)]


def test_level_of_the_stroke() -> None:
    for force_N, speed_m_s, gain in ((1.0, 0.1, 1.0), (0.5, 0.2, 1.0), (1.0, 0.1, 3.0)):
        swatch = replace(WOOD, taps=None, effects={"lpc_texture": {"texture_gain": gain}})
        level = steady(swatch_sound(swatch, force_N, speed_m_s, 20.0), 20.0).std()
        known = gain * float(np.sqrt(WOOD.texture.power([force_N], [speed_m_s])[0]))  # type: ignore[union-attr]
        assert level == pytest.approx(known, rel=0.1)
        assert swatch_sound(swatch, force_N, speed_m_s, 0.5).levels.startswith(f"stroke {known:.2g} m/s² rms")


def test_a_stroke_starts_and_ends_at_rest() -> None:
    swatch = replace(WOOD, effects={"lpc_texture": {"texture_gain": 2.0, "texture_life": 0.5}})
    sound, alone = swatch_sound(swatch, 0.7, 0.1, 0.4), swatch_sound(replace(swatch, texture=None), 0.7, 0.1, 0.4)
    t_s = np.arange(round(0.4 * sound.rate_Hz)) / sound.rate_Hz
    slide = np.interp(t_s, [0.0, EASE_S, 0.4 - EASE_S, 0.4], [0.0, 1.0, 1.0, 0.0])
    speed = 0.1 * np.sin(0.5 * np.pi * slide) ** 2
    stroke = 2.0 * synthesize(swatch, np.full(len(t_s), 0.7), speed, rate_Hz=sound.rate_Hz, modulation=0.5)
    np.testing.assert_allclose((sound.a_m_s2 - alone.a_m_s2)[sound.start :], stroke, atol=1e-6 * np.abs(stroke).max())
    assert len(sound.a_m_s2) == sound.start + len(t_s) and not (sound.a_m_s2 - alone.a_m_s2)[: sound.start].any()


def test_a_sound_fades_out_at_its_end() -> None:
    rate_Hz = 10_000.0
    before = Sound(0.1 * FULL_SCALE_M_S2 * (np.arange(2510) < round(START_S * rate_Hz)), rate_Hz, 0.0)
    found, count = samples(wav_bytes(before))[1], round(FADE_S * rate_Hz)
    assert (found[:-count] == 3277).all() and not found[-10:].any()
    np.testing.assert_array_equal(found[-count:-10], np.rint(3276.7 * np.arange(count - 1, 9, -1) / count))


def test_tap() -> None:
    quiet = replace(WOOD, texture=None)
    sound = swatch_sound(quiet)
    tap = WOOD.taps.transient(0.1, sound.rate_Hz)  # type: ignore[union-attr]
    np.testing.assert_allclose(sound.a_m_s2[: len(tap)], tap)
    assert not swatch_sound(Swatch("bare")).a_m_s2.any()


def samples(data: bytes) -> tuple[int, np.ndarray]:
    rate, found = wavfile.read(io.BytesIO(data))
    assert found.dtype == np.int16 and found.ndim == 1
    return rate, found


def weighted_dBFS(played: np.ndarray, rate_Hz: float) -> float:
    """A-weighted level, by the poles of the weighting (IEC 61672-1) in an analogue filter, 0 dB at 1 kHz."""
    poles_Hz = np.array([20.6, 20.6, 107.7, 737.9, 12194.0, 12194.0])
    f = np.fft.rfftfreq(len(played), 1.0 / rate_Hz)
    _, response = signal.freqs_zpk([0] * 4, -2 * np.pi * poles_Hz, 1.0, 2 * np.pi * np.append(f, 1000.0))
    spectrum = np.abs(np.fft.rfft(played)) * np.abs(response[:-1] / response[-1])
    return float(10 * np.log10(2 * np.sum(spectrum**2)) - 20 * np.log10(len(played)))


@pytest.mark.parametrize("name", ["wood", "glass", "sandpaper-p60", "foam-soft", "grating-2mm-200um"])
def test_strokes_are_audible_without_clipping(name: str) -> None:
    """Their true levels differ by 25 dB. Strokes with much power below 60 Hz reach −10 dB; their peaks are limited."""
    sound = swatch_sound(hapscene.load_swatch(name))
    rate, found = samples(wav_bytes(sound))
    played = found[sound.start :] / 32767
    level_dB, peak_dB = weighted_dBFS(played, rate), 20 * np.log10(np.abs(found).max() / 32767)
    assert peak_dB < -0.99
    rms_dB = 10 * np.log10(np.mean(played**2))
    assert level_dB == pytest.approx(-26.0, abs=0.2) or (level_dB > -29.0 and rms_dB == pytest.approx(-10.0, abs=0.5))
    change = played - sound.gain * sound.a_m_s2[sound.start :] / FULL_SCALE_M_S2
    assert weighted_dBFS(change, rate) < level_dB - 15.0
    assert sound.levels.endswith(f" m/s² rms, played {20 * np.log10(sound.gain):+.0f} dB")


def test_clipping_and_silence() -> None:
    loud = replace(WOOD, effects={"lpc_texture": {"texture_gain": 10.0}, "tap": {"tap_gain": 10.0}})
    _, found = samples(wav_bytes(swatch_sound(loud)))
    assert np.abs(swatch_sound(loud).a_m_s2).max() > FULL_SCALE_M_S2
    assert 29_000 < np.abs(found).max() < 32767
    assert swatch_sound(replace(WOOD, texture=None)).levels == swatch_sound(Swatch("bare")).levels == "no stroke"
    assert not samples(wav_bytes(swatch_sound(Swatch("bare"))))[1].any()
