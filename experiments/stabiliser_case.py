"""Every stabiliser on the same closed-loop cases: does the tool come to rest, what energy comes out, how stiff is the
wall still, and what does it cost in the tick."""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.device.hand import GRIPS
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
from hapscene.device.point import PointMass
from hapscene.recording import Recording
from hapscene.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.rig import AT_M, sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.swatch import Swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.twin import Twin
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

DEVICES_TRIED: Final = (BARE, DEVICES["omni"])
STIFFNESSES_N_M: Final = (2000.0, 5000.0)
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
"""What is tried; the last is what a device has by default."""


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


@dataclass(frozen=True)
class Row:
    """One case with one stabiliser.

    Attributes:
        device, gesture, stiffness_N_m, stabiliser: which.
        late_m_s: root-mean-square speed of the tool when it should be at rest.
        out_J: most energy that the motors have given the hand, beyond what they have taken, at any time.
        kept: stiffness felt over stiffness asked for; NaN where the tool does not rest.
        turn_rad: furthest that the force turned from one tick to the next.
    """

    device: str
    gesture: str
    stiffness_N_m: float
    stabiliser: str
    late_m_s: float
    out_J: float
    kept: float
    turn_rad: float

    @property
    def rests(self) -> bool:
        """Whether the tool comes to rest."""
        return self.late_m_s < REST_M_S


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


def run_cases(
    devices: Sequence[Device] = DEVICES_TRIED,
    stiffnesses_N_m: Sequence[float] = STIFFNESSES_N_M,
    gestures: Sequence[str] = GESTURES,
    stabilisers: Sequence[str] = STABILISERS,
) -> list[Row]:
    """All stabilisers on all cases."""
    cases = product(devices, stiffnesses_N_m, gestures, stabilisers)
    return [run_case(device, gesture, stiffness, name) for device, stiffness, gesture, name in cases]


def run_case(device: Device, gesture: str, stiffness_N_m: float, name: str) -> Row:
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
    felt = twin.run(Intent.along(target, "light"))
    late = felt.v_W_m_s[-1000:]
    late_m_s = float(np.sqrt(np.mean(np.sum(late**2, axis=1))))
    kept = _felt_stiffness(twin, target[-1]) / stiffness_N_m if late_m_s < REST_M_S else math.nan
    out_J = max(0.0, float(np.cumsum(felt.work_J).max()))
    return Row(device.name, gesture, stiffness_N_m, name, late_m_s, out_J, kept, turn_rad(felt.recording))


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
    felt = twin.run(Intent.hold(tuple(target_W_m), 1500, GRIPS["light"], push_W_N=tuple(-PUSH_N * down)))
    force = np.linalg.norm(felt.f_motor_W_N[-500:].mean(axis=0))
    depth = np.linalg.norm((felt.recording.p_WP_m - felt.p_W_m)[-500:].mean(axis=0))
    return float(force / depth)


def turn_rad(recording: Recording, least_N: float = 0.05) -> float:
    """Furthest that the force turns from one tick to the next, where it is over `least_N` in both [rad]."""
    size = np.linalg.norm(recording.f_W_N, axis=1)
    felt = (size[1:] > least_N) & (size[:-1] > least_N)
    if not felt.any():
        return 0.0
    unit = recording.f_W_N / np.maximum(size, 1e-300)[:, None]
    apart = np.linalg.norm(unit[1:] - unit[:-1], axis=1)[felt]
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(apart.max()))))


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


def cost_us(
    stabilisers: Sequence[str] = STABILISERS, stiffness_N_m: float = 2000.0, repeats: int = 12
) -> dict[str, float]:
    """What each adds to the tick, median over a press and stroke [µs]: side by side in one run, least of repeats."""
    device = DEVICES["omni"]
    depth = np.minimum(np.arange(4000) / 400.0, 1.0) * 1.5e-3 - 1e-4
    path = np.column_stack((0.03 * np.sin(np.arange(4000) / 300.0), np.full(4000, 0.01), -depth))
    least: dict[str, NDArray[np.int64]] = {}
    renderers: dict[str, Renderer] = {}
    for name in stabilisers:
        chosen = stabiliser(name, device, stiffness_N_m)
        limits = replace(chosen.limits, stiffness_N_m=math.inf)  # the same wall for all: only the tick's work differs
        swatch = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=chosen.damping_Ns_m)
        renderers[name] = Renderer(sheet(swatch), ("wall",), limits=limits, crease_rad=chosen.crease_rad)
    for _ in range(repeats):
        for name, renderer in renderers.items():
            renderer.reset(path[0])
            tick_ns = renderer.run(path).tick_ns
            least[name] = np.minimum(least.get(name, tick_ns), tick_ns)
    return {name: 1e-3 * float(np.median((ns - least["none"])[500:])) for name, ns in least.items()}


