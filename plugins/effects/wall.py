"""A wall: what keeps the tool out of a surface, a spring and a damper along its normal.

    f = max(0, K·d + (b + χ·d)·ḋ) n̂

with depth d [m], stiffness K [N/m] of the swatch (the framework has made `touch.normal_force_N` = K·d of
it, so that all effects press alike), damping b [N·s/m] and the outward unit normal n̂. It never pulls: a
damper that holds back a leaving tool feels sticky. Rendered at period T it is passive while the device's
own damping is above K·T/2 + b (Colgate & Schenkel 1997).

χ [N·s/m²] damps the more the deeper the tool is (Hunt & Crossley 1975): the force begins without a step, however
fast the tool comes. At a depth d it is a damper of b + χ·d, so it helps a wall to be stable where it is pressed, and
not where it is hardly touched.
"""

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import DAMPING_NS_M
from hapscene.surface.effect import Effect, Param


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the force of spring and damper [N], along the outward normal."""
    if not touch.touching:
        return
    damping_Ns_m = p.damping_Ns_m + p.hunt_crossley_Ns_m2 * touch.depth_m
    f_n_N = touch.normal_force_N + damping_Ns_m * touch.depth_rate_m_s
    if f_n_N > 0.0:
        for i in range(3):
            out.f_W_N[i] += f_n_N * touch.nhat_W[i]


EFFECT = Effect(
    "wall",
    "Spring and damper along the normal: shape and stiffness.",
    render,
    params=(
        Param("damping_Ns_m", DAMPING_NS_M, "N·s/m", "resists being pressed in; lets the tool go", minimum=0.0),
        Param("hunt_crossley_Ns_m2", 0.0, "N·s/m²", "the same, growing with the depth", minimum=0.0),
    ),
)
