"""What a device can take: the mixer keeps the two channels inside it, and walls are made no stiffer than it holds."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hapscene.errors import HapsceneError

DELAY_MAX: Final = 63
"""Longest delay that the passivity controller reckons with [ticks]. Sets the size of its memory of forces sent."""


class DeviceWarning(UserWarning):
    """The device takes less of a swatch than it asks for."""


LIMIT: Final = np.dtype(
    [
        ("force_N", "f8"),
        ("slew_N_s", "f8"),
        ("acceleration_m_s2", "f8"),
        ("fold_mass_kg", "f8"),
        ("guard_Ns_m", "f8"),
        ("quantum_m", "f8"),
        ("coupling_N_m", "f8"),
        ("coupling_Ns_m", "f8"),
        ("delay_ticks", "i8"),
    ],
    align=True,
)


@dataclass(frozen=True)
class Limits:
    """Limits of a device, infinite where it has none, and the stabilisers that the tick has for it, 0 for none.

    `hapscene.device.model.limits_of` finds those of a named device.

    Attributes:
        force_N: largest force of the base motors. Over it the magnitude is cut, the direction kept.
        slew_N_s: fastest change of that force.
        acceleration_m_s2: largest acceleration of the handle's actuator.
        fold_mass_kg: for a device without an actuator in the handle, the mass by which the block's mean acceleration
            is folded into the force, along the normal; 0 for a device with one.
        own_damping_Ns_m: the device's own damping, by which a swatch's acceleration is folded in no further than
            motors hold it (`hapscene.surface.fold`); infinite to fold in all of it.
        stiffness_N_m: stiffest wall. A swatch over it is rendered at it.
        damping_Ns_m: most damping of a wall.
        undamped_N_m: stiffest wall without damping, and stiffest spring of any other kind, as friction's.
        damping_time_s: damping that a wall is given for what it is stiffer than `undamped_N_m`, by the stiffness.
        guard_Ns_m: most damping that the passivity controller injects (`hapscene.device.guard`).
        quantum_m: step of the encoders, which that controller reckons with.
        coupling_N_m, coupling_Ns_m: spring and damper of a virtual coupling (`hapscene.device.coupling`).
        delay_ticks: how many ticks later than its tick a force goes out.
        device: what messages call it.

    Raises:
        HapsceneError: a limit that is negative or NaN, a delay that is not 0 to `DELAY_MAX`.
    """

    force_N: float = math.inf
    slew_N_s: float = math.inf
    acceleration_m_s2: float = math.inf
    fold_mass_kg: float = 0.0
    own_damping_Ns_m: float = math.inf
    stiffness_N_m: float = math.inf
    damping_Ns_m: float = math.inf
    undamped_N_m: float = math.inf
    damping_time_s: float = 0.0
    guard_Ns_m: float = 0.0
    quantum_m: float = 0.0
    coupling_N_m: float = 0.0
    coupling_Ns_m: float = 0.0
    delay_ticks: int = 0
    device: str = "device"

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "device" and not value >= 0.0:
                raise HapsceneError(f"limits: {name} must be at least 0, is {value}")
        if self.delay_ticks % 1 != 0 or self.delay_ticks > DELAY_MAX:
            raise HapsceneError(f"limits: delay_ticks must be a whole number up to {DELAY_MAX}, is {self.delay_ticks}")
        if math.isinf(self.coupling_N_m) or math.isinf(self.coupling_Ns_m):
            raise HapsceneError("limits: coupling_N_m and coupling_Ns_m must be finite; 0 is no coupling")

    def record(self) -> Any:
        """The limits as the compiled tick reads them, (1,) LIMIT."""
        row = np.zeros(1, LIMIT).view(np.recarray)
        for name in LIMIT.names or ():
            row[name] = getattr(self, name)
        return row


IDEAL: Final = Limits()
"""A device that can do anything: what a recording holds when no device is named."""
