"""An effect of evenly spaced ridges: the acceleration of a tip that follows a sine of height h and wavelength λ,

    a = −h (2πv/λ)² sin(2πx/λ)

with the slip distance x and the slip speed v.
"""

import math
from typing import Any

from hapscene.surface.effect import Effect, Param, State


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the vibration of the ridges that pass under the tool in this tick [m/s²]."""
    turns = touch.slip_m_s / (p.wavelength_m * touch.rate_Hz)  # ridges per sample
    if touch.touching and turns < 0.5:  # a higher frequency would alias
        amplitude_m_s2 = p.height_m * (2.0 * math.pi * touch.slip_m_s / p.wavelength_m) ** 2
        for i in range(touch.block):
            s.phase = (s.phase + turns) % 1.0
            out.a_m_s2[i] -= amplitude_m_s2 * math.sin(2.0 * math.pi * s.phase)


EFFECT = Effect(
    "ridges",
    "Evenly spaced ridges.",
    render,
    params=(
        Param("height_m", 1e-5, "m", "height of a ridge", 0.0, 1e-3),
        Param("wavelength_m", 1e-3, "m", "distance between ridges", 1e-5, 1.0),
    ),
    state=(State("phase"),),
)
