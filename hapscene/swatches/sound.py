"""Sound of a swatch: one tap, then a stroke at a given force and speed, as WAV."""

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
"""Length of a stroke unless told otherwise [s]: long enough to tell two textures apart."""

START_S: Final = 0.25
"""From the tap to where the stroke begins [s]: the tap is heard by itself."""

EASE_S: Final = 0.15
"""How long the stroke takes to reach its speed, and to end [s]."""

FULL_SCALE_M_S2: Final = 20.0
"""Acceleration at full scale [m/s²]: a rough texture (2 m/s² rms) sounds at −20 dBFS, the usual level of speech. The
same for all swatches, so that a smooth one is heard to be quieter; what is louder than full scale is turned down."""


@dataclass(frozen=True, eq=False)
class Sound:
    """An acceleration (n,) [m/s²] at a rate [Hz]."""

    a_m_s2: NDArray[np.float64]
    rate_Hz: float

    def __repr__(self) -> str:
        return f"<Sound: {len(self.a_m_s2) / self.rate_Hz:.3g} s at {self.rate_Hz:g} Hz>"


def swatch_sound(
    swatch: Swatch,
    force_N: float = FORCE_N,
    speed_m_s: float = SPEED_M_S,
    seconds: float = STROKE_S,
    approach_m_s: float = TAP_M_S,
    rate_Hz: float = ACCELERATION_RATE_HZ,
) -> Sound:
    """What a tool's handle does that taps a swatch, then strokes it; with the swatch's own gains.

    Args:
        swatch: as it is tuned.
        force_N: pressed with while it is stroked; clamped to what its texture was made for.
        speed_m_s: stroked at, likewise.
        seconds: how long.
        approach_m_s: tapped at; 0 for no tap.
        rate_Hz: of the samples.
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
    """A sound as WAV, mono, 16 bit, its end faded. Silence stays silent."""
    a_m_s2 = sound.a_m_s2.copy()
    ramp = np.linspace(0.0, 1.0, round(FADE_S * sound.rate_Hz), endpoint=False)
    a_m_s2[len(a_m_s2) - len(ramp) :] *= ramp[::-1]
    scale = max(FULL_SCALE_M_S2, float(np.abs(a_m_s2).max(initial=0.0)) / 10 ** (PEAK_DBFS / 20))
    file = io.BytesIO()
    scipy.io.wavfile.write(file, round(sound.rate_Hz), np.rint(a_m_s2 / scale * 32767).astype(np.int16))
    return file.getvalue()
