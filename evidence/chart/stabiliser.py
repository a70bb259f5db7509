"""The question of the stabiliser: which one keeps a stiff wall stable on a device that is not quite as stated."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
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
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.result import ClosedLoopResult
from hapscene.loop.twin import Twin
from hapscene.perception import COMPLIANCE
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.swatch import Swatch

from .measuring import spread_us, stroke_path, ticks_ns
from .question import Measure, Point, Question, Setting

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
RIDGE_RADIUS_M: Final = FACET_M / (2.0 * math.tan(FACET_RAD / 2.0))
"""The ridge of the edge tour: width of faces, angle between adjacent faces, number of faces, distance from its axis."""

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


class Outcome(NamedTuple):
    """Result of one stabiliser in one case."""

    rest_speed_m_s: float
    """Rms speed of the tool when it should be at rest, before and after a sudden push."""
    energy_J: float
    """Maximum over time of the net energy that the motors have given to the hand."""
    kept: float
    """Rendered stiffness over requested stiffness; NaN if the tool does not come to rest."""


def stabiliser(name: str, device: Device, stiffness_N_m: float) -> tuple[Limits, float]:
    """Return limits of the renderer and damping of the wall [N·s/m] of one of `STABILISERS` for a device and a wall."""
    point = device.point
    assert point is not None
    limits = limits_of(device, TICK_S)
    return {
        "none": (IDEAL, 0.0),
        "limits": (replace(limits, passivity_Ns_m=0.0), 0.0),
        "virtual damping": (IDEAL, damping_for(device, stiffness_N_m, TICK_S)),
        "passivity": (Limits(passivity_Ns_m=PASSIVITY_SHARE * damping_max(point.mass_kg, TICK_S)), 0.0),
        "coupling": (Limits(coupling_N_m=COUPLING_N_M), 0.0),
        "limits, passivity": (limits, 0.0),
    }[name]


def run_case(
    device: Device, gesture: str, stiffness_N_m: float, name: str, actual: PointMass | None = None, delay_ticks: int = 0
) -> Outcome:
    """Run one of `STABILISERS`, made for `device`, with one of `GESTURES`, with a light grip at 1 kHz.

    The touched device is `actual`, or `device`; the stabiliser does not know the delay of the force.
    """
    point = actual or device.point
    assert point is not None
    limits, damping_Ns_m = stabiliser(name, device, stiffness_N_m)
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m)
    scene = ridge(swatch) if gesture == "tour" else sheet(swatch)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeviceWarning)  # that the limits clip the wall is what is tested
        twin = Twin(scene, point, effects=("wall",), a_rate_Hz=1.0 / TICK_S, limits=limits, delay_ticks=delay_ticks)
    target = _target(gesture)
    result = twin.run(ReferenceTrajectory.along(target, "light"))
    energy_J = max(0.0, float(np.cumsum(result.work_J).max()))
    pushed, stiffness = _pushed(twin, target[-1])
    rest_speed_m_s = max(_rms_speed(result.v_W_m_s[-1000:]), _rms_speed(pushed.v_W_m_s[-500:]))
    return Outcome(rest_speed_m_s, energy_J, stiffness / stiffness_N_m if rest_speed_m_s < REST_M_S else math.nan)


def _rms_speed(v_W_m_s: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.sum(v_W_m_s**2, axis=1))))


def _target(gesture: str) -> NDArray[np.float64]:
    """Return the reference trajectory of the hand (n, 3)."""
    if gesture == "tour":
        half = 0.9 * FACETS * FACET_RAD / 2.0
        angle = np.concatenate((np.linspace(-half, half, 1500), np.linspace(half, -half, 1500), np.full(1500, -half)))
        radius = RIDGE_RADIUS_M - np.repeat((-0.001, 0.008, 0.016, 0.008), (50, 1450, 1500, 1500))
        return np.asarray(radius[:, None] * np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1))
    start, end, speed = (0.01, -0.005, 0.15) if gesture == "tap" else (0.001, -0.005, 0.02)
    height = np.full(3000, end)
    way = round((start - end) / speed / TICK_S)
    height[:way] = np.linspace(start, end, way)
    return np.column_stack((np.full(3000, AT_M[0]), np.full(3000, AT_M[1]), height))


def _pushed(twin: Twin, target_W_m: NDArray[np.float64]) -> tuple[ClosedLoopResult, float]:
    """Push for 1.5 s, suddenly; return the result, and force over depth at its end [N/m]."""
    down = target_W_m / np.linalg.norm(target_W_m) if abs(target_W_m[2]) > 0.01 else np.array((0.0, 0.0, 1.0))
    result = twin.run(ReferenceTrajectory.hold(tuple(target_W_m), 1500, GRIPS["light"], push_W_N=tuple(-PUSH_N * down)))
    force = np.linalg.norm(result.f_motor_W_N[-500:].mean(axis=0))
    depth = np.linalg.norm((result.recording.p_WP_m - result.p_W_m)[-500:].mean(axis=0))
    return result, float(force / depth)


def ridge(swatch: Swatch, count: int = FACETS) -> Scene:
    """Return a scene of flat faces about the y axis; the middle of the ridge, an edge or a face, is at the top."""
    corner_radius = FACET_M / (2.0 * math.sin(FACET_RAD / 2.0))
    angle = FACET_RAD * (np.arange(count + 1) - 0.5 * count)
    rim = corner_radius * np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1)
    end = np.array((0.0, 0.05, 0.0))
    corners = np.concatenate((rim - end, rim + end))
    i = np.arange(count)
    j = i + 1 + count
    faces = np.concatenate((np.stack((i, i + 1, j + 1), axis=1), np.stack((i, j + 1, j), axis=1)))
    scene = Scene()
    scene.add(Mesh(corners, faces.astype(np.int32)), name="ridge", swatch=swatch)
    return scene


STIFFNESSES_N_M: Final = (700.0, 2000.0, 5000.0)
"""The stiffest wall within the limits of the Omni, and two beyond them."""

OMNI: Final = DEVICES["omni"]
OMNI_POINT: Final = PointMass(0.045, 0.1, 0.26, 55e-6)

ACTUAL: Final[dict[str, tuple[PointMass, int]]] = {
    "as stated": (OMNI_POINT, 0),
    "half friction, 1 ms late": (replace(OMNI_POINT, b_Ns_m=0.05, c_N=0.13), 1),
}
"""Omnis that are touched, with a delay in ticks. Stabilisers are made for the stated one without delay: the friction of
a device varies with its pose and its age, and an output that is written once per tick is up to one tick late."""

STRUCTURE_N_M: Final = min(Omni().stiffness_N_m)
"""Stiffness of the Omni's structure, which the hand feels in series with each wall [N/m]."""

