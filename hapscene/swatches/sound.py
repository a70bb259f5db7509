"""Sound of a swatch as WAV: a tap, then a stroke at constant force and speed.

All taps have one scale. Strokes differ by 30 dB and more, so they are played equally loud, as far as `STROKE_MAX_DBFS`
allows; `Sound.levels` states the true level and the gain. The output for devices always has the true level.
"""

import io
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.synthesis import synthesize
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.surface.resonator import SILENCE_M_S2
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
"""Acceleration at full scale without a gain [m/s²]."""

STROKE_DBFS: Final = -26.0
"""A-weighted level at which strokes are played [dBFS]."""

STROKE_MAX_DBFS: Final = -10.0
"""Largest level of a stroke, root mean square [dBFS], reached by coarse surfaces, whose vibration below 60 Hz is hardly
audible. `limited` changes at most 4 % of their samples, and audible bands by at most 1 dB."""

GAIN_MAX_DB: Final = 40.0
"""Largest gain of a stroke [dB]."""


@dataclass(frozen=True, eq=False)
class Sound:
    """An acceleration (n,) [m/s²] at a rate [Hz]: a tap, and a stroke from the sample `start` on."""

    a_m_s2: NDArray[np.float64]
    rate_Hz: float
    stroke_m_s2: float = 0.0
    """true level of the stroke, root mean square [m/s²]; that of `a_m_s2` differs by its amplitude modulation"""

    @property
    def start(self) -> int:
        """Index of the first sample of the stroke."""
        return round(START_S * self.rate_Hz)

    @cached_property
    def gain(self) -> float:
        """Factor by which the stroke is played: `loudness_gain`, at most to `STROKE_MAX_DBFS` [1]."""
        rms_m_s2 = float(np.sqrt(np.mean(np.square(self.a_m_s2[self.start :]))))
        return min(self.loudness_gain, 10 ** (STROKE_MAX_DBFS / 20) * FULL_SCALE_M_S2 / max(rms_m_s2, SILENCE_M_S2))

    @cached_property
    def loudness_gain(self) -> float:
        """Factor to an equal A-weighted level (IEC 61672-1), at most `GAIN_MAX_DB`; peaks may clip [1]."""
        stroke = self.a_m_s2[self.start :] / FULL_SCALE_M_S2
        if np.abs(stroke).max(initial=0.0) < SILENCE_M_S2 / FULL_SCALE_M_S2:
            return 1.0
        f2 = np.fft.rfftfreq(len(stroke), 1.0 / self.rate_Hz) ** 2
        weight = f2**2 / ((f2 + 20.6**2) * (f2 + 12194.0**2) * np.sqrt((f2 + 107.7**2) * (f2 + 737.9**2)))
        weighted = np.abs(np.fft.rfft(stroke)) * 1.2589 * 12194.0**2 * weight
        rms = float(np.sqrt(2.0 * np.sum(weighted**2))) / len(stroke)
        return float(min(10 ** (STROKE_DBFS / 20) / rms, 10 ** (GAIN_MAX_DB / 20)))

    @property
    def levels(self) -> str:
        """True level of the stroke, and the gain with which it is played."""
        if self.stroke_m_s2 == 0.0:
            return "no stroke"
        return f"stroke {self.stroke_m_s2:.2g} m/s² rms, played {round(20.0 * np.log10(self.gain)):+d} dB"


def swatch_sound(
    swatch: Swatch, force_N: float = FORCE_N, speed_m_s: float = SPEED_M_S, seconds: float = STROKE_S
) -> Sound:
    """Synthesise the acceleration of a handle that taps on a swatch and then strokes it, with the gains of the swatch.

    Args:
        force_N: normal force of the stroke [N], limited to the range of the texture.
        speed_m_s: speed of the stroke [m/s], limited to the range of the texture.
        seconds: length of the stroke [s].
    """
    rate_Hz = ACCELERATION_RATE_HZ
    start, count = round(START_S * rate_Hz), round(seconds * rate_Hz)
    a, stroke_m_s2 = np.zeros(start + count), 0.0
    if swatch.texture is not None:
        t_s = np.arange(count) / rate_Hz
        ease = np.clip(np.minimum(t_s, seconds - t_s) / EASE_S, 0.0, 1.0)
        slide = 0.5 - 0.5 * np.cos(np.pi * ease)
        gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
        life = swatch.parameter("lpc_texture", "texture_life", 1.0)
        force, speed = np.full(count, force_N), speed_m_s * slide
        stroke_m_s2 = gain * float(np.sqrt(swatch.texture.power([force_N], [speed_m_s])[0]))
        a[start:] += gain * synthesize(swatch, force, speed, rate_Hz=rate_Hz, modulation=life)
    if swatch.taps is not None:
        tap = swatch.parameter("tap", "tap_gain", 1.0) * swatch.taps.transient(TAP_M_S, rate_Hz)
        length = min(len(tap), len(a))
        a[:length] += tap[:length]
    return Sound(a, rate_Hz, stroke_m_s2)


def wav_bytes(sound: Sound) -> bytes:
    """Convert a sound to WAV: mono, 16 bit, the stroke with its gain, with a fade at the end."""
    played = sound.a_m_s2 / FULL_SCALE_M_S2
    played[sound.start :] *= sound.gain
    played = limited(played)
    ramp = np.linspace(0.0, 1.0, round(FADE_S * sound.rate_Hz), endpoint=False)
    played[len(played) - len(ramp) :] *= ramp[::-1]
    file = io.BytesIO()
    scipy.io.wavfile.write(file, round(sound.rate_Hz), np.rint(played * 32767).astype(np.int16))
    return file.getvalue()


def limited(played: NDArray[np.float64]) -> NDArray[np.float64]:
    """Limit samples (n,) softly to `PEAK_DBFS`; those up to 0.7 of the full scale stay the same."""
    knee, size = 0.7, np.abs(played)
    most = 10 ** (PEAK_DBFS / 20) - knee
    return np.copysign(np.minimum(size, knee) + most * np.tanh(np.maximum(size - knee, 0.0) / most), played)
