"""A wall: what keeps the tool out of a surface, a spring and a damper along its normal.

    f = max(0, K·d + b·ḋ) n̂

with depth d [m], stiffness K [N/m] of the swatch (the framework has made `touch.normal_force_N` = K·d of
it, so that all effects press alike), damping b [N·s/m] and the outward unit normal n̂. It never pulls: a
damper that holds back a leaving tool feels sticky. Rendered at period T it is passive while the device's
own damping is above K·T/2 + b (Colgate & Schenkel 1997).
"""

from typing import Any

from hapscene.constants import DAMPING_NS_M
from hapscene.surface.effect import Effect, Param


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the force of spring and damper [N], along the outward normal."""
    if not touch.touching:
        return
    f_n_N = touch.normal_force_N + p.damping_Ns_m * touch.depth_rate_m_s
    if f_n_N > 0.0:
        for i in range(3):
            out.f_W_N[i] += f_n_N * touch.nhat_W[i]


EFFECT = Effect(
    "wall",
    "Spring and damper along the normal: shape and stiffness.",
    render,
    params=(Param("damping_Ns_m", DAMPING_NS_M, "N·s/m", "resists being pressed in; lets the tool go", minimum=0.0),),
)
