"""The swept sine for the identification of a handle, within the limits of actuator and coil."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import HandleError
from hapscene.handle.plant import Array, Plant

__all__ = ["REST_S", "TRAVEL_SHARE", "Sweep"]

BAND_HZ: Final = (10.0, ACCELERATION_BAND_HZ[1])
"""Band of the sweep [Hz]: from 10 Hz, as in the paper, to the end of the acceleration channel. The paper's sweep ends
at 200 Hz; higher frequencies determine the mass of the handle and the lag of amplifier and accelerometer."""

OVERSHOOT: Final = 1.06
"""Factor by which the sweep extends beyond both ends of its band, for the fades [1]. With less, the fades reduce the
force at the ends of the band."""

REST_S: Final = 1.0
"""Silence after the sweep, in which the handle comes to rest [s]; the assumed handle decays at 10/s. Vibration after
the end of the recording is missing from the response."""

TRAVEL_SHARE: Final = 0.5
"""Share of the coil's travel that the sweep may use according to the guessed plant [1]."""

DETUNED: Final = 1.5
"""Ratio by which the resonance of the coil may differ from the guess, in both directions [1]. The force is reduced in
this range around the resonance."""

RATE_MIN: Final = 2.5
"""Lowest ratio of sample rate to highest frequency [1]. At 2 the response cannot be sampled."""


@dataclass(frozen=True)
class Sweep:
    """An exponential sine sweep: equal time for each octave, so that low frequencies, where the response is weak, get
    most.

    Attributes:
        low_Hz, high_Hz: band [Hz].
        sweep_s: duration [s]; `REST_S` of silence follow.
        force_N: force amplitude [N]; reduced where the coil would travel too far.

    Raises:
        HandleError: band, duration or force out of range.
    """

    low_Hz: float = BAND_HZ[0]
    high_Hz: float = BAND_HZ[1]
    sweep_s: float = 10.0
    force_N: float = 1.0

    def __post_init__(self) -> None:
        if not 0.5 <= self.low_Hz <= 0.5 * self.high_Hz <= 5000.0:
            raise HandleError(
                f"sweep: band {self.low_Hz:g} to {self.high_Hz:g} Hz is invalid: it must start at 0.5 Hz or above, "
                "span an octave or more, and end at 10 kHz or below"
            )
        least_s = 20.0 / self.low_Hz
        if not least_s <= self.sweep_s <= 600.0:
            raise HandleError(
                f"sweep: duration {self.sweep_s:g} s is out of range: from {self.low_Hz:g} Hz, {least_s:g} to 600 s"
            )
        if not 0.0 < self.force_N <= 1000.0:
            raise HandleError(f"sweep: force must be above 0 N and at most 1000 N, is {self.force_N:g}")

    def force(self, rate_Hz: float, guess: Plant) -> Array:
        """The force (n,) [N], constant over each sample. It starts and ends with 0.

        Phase 2π f₁ (T/L)(exp(L t/T) − 1) with L = ln(f₂/f₁) (Farina 2000, "Simultaneous measurement of impulse
        response and distortion with a swept-sine technique", AES 108, eq. 2). The amplitude is `force_N`, or that of
        `amplitude` where it is lower.

        Raises:
            HandleError: the rate is too low for the band.
        """
        if not rate_Hz >= RATE_MIN * self.high_Hz:
            raise HandleError(
                f"sweep: highest frequency {self.high_Hz:g} Hz is too high for a sample rate of {rate_Hz:g} Hz: "
                f"at most {rate_Hz / RATE_MIN:g} Hz"
            )
        first, last = self.low_Hz / OVERSHOOT, min(self.high_Hz * OVERSHOOT, 0.49 * rate_Hz)
        octaves = np.log(last / first)
        t_s = np.arange(round(self.sweep_s * rate_Hz)) / rate_Hz
        growth = np.exp(octaves * t_s / self.sweep_s)
        wave = np.sin(2.0 * np.pi * first * self.sweep_s / octaves * (growth - 1.0))
        fade_s = self.sweep_s * np.log(OVERSHOOT) / octaves
        fade = np.clip(np.minimum(t_s, self.sweep_s - t_s) / fade_s, 0.0, 1.0)
        force_N = self.amplitude(first * growth, guess) * np.sin(0.5 * np.pi * fade) ** 2 * wave
        return np.concatenate([force_N, np.zeros(round(REST_S * rate_Hz))])

    def amplitude(self, frequency_Hz: Array, guess: Plant) -> Array:
        """Largest force (n,) [N] at each frequency within `force_N`, the actuator's limit and the travel.

        The travel is the largest that the guessed plant has within a factor `DETUNED` of the frequency.
        """
        around = np.geomspace(1.0 / DETUNED, DETUNED, 25)
        few_Hz = frequency_Hz[:: max(1, len(frequency_Hz) // 1000)]  # the travel is smooth
        travel_m_N = np.abs(guess.travel_response(few_Hz[:, None] * around)).max(axis=1)
        allowed_N = np.interp(frequency_Hz, few_Hz, TRAVEL_SHARE * guess.travel_limit_m / travel_m_N)
        return np.asarray(np.minimum(allowed_N, min(self.force_N, guess.force_limit_N)))
