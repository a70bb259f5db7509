"""How loud a surface is, over force and speed: the law that a recording's pieces follow.

Power = c F^α v^β, fitted to the pieces' levels in dB. From one recording the exponents are hardly known: a hand that
strokes for a second or two changes force and speed by a tenth or two, while levels scatter by 2 to 4 dB for reasons of
the surface's own; exponents of plain least squares were off by 7 dB on the other half of a recording. So they start
from what friction gives, and move as far as the pieces say (a Gaussian prior, the posterior mean): a sliding tool turns
F v of power per unit of friction into heat and vibration, so that vibration of one efficiency has α = β = 1.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.piece import Pieces

Array = NDArray[np.float64]

EXPONENT: Final = 1.0
"""Exponent of force and of speed that is expected [1]: power in proportion to that of friction. On halves, thirds and
quarters of wood, paper and leather, each predicted from each other, the mean square error of the level was 0.6 times
that of a level that depends on neither."""

EXPONENT_SPREAD: Final = 0.5
"""Standard deviation of an exponent about that [1]: between a half and one and a half, most likely. Halved or doubled,
the level on the held-out halves of wood, paper and leather changes by 0.25 dB at most."""

SCATTER_DB: Final = 0.5
"""Least scatter of the levels about the law [dB]: that of a tenth of a second of noise 1 kHz wide."""

_DB: Final = 10.0 / np.log(10.0)


def fit_level(pieces: Pieces) -> Callable[[Array, Array], Array]:
    """The power [(m/s²)²] that pieces have at forces [N] and speeds [m/s] (n,), their own mean power kept."""
    power = np.mean(pieces.acceleration_m_s2**2, axis=1)
    level = np.log(np.maximum(power, 1e-12 * power.mean() + 1e-300))
    place = np.stack([np.log(pieces.force_N), np.log(pieces.speed_m_s)], axis=1)
    centre = place.mean(axis=0)
    away, expected = place - centre, np.full(2, EXPONENT)
    exponent = expected
    for _ in range(3):
        scatter = max(float(np.std(level - away @ exponent)), SCATTER_DB / _DB)
        weight = (EXPONENT_SPREAD / scatter) ** 2
        information = weight * away.T @ away + np.eye(2)
        exponent = np.linalg.solve(information, weight * away.T @ (level - level.mean()) + expected)
    scale = power.sum() / np.exp(away @ exponent).sum()

    def law(force_N: Array, speed_m_s: Array) -> Array:
        return np.asarray(scale * np.exp((np.stack([np.log(force_N), np.log(speed_m_s)], axis=1) - centre) @ exponent))

    return law
