"""A border between stiff and soft under a stroke, sharp and blended: what it gives and takes, how a tool dips there.

Alone, since all else is on one swatch. That pressed in on the soft side and lifted off on the stiff one there is energy
that nobody put in is no fault of the border's width: it is ½ (K − k) d², and no painting is without it.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hapscene.device.hand import Grip
from hapscene.device.point import PointMass
from hapscene.renderer import Renderer
from hapscene.scene.region import PlaneSide
from hapscene.scene.scene import Scene
from hapscene.stability.answer import Answer
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.swatch import Swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.twin import Twin

STIFF_N_M, SOFT_N_M = 800.0, 200.0
MASS_KG, PUSH_N, SPEED_M_S = 0.045, 0.5, 0.1
"""The tool slides over the border, pushed on to it, without friction or damping."""

DEPTH_M: Final = 2e-3
FINE_S: Final = 5e-5
"""Tick [s], at which a spring that is held over it adds little."""

Array = NDArray[np.float64]

WIDTHS_M: Final = (0.0, 0.02)

LEAD: Final = Grip(2e3, 20.0)


def border_cases() -> list[Answer]:
    """All of them, in some seconds."""
    rows = []
    for width_m in WIDTHS_M:
        kind = f"soft, {1e3 * width_m:g} mm" if width_m else "sharp"
        known = 0.5 * (STIFF_N_M - SOFT_N_M) * DEPTH_M**2
        for back, sign in ((False, 1.0), (True, -1.0)):
            way = "stiff to soft" if back else "soft to stiff"
            what = f"{kind} border, {way}: energy given out [mJ]"
            got = 1e3 * energy_J(width_m, back)
            rows.append(Answer(f"border-energy-{1e3 * width_m:g}-{way}", what, 1e3 * sign * known, got, 1e-2))
        what = f"{kind} border: deepest dip of a tool that slides over it [mm]"
        rows.append(Answer(f"border-dip-{1e3 * width_m:g}", what, 1e3 * dip_m(width_m), 1e3 * dipped_m(width_m), 2e-2))
    return rows


def painted(width_m: float) -> Scene:
    """A sheet of two faces, stiff at x < 0 and soft beyond."""
    scene = sheet(Swatch("stiff", stiffness_N_m=STIFF_N_M))
    scene.paint("sheet", Swatch("soft", stiffness_N_m=SOFT_N_M), PlaneSide((0, 0, 0), (1, 0, 0)), soft_m=width_m)
    return scene


def energy_J(width_m: float, back: bool) -> float:
    """What the wall gives a tool that goes in on one side, along at one depth, and out on the other."""
    x = np.concatenate([np.full(4000, 0.02), np.linspace(0.02, -0.02, 8000), np.full(4000, -0.02)])
    z = np.concatenate([np.linspace(1e-5, -DEPTH_M, 4000), np.full(8000, -DEPTH_M), np.linspace(-DEPTH_M, 1e-5, 4000)])
    path = np.column_stack([-x if back else x, np.full(len(x), AT_M[1]), z])
    force = Renderer(painted(width_m), ["wall"], tick_s=1e-4).run(path).f_W_N
    return float((0.5 * (force[1:] + force[:-1]) * np.diff(path, axis=0)).sum())


def dip_m(width_m: float) -> float:
    """Deepest place on the way, of m z'' = P − K(v t) z from rest: by energy over a sharp border, else by SciPy."""
    rest_m = PUSH_N / STIFF_N_M
    if width_m == 0.0:
        return 2.0 * PUSH_N / SOFT_N_M - rest_m

    def fall(t_s: float, y: Array) -> list[float]:
        share = min(SPEED_M_S * t_s / width_m, 1.0)
        return [y[1], (PUSH_N - (STIFF_N_M + share * (SOFT_N_M - STIFF_N_M)) * y[0]) / MASS_KG]

    solved = solve_ivp(fall, (0.0, 0.4), (rest_m, 0.0), rtol=1e-9, atol=1e-12, max_step=1e-3)
    return float(solved.y[0].max())


def dipped_m(width_m: float) -> float:
    """The same, by simulation."""
    twin = Twin(painted(width_m), PointMass(MASS_KG), effects=("wall",), tick_s=FINE_S, a_rate_Hz=1.0 / FINE_S)
    push = (0.0, 0.0, -PUSH_N)
    start = (-0.04, AT_M[1], -PUSH_N / STIFF_N_M)
    twin.reset((*start[:2], 1e-4))
    twin.run(Intent.hold(start, round(0.2 / FINE_S), LEAD, push_W_N=push))
    path = np.tile(start, (round(0.2 / FINE_S), 1))
    path[:, 0] += SPEED_M_S * FINE_S * np.arange(len(path))
    twin.run(Intent.along(path, LEAD, push))  # to 20 mm before the border
    return float(-twin.run(Intent.hold(start, round(0.6 / FINE_S), "none", push_W_N=push)).p_W_m[:, 2].min())
