"""The question of the stabiliser: which one keeps a stiff wall stable, and at what loss of stiffness."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.device.model import (
    DEVICES,
    IDEAL,
    PASSIVITY_SHARE,
    Device,
    DeviceWarning,
    Limits,
    damping_for,
    damping_max,
    limits_of,
)
from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.twin import Twin
from hapscene.perception import COMPLIANCE
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.swatch import Swatch

from .measuring import spread_us, stroke_path, ticks_ns
from .question import Measure, Question, Setting

OUT_J: Final = 2e-3
"""Energy given to the hand above which a stabiliser is not recommended [J]: that of a weak tap."""

REST_M_S: Final = 5e-3
"""Rms speed below which the tool counts as at rest [m/s]."""

COUPLING_N_M: Final = 200.0
"""Stiffness of the virtual coupling that is tried [N/m]."""

PUSH_N: Final = 2.0
"""Force with which the hand pushes while the stiffness is measured [N]; encoder steps are then negligible."""

FACET_M: Final = 0.01
FACET_RAD: Final = math.radians(15.0)
FACETS: Final = 6
"""The ridge of the edge tour: width of its faces, angle between adjacent faces, number of faces."""

BARE: Final = Device("point mass", PointMass(0.045, 0.1), IDEAL)
"""The Omni without friction and encoder steps: only its damping dissipates energy."""

GESTURES: Final = ("tap", "press", "tour")
STABILISERS: Final = (
    "none",
    "limits",
    "virtual damping",
    "passivity",
    "coupling",
    "limits, passivity",
)
"""Stabilisers that are tried."""
DEFAULT: Final = STABILISERS[-1]
"""The stabiliser that hapscene uses."""


@dataclass(frozen=True)
class Stabiliser:
    """Settings of a stabiliser.

    Attributes:
        limits: limits of the renderer.
        damping_Ns_m: damping of the wall.
    """

    limits: Limits = IDEAL
    damping_Ns_m: float = 0.0


class Outcome(NamedTuple):
    """Result of one stabiliser in one case."""

    rest_speed_m_s: float
    """Rms speed of the tool when it should be at rest."""
    energy_J: float
    """Maximum over time of the net energy that the motors have given to the hand."""
    kept: float
    """Rendered stiffness over requested stiffness; NaN if the tool does not come to rest."""


def stabiliser(name: str, device: Device, stiffness_N_m: float, tick_s: float = TICK_S) -> Stabiliser:
    """Return the settings of one of `STABILISERS` for a device and a wall."""
    point = device.point
    assert point is not None
    limits = limits_of(device, tick_s)
    return {
        "none": Stabiliser(),
        "limits": Stabiliser(replace(limits, passivity_Ns_m=0.0)),
        "virtual damping": Stabiliser(damping_Ns_m=damping_for(device, stiffness_N_m, tick_s)),
        "passivity": Stabiliser(Limits(passivity_Ns_m=PASSIVITY_SHARE * damping_max(point.mass_kg, tick_s))),
        "coupling": Stabiliser(Limits(coupling_N_m=COUPLING_N_M)),
        "limits, passivity": Stabiliser(limits),
    }[name]


def run_case(device: Device, gesture: str, stiffness_N_m: float, name: str) -> Outcome:
    """Run one of `STABILISERS` with one of `GESTURES`, with a light grip at 1 kHz."""
    point = device.point
    assert point is not None
    chosen = stabiliser(name, device, stiffness_N_m)
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=chosen.damping_Ns_m)
    scene = ridge(swatch) if gesture == "tour" else sheet(swatch)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeviceWarning)  # that the limits clip the wall is what is tested
        twin = Twin(scene, point, effects=("wall",), a_rate_Hz=1.0 / TICK_S, limits=chosen.limits)
    target = _target(gesture)
    result = twin.run(ReferenceTrajectory.along(target, "light"))
    at_end_m_s = result.v_W_m_s[-1000:]
    rest_speed_m_s = float(np.sqrt(np.mean(np.sum(at_end_m_s**2, axis=1))))
    kept = _rendered_stiffness(twin, target[-1]) / stiffness_N_m if rest_speed_m_s < REST_M_S else math.nan
    energy_J = max(0.0, float(np.cumsum(result.work_J).max()))
    return Outcome(rest_speed_m_s, energy_J, kept)


def _target(gesture: str) -> NDArray[np.float64]:
    """Return the reference trajectory of the hand (n, 3)."""
    if gesture == "tour":
        half = 0.9 * FACETS * FACET_RAD / 2.0
        angle = np.concatenate((np.linspace(-half, half, 1500), np.linspace(half, -half, 1500), np.full(1500, -half)))
        radius = ridge_radius_m() - np.repeat((-0.001, 0.008, 0.016, 0.008), (50, 1450, 1500, 1500))
        return np.asarray(radius[:, None] * np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1))
    start, end, speed = (0.01, -0.005, 0.15) if gesture == "tap" else (0.001, -0.005, 0.02)
    height = np.full(3000, end)
    way = round((start - end) / speed / TICK_S)
    height[:way] = np.linspace(start, end, way)
    return np.column_stack((np.full(3000, AT_M[0]), np.full(3000, AT_M[1]), height))


def _rendered_stiffness(twin: Twin, target_W_m: NDArray[np.float64]) -> float:
    """Return force over depth while the hand pushes [N/m]."""
    down = target_W_m / np.linalg.norm(target_W_m) if abs(target_W_m[2]) > 0.01 else np.array((0.0, 0.0, 1.0))
    result = twin.run(ReferenceTrajectory.hold(tuple(target_W_m), 1500, GRIPS["light"], push_W_N=tuple(-PUSH_N * down)))
    force = np.linalg.norm(result.f_motor_W_N[-500:].mean(axis=0))
    depth = np.linalg.norm((result.recording.p_WP_m - result.p_W_m)[-500:].mean(axis=0))
    return float(force / depth)


def ridge_radius_m(width_m: float = FACET_M, turn_rad: float = FACET_RAD) -> float:
    """Return the distance of the ridge's faces from its axis [m]."""
    return width_m / (2.0 * math.tan(turn_rad / 2.0))


