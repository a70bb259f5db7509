"""A decaying sinusoid for effects that ring: a phasor in their state that is excited and read sample by sample.

The phasor rotates by 2πf/rate and shrinks by e^(−λ/rate) per sample; its imaginary part is the output. A strike of
amplitude A adds A to the real part, so that the output starts without a step, on top of the present vibration.
"""

import math
from typing import Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.surface.effect import State

__all__ = ["RESONATOR", "SILENCE_M_S2", "resonate", "strike"]

SILENCE_M_S2: Final = 1e-6
"""Level at which ringing ends [m/s²]: far below the detection threshold (about 1e-2), far above denormal numbers."""

RESONATOR: Final = (State("real_m_s2"), State("imag_m_s2"), State("frequency_Hz"), State("decay_1_s"))
"""State variables of an effect that rings."""


@native
def strike(s: np.record, amplitude_m_s2: float, frequency_Hz: float, decay_1_s: float) -> None:
    """Start to ring, in addition to the present vibration."""
    s.real_m_s2 += amplitude_m_s2
    s.frequency_Hz, s.decay_1_s = frequency_Hz, decay_1_s


@native
def resonate(touch: np.record, s: np.record, out: np.record) -> None:
    """Add the ringing in this tick to the acceleration [m/s²]."""
    if s.real_m_s2 == 0.0 and s.imag_m_s2 == 0.0:
        return
    if abs(s.real_m_s2) + abs(s.imag_m_s2) < SILENCE_M_S2:
        s.real_m_s2 = s.imag_m_s2 = 0.0
        return
    angle, shrink = 2.0 * math.pi * s.frequency_Hz / touch.rate_Hz, math.exp(-s.decay_1_s / touch.rate_Hz)
    cosine, sine = shrink * math.cos(angle), shrink * math.sin(angle)
    for i in range(touch.block):
        out.a_m_s2[i] += s.imag_m_s2
        real_m_s2 = cosine * s.real_m_s2 - sine * s.imag_m_s2
        s.imag_m_s2 = sine * s.real_m_s2 + cosine * s.imag_m_s2
        s.real_m_s2 = real_m_s2
