"""What keeps a stiff wall at rest, and what is left of its stiffness."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.device.model import (
    DEVICES,
    GUARD_SHARE,
    IDEAL,
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
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.swatch import Swatch

from .measuring import measured, spread_us, stroke_path, ticks_ns
from .question import Measure, Point, Question, Setting

OUT_J: Final = 2e-3
"""Energy given to the hand that counts as a weak tap [J]."""

REST_M_S: Final = 5e-3
"""Root-mean-square speed below which the tool is at rest [m/s]."""

COUPLING_N_M: Final = 200.0
"""Spring of the virtual coupling that is tried [N/m]."""

PUSH_N: Final = 2.0
"""With what the hand pushes while the stiffness is felt [N]: deep enough for encoder steps not to matter."""

FACET_M: Final = 0.01
FACET_RAD: Final = math.radians(15.0)
FACETS: Final = 6
"""The ridge of the edge tour: width of its faces, how far the surface turns at each edge, and how many they are."""

BARE: Final = Device("point mass", PointMass(0.045, 0.1), IDEAL)
"""The Omni without friction and encoder steps: nothing but its damping holds a wall."""

GESTURES: Final = ("tap", "press", "tour")
STABILISERS: Final = (
    "none",
    "limits",
    "virtual damping",
    "passivity",
    "passivity, uncapped",
    "coupling",
    "shading",
    "limits, passivity",
)
"""Stabilisers that are tried; the last one is a device's default."""


@dataclass(frozen=True)
class Stabiliser:
    """What is switched on.

    Attributes:
        limits: of the renderer.
        damping_Ns_m: of the wall.
        crease_rad: edges flatter than it are shaded.
    """

    limits: Limits = IDEAL
    damping_Ns_m: float = 0.0
    crease_rad: float = 0.0


class Outcome(NamedTuple):
    """What one stabiliser made of one case."""

    late_m_s: float
    """Root-mean-square speed of the tool when it should be at rest."""
    out_J: float
    """Most energy that the motors have given the hand, beyond what they have taken, at any time."""
    kept: float
    """Stiffness felt over stiffness asked for; NaN where the tool does not rest."""


def stabiliser(name: str, device: Device, stiffness_N_m: float, tick_s: float = TICK_S) -> Stabiliser:
    """One of `STABILISERS`, set up for a device and a wall."""
    point = device.point
    assert point is not None
    limits = limits_of(device, tick_s)
    return {
        "none": Stabiliser(),
        "limits": Stabiliser(replace(limits, guard_Ns_m=0.0)),
        "virtual damping": Stabiliser(damping_Ns_m=damping_for(device, stiffness_N_m, tick_s)),
        "passivity": Stabiliser(Limits(guard_Ns_m=GUARD_SHARE * damping_max(point.mass_kg, tick_s))),
        "passivity, uncapped": Stabiliser(Limits(guard_Ns_m=math.inf)),
        "coupling": Stabiliser(Limits(coupling_N_m=COUPLING_N_M)),
        "shading": Stabiliser(crease_rad=2.0 * FACET_RAD),
        "limits, passivity": Stabiliser(limits),
    }[name]


def run_case(device: Device, gesture: str, stiffness_N_m: float, name: str) -> Outcome:
    """One of `STABILISERS` on one of `GESTURES`, at a light grip and 1 kHz."""
    point = device.point
    assert point is not None
    chosen = stabiliser(name, device, stiffness_N_m)
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=chosen.damping_Ns_m)
    scene = ridge(swatch) if gesture == "tour" else sheet(swatch)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeviceWarning)  # that the limits clip the wall is what is tried
        setup: dict[str, Any] = {"effects": ("wall",), "a_rate_Hz": 1.0 / TICK_S, "limits": chosen.limits}
        twin = Twin(scene, point, **setup)
        if chosen.crease_rad > 0.0:
            twin.renderer = Renderer(scene, **setup, crease_rad=chosen.crease_rad)
    target = _target(gesture)
    felt = twin.run(ReferenceTrajectory.along(target, "light"))
    late = felt.v_W_m_s[-1000:]
    late_m_s = float(np.sqrt(np.mean(np.sum(late**2, axis=1))))
    kept = _felt_stiffness(twin, target[-1]) / stiffness_N_m if late_m_s < REST_M_S else math.nan
    out_J = max(0.0, float(np.cumsum(felt.work_J).max()))
    return Outcome(late_m_s, out_J, kept)


def _target(gesture: str) -> NDArray[np.float64]:
    """Where the hand means the tool to be, (n, 3)."""
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


def _felt_stiffness(twin: Twin, target_W_m: NDArray[np.float64]) -> float:
    """Force over depth while the hand pushes on [N/m]."""
    down = target_W_m / np.linalg.norm(target_W_m) if abs(target_W_m[2]) > 0.01 else np.array((0.0, 0.0, 1.0))
    felt = twin.run(ReferenceTrajectory.hold(tuple(target_W_m), 1500, GRIPS["light"], push_W_N=tuple(-PUSH_N * down)))
    force = np.linalg.norm(felt.f_motor_W_N[-500:].mean(axis=0))
    depth = np.linalg.norm((felt.recording.p_WP_m - felt.p_W_m)[-500:].mean(axis=0))
    return float(force / depth)


