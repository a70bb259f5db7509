"""Export of an acceleration as sound: the signal that a vibration actuator would play."""

import wave
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.io.files import whole_file

__all__ = ["FADE_S", "PEAK_DBFS", "write_wave"]

PEAK_DBFS: Final = -1.0
"""Level of the loudest sample [dBFS], with headroom for resampling."""

FADE_S: Final = 0.005
"""Length of the fade at both ends [s], which avoids clicks."""


def write_wave(a_m_s2: NDArray[np.float64], rate_Hz: float, path: str | Path) -> float:
    """Write an acceleration (n,) [m/s²] as WAV: mono, 16 bit, with its sample rate [Hz].

    Returns:
        Acceleration at full scale [m/s²]; 0 for silence.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    peak_m_s2 = float(np.abs(a_m_s2).max(initial=0.0))
    full_scale_m_s2 = peak_m_s2 / 10 ** (PEAK_DBFS / 20)
    signal = a_m_s2 / full_scale_m_s2 if peak_m_s2 > 0 else np.zeros_like(a_m_s2)
    fade_count = min(round(FADE_S * rate_Hz), len(signal) // 2)
    ramp = np.linspace(0.0, 1.0, fade_count, endpoint=False)
    signal[:fade_count] *= ramp
    signal[len(signal) - fade_count :] *= ramp[::-1]
    with whole_file(path) as part, wave.open(str(part), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(rate_Hz))
        file.writeframes(np.rint(signal * 32767).astype("<i2").tobytes())
    return full_scale_m_s2