MM_S, MJ, COMPLIANCE_MAX = (0.01, 1e4), (1e-3, 1e3), 1e4
"""Smallest and largest values that are stored; an unstable loop has no finite value."""


def settings(scene_file: str | None) -> list[Setting]:
    return [
        Setting(
            *("Stabiliser of a stiff wall", name, ""),
            {"name": name, "omni": omni, "stiffness_N_m": k, "gestures": GESTURES},
            case=f"{omni}: {k / 1e3:g} N/mm",
            default=name == DEFAULT,
        )
        for name in STABILISERS
        for omni in ACTUAL
        for k in STIFFNESSES_N_M
    ]


def error(name: str, omni: str, stiffness_N_m: float, gestures: Sequence[str]) -> dict[str, float]:
    """Return the largest error of the compliance, energy and speed at rest over some gestures with a light grip."""
    rows = [run_case(OMNI, gesture, stiffness_N_m, name, *ACTUAL[omni]) for gesture in gestures]
    return {
        "compliance": max(compliance_error(row.kept, stiffness_N_m) for row in rows),
        "energy": float(np.clip(1e3 * max(row.energy_J for row in rows), *MJ)),
        "late": float(np.clip(1e3 * max(row.rest_speed_m_s for row in rows), *MM_S)),
    }


def compliance_error(kept: float, stiffness_N_m: float) -> float:
    """Return the relative error of the compliance [%] of wall and structure; NaN of `kept`, no rest, is the largest."""
    if not kept > 0.0:
        return COMPLIANCE_MAX
    softer = abs(1.0 / kept - 1.0) / (1.0 + stiffness_N_m / STRUCTURE_N_M)
    return min(100.0 * softer, COMPLIANCE_MAX)


def caveat(used: Sequence[Point], every: Sequence[Point]) -> str:
    """Return which walls feel softer, and which stabilisers are within the limits only on a device as stated."""

    def fits(method: str, omni: str) -> bool:
        points = [p for p in every if p.method == method and p.case.startswith(omni)]
        return all(p.errors[m.key] <= (m.limit or math.inf) for p in points for m in MEASURES)

    stated, other = ACTUAL
    soft = [p.case.split(": ")[1] for p in used if p.errors["compliance"] > 100.0 * COMPLIANCE]
    frail = [m for m in dict.fromkeys(p.method for p in every) if fits(m, stated) and not fits(m, other)]
    found = [f"walls of {min(soft)} and more feel softer"] if soft else []
    if frail:
        found.append(f"{', '.join(frail)}: within the limits as stated, not with {other}")
    return "; ".join(found)


def time(name: str, omni: str, stiffness_N_m: float, gestures: Sequence[str]) -> tuple[float, float]:
    limits, damping_Ns_m = stabiliser(name, OMNI, stiffness_N_m)
    # the same wall for all, so that only the computation differs
    limits = replace(limits, stiffness_N_m=math.inf)
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m)
    return spread_us(ticks_ns(Renderer(sheet(swatch), ("wall",), limits=limits), stroke_path()))


MEASURES: Final = (
    Measure("compliance", "error of the compliance", "%", 100.0 * COMPLIANCE, "Tan et al. 1995"),
    Measure("energy", "energy given to the hand", "mJ", 1e3 * OUT_J, "a weak tap of the Omni's 45 g"),
    Measure("late", "speed at rest", "mm/s", 1e3 * REST_M_S, "half an encoder's noise"),
)

QUESTION: Final = Question(
    name="stabiliser",
    title="Stabiliser of a stiff wall",
    measures=MEASURES,
    settings=settings,
    error=error,
    time=time,
    conditions=(
        "At 1 kHz, a light grip taps a sheet, presses it and slides over a ridge, and then pushes suddenly; the worst "
        "counts. The Omni is as stated, or has half its friction and damping and a delay of 1 ms, which the stabiliser "
        "does not know. Compliance: of wall and structure of the Omni. Time of a tick with a wall."
    ),
    caveat=caveat,
)