def ridge_radius_m(width_m: float = FACET_M, turn_rad: float = FACET_RAD) -> float:
    """Distance of the ridge's faces from its axis."""
    return width_m / (2.0 * math.tan(turn_rad / 2.0))


def ridge(swatch: Swatch, count: int = FACETS, width_m: float = FACET_M, turn_rad: float = FACET_RAD) -> Scene:
    """A scene of `count` flat faces, `width_m` wide, that turn by `turn_rad` about the y axis, each to the next.

    The middle of them, an edge or a face, is at the top.
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

MM_S, MJ = (0.01, 1e4), (1e-3, 1e3)
"""What less and what more is drawn as: a loop that blows up has no number."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    names = ("none", "virtual damping", "passivity", "coupling") if quick else STABILISERS
    cases = [("omni", 2000.0)] if quick else [(d, k) for d in TOUCHED for k in STIFFNESSES_N_M]
    gestures = list(GESTURES[:1] if quick else GESTURES)
    return [
        Setting(name, f"{d}, {k / 1e3:g} N/mm", {"name": name, "device": d, "stiffness_N_m": k, "gestures": gestures})
        for name in names
        for d, k in cases
    ]


def error(name: str, device: str, stiffness_N_m: float, gestures: Sequence[str]) -> dict[str, float]:
    """The worst of some gestures of a light hand: stiffness that is left, energy out, speed where it should rest.

    A wall on which the tool never rests keeps nothing.
    """
    rows = [run_case(TOUCHED[device], gesture, stiffness_N_m, name) for gesture in gestures]
    return {
        "kept": 100.0 * min(0.0 if math.isnan(row.kept) else row.kept for row in rows),
        "energy": float(np.clip(1e3 * max(row.out_J for row in rows), *MJ)),
        "late": float(np.clip(1e3 * max(row.late_m_s for row in rows), *MM_S)),
    }


def time(name: str, device: str, stiffness_N_m: float, gestures: Sequence[str]) -> tuple[float, float]:
    chosen = stabiliser(name, TOUCHED[device], stiffness_N_m)
    limits = replace(chosen.limits, stiffness_N_m=math.inf)  # the same wall for all: only the tick's work differs
    swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=chosen.damping_Ns_m)
    renderer = Renderer(sheet(swatch), ("wall",), limits=limits, crease_rad=chosen.crease_rad)
    return spread_us(ticks_ns(renderer, stroke_path()))


def advice(points: Sequence[Point]) -> str:
    """What keeps most of the stiffness among those that rest and give no energy, in all cases."""
    worst: dict[str, dict[str, float]] = {}
    for p in measured(points, "kept"):
        of = worst.setdefault(p.method, {"kept": math.inf, "energy": 0.0, "late": 0.0, "us": p.median_us})
        of["kept"] = min(of["kept"], p.errors["kept"])
        of["energy"], of["late"] = max(of["energy"], p.errors["energy"]), max(of["late"], p.errors["late"])
    calm = [n for n, of in worst.items() if of["energy"] <= 1e3 * OUT_J and of["late"] <= 1e3 * REST_M_S]
    if not calm:
        least = min(worst, key=lambda n: worst[n]["energy"])
        return (
            f"No stabiliser keeps all of these walls stable: {least} gives least, {worst[least]['energy']:.2g} mJ. "
            "Choose softer walls, more damping in the device or a faster loop."
        )
    chosen = max(calm, key=lambda n: worst[n]["kept"])
    loud = max(worst, key=lambda n: worst[n]["energy"])
    also = [f"{n} ({worst[n]['kept']:.0f} %)" for n in calm if n != chosen]
    return (
        f"Choose {chosen}: it keeps {worst[chosen]['kept']:.0f} % of the stiffness or more and gives at most "
        f"{worst[chosen]['energy']:.2g} mJ, for a tick of {worst[chosen]['us']:.2g} µs; also stable: "
        f"{'; '.join(also) or 'none'}. {loud[0].upper()}{loud[1:]} gives "
        f"{worst[loud]['energy']:.0f} mJ{' or more' if worst[loud]['energy'] >= MJ[1] else ''}. Where walls are "
        "softer than the device holds by itself, none is needed."
    )


QUESTION: Final = Question(
    name="stabiliser",
    title="What keeps a stiff wall still?",
    measures=(
        Measure("kept", "stiffness kept, worst gesture", "%", log=False, more_is_better=True),
        Measure("energy", "energy given to the hand", "mJ", 1e3 * OUT_J, "the Omni's 45 g", limit="a weak tap"),
        Measure("late", "speed where it should rest", "mm/s", 1e3 * REST_M_S, "half an encoder's noise", limit="rest"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "A light hand taps and presses a sheet and tours a ridge, at 1 kHz: an Omni, and the same without friction "
        "and encoder steps (bare); the worst of the three gestures. Time of a whole tick with a wall, all sent the "
        "same way."
    ),
)
