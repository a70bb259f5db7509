"""How leader and follower are tied together."""

import math
from dataclasses import dataclass
from typing import Final

from hapscene.errors import HapsceneError, no_such

SCHEMES: Final = ("position", "wave")
"""Names of the schemes: the position–position controller, and wave variables (see `port`, `wave`)."""

TIMEOUT_S: Final = 0.1
"""Silence of the peer after which the motors let go [s]. A line that loses half of its messages at random is silent as
long once in 1e30 ticks. Longer, and the position–position controller pulls for so long to where a peer has died."""


@dataclass(frozen=True)
class Coupling:
    """How leader and follower are tied together; both ends must have the same.

    Attributes:
        scheme: one of `SCHEMES`.
        stiffness_N_m, damping_Ns_m: of the spring and damper between the two, K and B.
        impedance_Ns_m: b of the waves. Higher is a stiffer line (b over the delay) and a heavier one (b times it).
        margin_s: what a message may be late without being missed; adds to the delay.
        cutoff_Hz: of the one-pole low-pass on positions that velocities are taken from. An encoder step of 55 µm in
            1 ms is 55 mm/s; at 50 Hz a quarter of it is left.
        force_limit_N: of the motors.
        allowance_J: what each end may give out at the start; covers the rounding of encoders.
        reserve_J: most energy that is kept for later; the rest is thrown away, so that nothing can live on it.
        timeout_s: silence after which the motors let go.

    Raises:
        HapsceneError: an unknown scheme, or a number out of range.
    """

    scheme: str = "wave"
    stiffness_N_m: float = 500.0
    damping_Ns_m: float = 3.0
    impedance_Ns_m: float = 3.0
    margin_s: float = 0.0
    cutoff_Hz: float = 50.0
    force_limit_N: float = 3.3
    allowance_J: float = 1e-3
    reserve_J: float = 20e-3
    timeout_s: float = TIMEOUT_S

    def __post_init__(self) -> None:
        if self.scheme not in SCHEMES:
            raise HapsceneError(no_such("scheme", self.scheme, SCHEMES))
        for name in ("stiffness_N_m", "impedance_Ns_m", "cutoff_Hz", "timeout_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise HapsceneError(f"coupling: {name} must be above 0 and finite, is {getattr(self, name):g}")
        for name in ("damping_Ns_m", "margin_s", "force_limit_N", "allowance_J", "reserve_J"):
            if not getattr(self, name) >= 0.0:
                raise HapsceneError(f"coupling: {name} must be at least 0, is {getattr(self, name):g}")
        if math.isinf(self.damping_Ns_m) or math.isinf(self.margin_s):
            raise HapsceneError("coupling: damping_Ns_m and margin_s must be finite")