# The chart: what each does on every case, and what it costs.

OUT_J: Final = 2e-3
"""Energy out that is drawn as the line not to be crossed [J]."""

SPAN_MM_S: Final = (1e-2, 1e4)
SPAN_MJ: Final = (1e-3, 1e3)
"""Axes; what lies beyond is drawn at their ends."""

LANES: Final = 0.75
"""How much of a row its marks take [1]: the rest tells rows apart."""

MARKERS: Final = ("o", "s", "^", "D")
COLOURS: Final = (OKABE_ITO["blue"], OKABE_ITO["vermilion"], OKABE_ITO["green"])


def draw_stabilisers(path: Path, rows: Sequence[Row], costs_us: Mapping[str, float]) -> None:
    """Write a PNG: a row of panels for each device, with the speed late, the energy out and the stiffness kept.

    Args:
        path: where.
        rows: what was measured.
        costs_us: time that each stabiliser adds to the tick, by its name.
    """
    devices = list(dict.fromkeys(row.device for row in rows))
    draw_panels(path, len(devices), 3, (4.6, 4.4), lambda figure, axes: _draw(figure, axes, rows, devices, costs_us))


def _draw(figure: Any, axes: Any, rows: Sequence[Row], devices: list[str], costs_us: Mapping[str, float]) -> None:
    names = list(dict.fromkeys(row.stabiliser for row in rows))
    for line, device in zip(axes, devices, strict=True):
        own = [row for row in rows if row.device == device]
        _panel(line[0], own, names, [1e3 * row.late_m_s for row in own], SPAN_MM_S)
        line[0].axvline(1e3 * REST_M_S, color=INK, linewidth=0.8, linestyle="--")
        title = f"{device[0].upper()}{device[1:]}: speed late"
        line[0].set(title=title, xlabel="rms [mm/s]; dashed: rest")
        _panel(line[1], own, names, [1e3 * row.out_J for row in own], SPAN_MJ)
        line[1].axvline(1e3 * OUT_J, color=INK, linewidth=0.8, linestyle="--")
        line[1].set(title="Energy out", xlabel="given to the hand [mJ]; dashed: 2")
        _panel(line[2], own, names, [row.kept for row in own], None)
        line[2].set(title="Stiffness kept", xlabel="felt / asked, where it rests", xlim=(0.0, 1.15))
        line[0].set_yticks(range(len(names)), [named(name, costs_us.get(name, 0.0)) for name in names])
        for axis in line[1:]:
            axis.set_yticks(range(len(names)), [])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)


def named(stabiliser: str, cost_us: float) -> str:
    """A stabiliser, and what it adds to a tick where the clock can tell."""
    return f"{stabiliser}\n+{cost_us:.2f} µs" if cost_us >= 0.005 else stabiliser


def _panel(
    axis: "Axes", rows: Sequence[Row], names: list[str], values: list[float], span: tuple[float, float] | None
) -> None:
    """One mark a case: shape by gesture, colour by stiffness."""
    gestures = list(dict.fromkeys(row.gesture for row in rows))
    stiffnesses = sorted({row.stiffness_N_m for row in rows})
    for s, stiffness in enumerate(stiffnesses):
        for g, gesture in enumerate(gestures):
            chosen = [i for i, row in enumerate(rows) if (row.stiffness_N_m, row.gesture) == (stiffness, gesture)]
            x = [values[i] if span is None else min(max(values[i], span[0]), span[1]) for i in chosen]
            lane = LANES * ((s * len(gestures) + g + 0.5) / (len(stiffnesses) * len(gestures)) - 0.5)
            y = [names.index(rows[i].stabiliser) + lane for i in chosen]
            label = f"{gesture}, {stiffness:g} N/m"
            axis.plot(x, y, MARKERS[g], color=COLOURS[s], markersize=4, linestyle="none", label=label)
    if span is not None:
        axis.set_xscale("log")
        axis.set_xlim(0.7 * span[0], 1.4 * span[1])
    axis.set_ylim(len(names) - 0.5, -0.5)
