"""What stands between force command and acceleration sample, and is not the handle: amplifier, accelerometer, delay."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.handle.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def sampled_response(
    plant: Plant, frequency_Hz: ArrayLike, rate_Hz: float, amplifier_s: float, accelerometer_s: float, delay_s: float
) -> Complex:
    """Acceleration samples over force commands, at frequencies of any shape [1/kg].

    A command is held over its sample (zero-order hold). Amplifier and accelerometer are one pole each, with the time
    constants given, 0 for none; what the accelerometer gives is sampled as the next command begins, and comes
    `delay_s` later than that.

    A held command has images around the multiples of the rate; sampling folds them back. At high frequency the plant is
    1/m_h, and passes them. So that path is taken as the sampled system that it is: with z = exp(jωT),
    G = 1 − [τ (z−1)/(z−e^(−T/τ)) − σ (z−1)/(z−e^(−T/σ))]/(τ−σ), the zero-order hold of 1/((1+τs)(1+σs)) by partial
    fractions. The rest of the plant, H − 1/m_h, falls with frequency; it is taken as continuous, times the hold's
    e^(−jωT/2) sinc. Its images, left out so, are 3e-5 of the response at 10 kHz, 4e-4 at 5 kHz, 2e-3 at 3 kHz.
    """
    frequency = np.asarray(frequency_Hz, dtype=np.float64)
    s, period_s = 2j * np.pi * frequency, 1.0 / rate_Hz
    z = np.exp(s * period_s)
    tau, sigma = amplifier_s, accelerometer_s
    if abs(tau - sigma) < 1e-4 * (tau + sigma):
        sigma *= 1.001  # the limit of two equal poles, to 1e-7
    direct = 1.0 - (_remainder(tau, z, period_s) - _remainder(sigma, z, period_s)) / (tau - sigma or 1.0)
    hold = np.sinc(frequency * period_s) * np.exp(-0.5 * s * period_s)
    rest = (plant.response(frequency) - 1.0 / plant.m_h_kg) * hold / ((1.0 + tau * s) * (1.0 + sigma * s))
    return np.asarray((rest + direct / plant.m_h_kg) * np.exp(-s * delay_s))


def _remainder(tau: float, z: Complex, period_s: float) -> Complex:
    """τ (z−1)/(z−e^(−T/τ)), the part of a step that is still to come; 0 without a pole."""
    pole = np.exp(-period_s / tau) if tau > 0.0 else 0.0
    return np.asarray(tau * (z - 1.0) / (z - pole))
