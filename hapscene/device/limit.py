"""What a device can take: the mixer keeps the two channels inside it."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hapscene.errors import HapsceneError

LIMIT: Final = np.dtype(
    [("force_N", "f8"), ("slew_N_s", "f8"), ("acceleration_m_s2", "f8"), ("fold_mass_kg", "f8")], align=True
)


@dataclass(frozen=True)
class Limits:
    """Limits of a device; infinite where it has none.

    Attributes:
        force_N: largest force of the base motors. Over it the magnitude is cut, the direction kept.
        slew_N_s: fastest change of that force.
        acceleration_m_s2: largest acceleration of the handle's actuator.
        fold_mass_kg: for a device without an actuator in the handle, the mass by which the block's mean acceleration
            is folded into the force, along the normal; 0 for a device with one.

    Raises:
        HapsceneError: a limit that is negative or NaN.
    """

    force_N: float = math.inf
    slew_N_s: float = math.inf
    acceleration_m_s2: float = math.inf
    fold_mass_kg: float = 0.0

    def __post_init__(self) -> None:
        for name in LIMIT.names or ():
            value = getattr(self, name)
            if not value >= 0.0:
                raise HapsceneError(f"limits: {name} must be at least 0, is {value}")

    def record(self) -> Any:
        """The limits as the compiled mixer reads them, (1,) LIMIT."""
        row = np.zeros(1, LIMIT).view(np.recarray)
        for name in LIMIT.names or ():
            row[name] = getattr(self, name)
        return row


IDEAL: Final = Limits()
"""A device that can do anything: what a recording holds when no device is named."""

OMNI: Final = Limits(force_N=3.3, slew_N_s=3300.0)
"""Phantom Omni with a haptography handle: 3.3 N peak by its data sheet; full force within one tick at 1 kHz."""
