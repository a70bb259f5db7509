"""Sound of a swatch as WAV: a tap, then a stroke at constant force and speed."""

import io
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.synthesis import synthesize
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, TAP_M_S
from hapscene.view.sound import FADE_S, PEAK_DBFS

__all__ = ["START_S", "Sound", "swatch_sound", "wav_bytes"]

STROKE_S: Final = 1.5
"""Default length of the stroke [s]: long enough to distinguish two textures."""

START_S: Final = 0.25
"""Start of the stroke after the tap [s], so that the tap is audible separately."""

EASE_S: Final = 0.15
"""Duration of acceleration and deceleration of the stroke [s]."""

FULL_SCALE_M_S2: Final = 20.0
"""Acceleration at full scale [m/s²]: a rough texture (2 m/s² rms) has −20 dBFS, the usual level of speech. The scale is
the same for all swatches, so that their levels can be compared; sounds above full scale are attenuated."""


@dataclass(frozen=True, eq=False)
class Sound:
    """An acceleration (n,) [m/s²] at a rate [Hz]."""

    a_m_s2: NDArray[np.float64]
    rate_Hz: float


def swatch_sound(
    swatch: Swatch,
    force_N: float = FORCE_N,
    speed_m_s: float = SPEED_M_S,
    seconds: float = STROKE_S,
    approach_m_s: float = TAP_M_S,
    rate_Hz: float = ACCELERATION_RATE_HZ,
) -> Sound:
    """Synthesise the acceleration of a handle that taps on a swatch and then strokes it, with the gains of the swatch.

    Args:
        swatch: the swatch.
        force_N: normal force of the stroke [N], limited to the range of the texture.
        speed_m_s: speed of the stroke [m/s], limited to the range of the texture.
        seconds: length of the stroke [s].
        approach_m_s: speed of the tap [m/s]; 0 for no tap.
        rate_Hz: sample rate [Hz].
    """
    start, count = round(START_S * rate_Hz), round(seconds * rate_Hz)
    a = np.zeros(start + count)
    if swatch.texture is not None:
        t_s = np.arange(count) / rate_Hz
        ease = np.clip(np.minimum(t_s, seconds - t_s) / EASE_S, 0.0, 1.0)
        slide = 0.5 - 0.5 * np.cos(np.pi * ease)
        gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
        life = swatch.parameter("lpc_texture", "texture_life", 1.0)
        force, speed = np.full(count, force_N), speed_m_s * slide
        a[start:] += gain * synthesize(swatch, force, speed, rate_Hz=rate_Hz, modulation=life)
    if swatch.taps is not None and approach_m_s > 0.0:
        tap = swatch.parameter("tap", "tap_gain", 1.0) * swatch.taps.transient(approach_m_s, rate_Hz)
        length = min(len(tap), len(a))
        a[:length] += tap[:length]
    return Sound(a, rate_Hz)


def wav_bytes(sound: Sound) -> bytes:
    """Convert a sound to WAV: mono, 16 bit, with a fade at the end."""
    a_m_s2 = sound.a_m_s2.copy()
    ramp = np.linspace(0.0, 1.0, round(FADE_S * sound.rate_Hz), endpoint=False)
    a_m_s2[len(a_m_s2) - len(ramp) :] *= ramp[::-1]
    scale = max(FULL_SCALE_M_S2, float(np.abs(a_m_s2).max(initial=0.0)) / 10 ** (PEAK_DBFS / 20))
    file = io.BytesIO()
    scipy.io.wavfile.write(file, round(sound.rate_Hz), np.rint(a_m_s2 / scale * 32767).astype(np.int16))
    return file.getvalue()
