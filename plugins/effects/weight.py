"""The weight of what the tool is: a constant force in the hand, in contact and in the air.

    f = m g

with mass m [kg] and gravity g [m/s²] in F (W, or a body that is named: a cabin that tilts). f follows m g by a low-pass
of `ease_s`: after a reset, and where another mass is taken up (`Renderer.tune_field`), the hand feels no jump. The
first tick of 1 ms has 2 % of it at 50 ms, 0.04 N of 0.2 kg, less than the dry friction of most devices.

It is weight alone; inertia would be a force by acceleration, which encoders do not give.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.field_frame import EASE_S, add_force


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the weight [N]."""
    share = -math.expm1(-touch.tick_s / p.ease_s)
    s.f_N[0] += share * (p.mass_kg * p.gravity_x_m_s2 - s.f_N[0])
    s.f_N[1] += share * (p.mass_kg * p.gravity_y_m_s2 - s.f_N[1])
    s.f_N[2] += share * (p.mass_kg * p.gravity_z_m_s2 - s.f_N[2])
    add_force(out, table, 1.0, (s.f_N[0], s.f_N[1], s.f_N[2]))


EFFECT = Effect(
    "weight",
    "What the tool weighs in the hand.",
    render,
    params=(
        Param("mass_kg", 0.1, "kg", "what the tool weighs", 0.0, 100.0),
        Param("gravity_x_m_s2", 0.0, "m/s²", "gravity along x", -100.0, 100.0),
        Param("gravity_y_m_s2", 0.0, "m/s²", "gravity along y", -100.0, 100.0),
        Param("gravity_z_m_s2", -9.81, "m/s²", "gravity along z", -100.0, 100.0),
        Param("ease_s", EASE_S, "s", "time constant by which a new weight is taken up", 1e-3, 10.0),
    ),
    state=(State("f_N", (3,)),),
    scope="scene",
)
