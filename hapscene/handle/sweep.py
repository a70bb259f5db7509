"""The swept sine that a handle is identified with: its force, kept inside what actuator and coil can take."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import HandleError
from hapscene.handle.plant import Array, Plant

__all__ = ["REST_S", "TRAVEL_SHARE", "Sweep"]

BAND_HZ: Final = (10.0, ACCELERATION_BAND_HZ[1])
"""Band of the sweep [Hz]: from where the paper's begins, 10 Hz, to the end of the acceleration channel. The paper's
ends at 200 Hz; what lies above tells the mass of the handle, and the lag of amplifier and accelerometer."""

OVERSHOOT: Final = 1.06
"""How far the sweep runs past either end of its band [1], to fade in and out there. Less, and the ends of the band are
played more quietly than the rest."""

REST_S: Final = 1.0
"""Silence after the sweep [s], in which the handle comes to rest; the assumed one decays at 10/s. What still rings at
the end of the recording is missing from the response."""

TRAVEL_SHARE: Final = 0.5
"""Share of the coil's travel that the sweep may be predicted to take [1]: the plant it is predicted with is a guess."""

DETUNED: Final = 1.5
"""How far off the guessed frequency the coil's resonance may be [1], either way: the force is held down so far around
it."""

RATE_MIN: Final = 2.5
"""Least sample rate over the highest frequency [1]. At 2 the response cannot be sampled."""


@dataclass(frozen=True)
class Sweep:
    """An exponential sine sweep: the same time for every octave, so most of it where the handle answers weakest.

    Attributes:
        low_Hz, high_Hz: ends of the band that it is for.
        sweep_s: how long it takes; `REST_S` of silence follow.
        force_N: largest force; less where the coil would travel too far.

    Raises:
        HandleError: a band, duration or force that no sweep can have.
    """

    low_Hz: float = BAND_HZ[0]
    high_Hz: float = BAND_HZ[1]
    sweep_s: float = 10.0
    force_N: float = 1.0

    def __post_init__(self) -> None:
        if not 0.5 <= self.low_Hz <= 0.5 * self.high_Hz <= 5000.0:
            raise HandleError(
                f"sweep: from {self.low_Hz:g} to {self.high_Hz:g} Hz: it must begin at 0.5 Hz or above, "
                "rise at least an octave, and end at 10 kHz or below"
            )
        least_s = 20.0 / self.low_Hz
        if not least_s <= self.sweep_s <= 600.0:
            raise HandleError(f"sweep: takes {self.sweep_s:g} s; from {self.low_Hz:g} Hz it needs {least_s:g} to 600 s")
        if not 0.0 < self.force_N <= 1000.0:
            raise HandleError(f"sweep: force must be above 0 N and at most 1000 N, is {self.force_N:g}")

    def force(self, rate_Hz: float, guess: Plant) -> Array:
        """The force (n,) [N], to be held over each sample; it begins and ends with 0.

        Phase 2π f₁ (T/L)(exp(L t/T) − 1) with L = ln(f₂/f₁) (Farina 2000, "Simultaneous measurement of impulse
        response and distortion with a swept-sine technique", AES 108, eq. 2). At each moment its amplitude is
        `force_N`, or what `amplitude` says of that frequency.

        Raises:
            HandleError: a rate that is too low for the band.
        """
        if not rate_Hz >= RATE_MIN * self.high_Hz:
            most = f"at {rate_Hz:g} samples a second it can go to {rate_Hz / RATE_MIN:g} Hz"
            raise HandleError(f"sweep: {most}, not to {self.high_Hz:g} Hz")
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
        """Largest force (n,) [N] at each frequency that `force_N`, the actuator and the travel allow.

        The travel is the guessed plant's, and the largest that it has within a factor `DETUNED` of the frequency.
        """
        around = np.geomspace(1.0 / DETUNED, DETUNED, 25)
        few_Hz = frequency_Hz[:: max(1, len(frequency_Hz) // 1000)]  # it is smooth
        travel_m_N = np.abs(guess.travel_response(few_Hz[:, None] * around)).max(axis=1)
        allowed_N = np.interp(frequency_Hz, few_Hz, TRAVEL_SHARE * guess.travel_limit_m / travel_m_N)
        return np.asarray(np.minimum(allowed_N, min(self.force_N, guess.force_limit_N)))
