"""Wall: a spring and a damper along the surface normal, which keep the tool out of the surface.

    f = max(0, K·d + (b + χ·d)·ḋ) n̂

d [m] is the penetration depth, K [N/m] the stiffness of the swatch (the framework provides `touch.normal_force_N` =
K·d, so that all effects use the same normal force), b [N·s/m] the damping and n̂ the outward unit normal. The force
never pulls, because a damper that holds back a leaving tool feels sticky. At period T the wall is passive if the
physical damping of the device exceeds K·T/2 + b (Colgate & Schenkel 1997).

χ [N·s/m²] is damping proportional to the depth (Hunt & Crossley 1975). With it, the force starts without a step at any
approach speed. At depth d the total damping is b + χ·d, so χ improves the stability of a deep contact but not that of a
light one.
"""

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import DAMPING_NS_M
from hapscene.surface.effect import Effect, Param


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the force of spring and damper [N] along the outward normal."""
    if not touch.touching:
        return
    damping_Ns_m = p.damping_Ns_m + p.hunt_crossley_Ns_m2 * touch.depth_m
    f_n_N = touch.normal_force_N + damping_Ns_m * touch.depth_rate_m_s
    if f_n_N > 0.0:
        for i in range(3):
            out.f_W_N[i] += f_n_N * touch.nhat_W[i]


EFFECT = Effect(
    "wall",
    "Spring and damper along the normal: contact stiffness.",
    render,
    params=(
        Param("damping_Ns_m", DAMPING_NS_M, "N·s/m", "damping of the contact", minimum=0.0),
        Param("hunt_crossley_Ns_m2", 0.0, "N·s/m²", "damping per depth (Hunt–Crossley)", minimum=0.0),
    ),
)
