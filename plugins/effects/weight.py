"""Weight of the virtual tool: a constant force on the hand, with and without contact.

    f = m g

m [kg] is the mass and g [m/s²] the gravity in the frame F (W, or a named body, for example a tilting cabin). f follows
m g through a low-pass with time constant `ease_s`, so that there is no step after a reset or when the mass changes
(`Renderer.tune_field`). With 50 ms, the first tick of 1 ms has 2 % of the weight: 0.04 N for 0.2 kg, which is less than
the dry friction of most devices.

The effect does not render inertia, because a force proportional to acceleration cannot be derived from encoders.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.field_frame import EASE_S, add_force


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the weight [N]."""
    share = -math.expm1(-touch.tick_s / p.ease_s)
    s.f_N[0] += share * (p.mass_kg * p.gravity_x_m_s2 - s.f_N[0])
    s.f_N[1] += share * (p.mass_kg * p.gravity_y_m_s2 - s.f_N[1])
    s.f_N[2] += share * (p.mass_kg * p.gravity_z_m_s2 - s.f_N[2])
    add_force(out, table, 1.0, (s.f_N[0], s.f_N[1], s.f_N[2]))


EFFECT = Effect(
    "weight",
    "Weight of the virtual tool.",
    render,
    params=(
        Param("mass_kg", 0.1, "kg", "mass of the tool", 0.0, 10.0),
        Param("gravity_x_m_s2", 0.0, "m/s²", "gravity along x", -100.0, 100.0),
        Param("gravity_y_m_s2", 0.0, "m/s²", "gravity along y", -100.0, 100.0),
        Param("gravity_z_m_s2", -9.81, "m/s²", "gravity along z", -100.0, 100.0),
        Param("ease_s", EASE_S, "s", "time constant of a change of weight", 1e-3, 10.0),
    ),
    state=(State("f_N", (3,)),),
    scope="scene",
)
