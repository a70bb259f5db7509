"""Helper functions for effects of the scene: frame, fading, start after a reset, and array settings.

The frame F of an effect is the frame of the first body in its setting `bodies`, or W without bodies. In the table of
the effect, the poses of the bodies come first, then the numbers of the effect."""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import EffectError
from hapscene.geometry import Vector

__all__ = ["EASE_S", "FADED_MOST", "add_force", "eased", "fade", "field_array", "to_frame", "turn"]

POINT_MAX: Final = 1000
"""Most points of a field [count]; each costs about 5 ns per tick."""

EASE_S: Final = 0.05
"""Rise time of a field after a reset [s]: without it, a tool that starts inside a field would be kicked."""


@native
def to_frame(table: NDArray[np.float64], p_W: Vector | NDArray[np.float64]) -> Vector:
    """Transform a point from W to F."""
    x, y, z = p_W[0] - table[9], p_W[1] - table[10], p_W[2] - table[11]
    return (
        table[0] * x + table[3] * y + table[6] * z,
        table[1] * x + table[4] * y + table[7] * z,
        table[2] * x + table[5] * y + table[8] * z,
    )


@native
def turn(table: NDArray[np.float64], v_F: Vector) -> Vector:
    """Rotate a vector from F to W."""
    x, y, z = v_F
    return (
        table[0] * x + table[1] * y + table[2] * z,
        table[3] * x + table[4] * y + table[5] * z,
        table[6] * x + table[7] * y + table[8] * z,
    )


@native
def add_force(out: np.record, table: NDArray[np.float64], size: float, f_F: Vector) -> None:
    """Add `size` times a vector in F to the force in W."""
    f = turn(table, f_F)
    for i in range(3):
        out.f_W_N[i] += size * f[i]


@native
def fade(ratio2: float) -> float:
    """Return (1 − q²)² for q² = (d/r)²: 1 at the centre of a field, 0 from its radius r on, with continuous slope.

    A spring of stiffness K with this factor has the force K d (1 − q²)², the gradient of K r²/6 (1 − (1 − q²)³). It
    is nowhere stiffer than K, and its force is largest at d = r/√5.
    """
    return float((1.0 - ratio2) ** 2) if ratio2 < 1.0 else 0.0


FADED_MOST: Final = 16.0 / 25.0 / math.sqrt(5.0)
"""Largest force of a faded spring, relative to K r [1], at d = r/√5."""


@native
def eased(touch: np.record) -> float:
    """Return the share of a field's force since the last reset [1]: 0 in the first tick, 1 after `EASE_S`."""
    return float(min(1.0, touch.tick * touch.tick_s / EASE_S))


def field_array(effect: str, settings: Mapping[str, object], name: str, rows: str) -> NDArray[np.float64]:
    """Return a setting as an array (n, 3); `rows` describes the rows in the error message.

    Raises:
        EffectError: the setting is not rows of three finite numbers, or has more than `POINT_MAX` rows.
    """
    try:
        array = np.atleast_2d(np.asarray(settings[name], np.float64))
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0 or not np.isfinite(array).all():
        raise EffectError(f"effect {effect!r} needs {name}, {rows}: settings={{{effect!r}: {{{name!r}: [[x, y, z]]}}}}")
    if len(array) > POINT_MAX:
        raise EffectError(f"effect {effect!r}: {name} has {len(array):,} rows; expected at most {POINT_MAX:,}")
    return array
