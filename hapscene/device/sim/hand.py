"""The hand that holds the tool: what it intends, and how firmly it insists on it.

A hand is a spring and a damper from where it means the tool to be, a mass that moves with the tool, and a push of its
own (Hogan 1985; the grip models of Kuchenbecker, Park & Niemeyer 2003). Force on the tool, in W:

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
        ("target_m", "f8", (3,)),  # where the hand means the tool to be, in W
        ("target_m_s", "f8", (3,)),  # how fast that place moves
        ("push_N", "f8", (3,)),
    ],
    align=True,
)


@dataclass(frozen=True)
class Grip:
    """How firmly the tool is held: spring [N/m], damper [N·s/m], mass that moves with the tool [kg].

    Raises:
        HapsceneError: a number that is negative or not finite.
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
"""Grips by name. The light one is where walls bounce most easily; the firm one has the spring and damper that the
handle's model takes the hand for. Measured grips lie between (Kuchenbecker, Park & Niemeyer 2003: 50 to 800 N/m)."""


def grip_named(name: str) -> Grip:
    """A grip of `GRIPS`.

    Raises:
        HapsceneError: no grip of this name.
    """
    if name not in GRIPS:
        raise HapsceneError(no_such("grip", name, GRIPS))
    return GRIPS[name]


@native
def pull(hand: np.record, axis: int, x_m: float, v_m_s: float) -> float:
    """Force of the hand on a tool at `x_m` that moves at `v_m_s`, along one axis of W [N]."""
    return float(
        hand.k_N_m * (hand.target_m[axis] - x_m) + hand.b_Ns_m * (hand.target_m_s[axis] - v_m_s) + hand.push_N[axis]
    )
