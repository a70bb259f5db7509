"""Model of the hand that holds the tool: a target position, and the impedance of the grip.

The hand is a spring and a damper between its target and the tool, a mass that moves with the tool, and an additional
force (Hogan 1985; grip models of Kuchenbecker, Park & Niemeyer 2003). Force on the tool in W:

    f = k (target − x) + b (ẋ_target − ẋ) + push
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError, no_such

__all__ = ["GRIPS", "HAND", "Grip", "grip_named", "pull"]

HAND: Final = np.dtype(
    [
        ("k_N_m", "f8"),
        ("b_Ns_m", "f8"),
        ("mass_kg", "f8"),  # moves with the tool
        ("target_m", "f8", (3,)),  # target position of the tool, in W
        ("target_m_s", "f8", (3,)),  # velocity of the target
        ("push_N", "f8", (3,)),
    ],
    align=True,
)


@dataclass(frozen=True)
class Grip:
    """Impedance of a grip: spring [N/m], damper [N·s/m], mass that moves with the tool [kg].

    Raises:
        HapsceneError: a value that is negative or not finite.
    """

    k_N_m: float
    b_Ns_m: float
    mass_kg: float = 0.0

    def __post_init__(self) -> None:
        for name in ("k_N_m", "b_Ns_m", "mass_kg"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise HapsceneError(f"grip: {name} must be finite and at least 0, is {getattr(self, name)}")

    def row(self) -> NDArray[np.float64]:
        """(3,) k_N_m, b_Ns_m, mass_kg."""
        return np.array([self.k_N_m, self.b_Ns_m, self.mass_kg])


GRIPS: Final = {
    "none": Grip(0.0, 0.0),
    "light": Grip(60.0, 0.3),
    "medium": Grip(200.0, 2.0, 0.01),
    "firm": Grip(500.0, 5.0, 0.03),
}
"""Grips by name. Walls oscillate most easily with the light one. The firm one has the spring and damper of the hand in
the handle's model. Measured grips have 50 to 800 N/m (Kuchenbecker, Park & Niemeyer 2003)."""


def grip_named(name: str) -> Grip:
    """Look up a grip of `GRIPS`.

    Raises:
        HapsceneError: unknown name.
    """
    if name not in GRIPS:
        raise HapsceneError(no_such("grip", name, GRIPS))
    return GRIPS[name]


@native
def pull(hand: np.record, axis: int, x_m: float, v_m_s: float) -> float:
    """Force of the hand along one axis of W [N] on a tool at position `x_m` with velocity `v_m_s`."""
    return float(
        hand.k_N_m * (hand.target_m[axis] - x_m) + hand.b_Ns_m * (hand.target_m_s[axis] - v_m_s) + hand.push_N[axis]
    )
