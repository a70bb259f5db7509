"""The acceleration channel as sound: what a voice coil would do to the hand, for the ear."""

import wave
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.io.files import whole_file
from hapscene.render.recording import Recording

__all__ = ["FADE_S", "PEAK_DBFS", "write_sound"]

PEAK_DBFS: Final = -1.0
"""Level of the loudest sample [dB of full scale]: loud, and clear of clipping when a player resamples."""

FADE_S: Final = 0.005
"""Fade at both ends [s], so that a cut is not heard as a click."""


def write_sound(recording: Recording, path: str | Path) -> float:
    """Write the acceleration as WAV: mono, 16 bit, at the channel's own rate. Silence stays silent.

    Args:
        recording: the run to hear.
        path: where the file shall be.

    Returns:
        The acceleration that full scale stands for [m/s²]; 0 for silence.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    a_m_s2 = recording.a_m_s2.ravel()
    peak_m_s2 = float(np.abs(a_m_s2).max(initial=0.0))
    full_scale_m_s2 = peak_m_s2 / 10 ** (PEAK_DBFS / 20)
    signal = a_m_s2 / full_scale_m_s2 if peak_m_s2 > 0 else np.zeros_like(a_m_s2)
    fade_count = min(round(FADE_S * recording.a_rate_Hz), len(signal) // 2)
    ramp = np.linspace(0.0, 1.0, fade_count, endpoint=False)
    signal[:fade_count] *= ramp
    signal[len(signal) - fade_count :] *= ramp[::-1]
    with whole_file(path) as part, wave.open(str(part), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(recording.a_rate_Hz))
        file.writeframes(np.rint(signal * 32767).astype("<i2").tobytes())
    return full_scale_m_s2