def ridge(swatch: Swatch, count: int = FACETS, width_m: float = FACET_M, turn_rad: float = FACET_RAD) -> Scene:
    """Return a scene of `count` flat faces, `width_m` wide; adjacent faces differ by `turn_rad` about the y axis.

    The middle of the ridge, an edge or a face, is at the top.
    """
    corner_radius = width_m / (2.0 * math.sin(turn_rad / 2.0))
    angle = turn_rad * (np.arange(count + 1) - 0.5 * count)
    rim = corner_radius * np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1)
    end = np.array((0.0, 0.05, 0.0))
    corners = np.concatenate((rim - end, rim + end))
    i = np.arange(count)
    j = i + 1 + count
    faces = np.concatenate((np.stack((i, i + 1, j + 1), axis=1), np.stack((i, j + 1, j), axis=1)))
    scene = Scene()
    scene.add(Mesh(corners, faces.astype(np.int32)), name="ridge", swatch=swatch)
    return scene


STIFFNESSES_N_M: Final = (2000.0, 5000.0)

TOUCHED: Final = {"omni": DEVICES["omni"], "bare": BARE}
"""The Omni, and the same without friction and encoder steps."""

MM_S, MJ, COMPLIANCE_MAX = (0.01, 1e4), (1e-3, 1e3), 1e4
"""Smallest and largest values that are stored; an unstable loop has no finite value."""


def settings(scene_file: str | None) -> list[Setting]:
    return [
        Setting(
            *("Stabiliser of a stiff wall", name, ""),
            {"name": name, "device": d, "stiffness_N_m": k, "gestures": GESTURES},
            case=f"{d}, {k / 1e3:g} N/mm",
            default=name == DEFAULT,
        )
        for name in STABILISERS
        for d in TOUCHED
        for k in STIFFNESSES_N_M
    ]


def error(name: str, device: str, stiffness_N_m: float, gestures: Sequence[str]) -> dict[str, float]:
    """Return the largest error of the compliance, energy and speed at rest over some gestures with a light grip."""
    rows = [run_case(TOUCHED[device], gesture, stiffness_N_m, name) for gesture in gestures]
    kept = [0.0 if math.isnan(row.kept) else row.kept for row in rows]
    return {
        "compliance": max(compliance_error(each) for each in kept),
        "energy": float(np.clip(1e3 * max(row.energy_J for row in rows), *MJ)),
        "late": float(np.clip(1e3 * max(row.rest_speed_m_s for row in rows), *MM_S)),
    }


def compliance_error(kept: float) -> float:
    """Return the relative error of the compliance [%] of a wall that keeps a share of its stiffness; 0: no rest."""
    return min(100.0 * abs(1.0 / kept - 1.0), COMPLIANCE_MAX) if kept > 0.0 else COMPLIANCE_MAX


def time(name: str, device: str, stiffness_N_m: float, gestures: Sequence[str]) -> tuple[float, float]:
    chosen = stabiliser(name, TOUCHED[device], stiffness_N_m)
    limits = replace(
        chosen.limits, stiffness_N_m=math.inf
    )  # the same wall for all, so that only the computation differs
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=chosen.damping_Ns_m)
    renderer = Renderer(sheet(swatch), ("wall",), limits=limits)
    return spread_us(ticks_ns(renderer, stroke_path()))


QUESTION: Final = Question(
    name="stabiliser",
    title="Stabiliser of a stiff wall",
    measures=(
        Measure("compliance", "error of the compliance", "%", 100.0 * COMPLIANCE, "Tan et al. 1995"),
        Measure("energy", "energy given to the hand", "mJ", 1e3 * OUT_J, "a weak tap of the Omni's 45 g"),
        Measure("late", "speed at rest", "mm/s", 1e3 * REST_M_S, "half an encoder's noise"),
    ),
    settings=settings,
    error=error,
    time=time,
    conditions=(
        "At 1 kHz, a light grip taps a sheet, presses it and slides over a ridge; the worst of the three counts. "
        "Devices: an Omni, and the same without friction and encoder steps (bare). Time of a tick with a wall."
    ),
)
