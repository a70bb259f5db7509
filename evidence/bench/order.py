"""Textures of several orders for timing, fitted to the shipped wood."""

from dataclasses import replace
from typing import Final

import numpy as np

from hapscene.capture import FitOptions, SurfaceRecording, fit_swatch, synthesize
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch

ORDERS: Final = (8, 20, 40, 80, 120)
"""Orders that are timed [coefficients]."""

FORCE_N, SPEED_M_S, DURATION_S = 1.0, 0.1, 10.0
"""Conditions and duration of the synthesised texture that is fitted."""

RATE_HZ: Final = 10_000.0


def swatch_of_order(order: int) -> Swatch:
    """Return the shipped wood with its texture played for `DURATION_S` and fitted at `order`."""
    wood = load_swatch("wood")
    count = round(DURATION_S * RATE_HZ)
    force_N, speed_m_s = np.full(count, FORCE_N), np.full(count, SPEED_M_S)
    played = synthesize(wood, force_N, speed_m_s, rate_Hz=RATE_HZ)
    fitted = fit_swatch(
        SurfaceRecording(RATE_HZ, played, force_N, speed_m_s), FitOptions(f"wood {order}", order, model_count=1)
    )
    return replace(wood, name=fitted.name, texture=fitted.texture)
