"""The zoo in closed loop: meshes and tool paths that are hard for point contact, with a hand that pushes 3 N.

A folder as ../shared/zoo has `cases.json`, and for each case a mesh and the path of a tool; what the hand makes of a
path, `hapscene_experiments.zoo_hand` says.

What is wrong:
- pop-through: contact lost with the tool inside, the proxy's direction jumping as the surface does not, a number that
  is not finite;
- a limit cycle: more than `REST_MM_S` rms in the last half of the second;
- energy out of nothing: work of the motors over a contact, from touch to release, of more than `ENERGY_MJ`, the body's
  motion taken off. In a passive world it is never above 0: a contact begins and ends with the wall's spring empty.

An Omni is tried where it reaches the whole path.
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from numpy.typing import NDArray

from hapscene.device.hand import grip_named
from hapscene.device.model import Limits, limits_of
from hapscene.device.omni import Omni, stand
from hapscene.device.omni_record import OmniFlag
from hapscene.device.point import PointMass
from hapscene.records import ROW, records
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.swatch import Swatch
from hapscene.twin.result import FELT
from hapscene.twin.twin import Twin
from hapscene.view.palette import AIR, OKABE_ITO

from .zoo_hand import BODY, STIFFNESS_N_M, TICK_S, Plan, make_plan, press_along, reaches

Array = NDArray[np.float64]

REST_MM_S: Final = 5.0
"""Most speed at rest, rms [mm/s]."""

ENERGY_MJ: Final = 2.0
"""Most energy out of nothing in a contact [mJ]."""

LOST_M: Final = 2e-4
"""How deep the tool may still be where contact ends, beside what it moved in that tick [m]."""

SUBDIVISIONS: Final = {"sph1k": 3, "sph20k": 5, "sph80k": 6, "sph330k": 7, "sph1300k": 8}
"""Icospheres of 50 mm that are made, not read."""

TWO_SIDED: Final = ("flip20k", "open40", "fin")
"""Meshes felt from both sides."""

JUMP_DEG: Final = {
    "slide_sph1k": 11.0,
    "sphere": 3.0,
    "moving_sphere": 3.0,
    "plate_thin": 1.0,
    "fast2ms": 1.0,
    "vgroove": 2.0,
    "edge90": 95.0,
}
"""Largest turn of the direction in a tick, by case or kind, as the zoo's judge has it; 180 for others."""

LETS_GO: Final = ("wedge20",)
"""Cases in which the tool leaves a body through another of its faces, so that contact is rightly lost while it is deep:
over a knife edge."""

DEVICES: Final[dict[str, PointMass | Omni]] = {
    "point": PointMass(0.045, 0.1, 0.26, 5.5e-5),
    "omni": Omni(thermal_s=math.inf),
}
"""What the hand holds: the Omni as a point mass, and all of it, its motors cold: 3 N overheat them within 5 s."""

GRIPS: Final = ("light", "firm")
"""How it holds it."""


@dataclass(frozen=True)
class ZooCase:
    """One case in closed loop, with one device and grip.

    Attributes:
        id: case, device and grip.
        touching: share of the ticks in contact [1].
        not_finite: ticks with a number that is not finite.
        lost: ticks in which contact ended with the tool inside, where the surface goes on.
        jump_deg, jump_limit_deg: largest turn of the direction from tool to proxy in a tick, and what is allowed.
        rest_mm_s: speed at rest, rms.
        energy_mJ: largest work of the motors over a contact.
        depth_mm: how deep the tool went at most.
        limited: share of the ticks in which an Omni's motors had too little torque [1].
    """

    id: str
    touching: float
    not_finite: int
    lost: int
    jump_deg: float
    jump_limit_deg: float
    rest_mm_s: float
    energy_mJ: float
    depth_mm: float
    limited: float

    @property
    def ok(self) -> bool:
        through = self.not_finite > 0 or self.lost > 0 or self.jump_deg > self.jump_limit_deg
        return not through and self.rest_mm_s <= REST_MM_S and self.energy_mJ <= ENERGY_MJ and self.touching > 0.0


LEAST_DRAWN: Final = 1e-4
"""Where what is less is drawn."""

_COLUMNS: Final[tuple[tuple[str, str, float, Callable[[ZooCase], float]], ...]] = (
    ("energy made in a contact", "energy [mJ]", ENERGY_MJ, lambda row: row.energy_mJ),
    ("at rest", "speed, rms [mm/s]", REST_MM_S, lambda row: row.rest_mm_s),
    ("jump of direction", "turn in a tick / allowed [1]", 1.0, lambda row: row.jump_deg / row.jump_limit_deg),
)
_MARKS: Final = {
    ("point", "light"): ("sky", "o"),
    ("point", "firm"): ("blue", "s"),
    ("omni", "light"): ("orange", "D"),
    ("omni", "firm"): ("vermilion", "^"),
}


def zoo_cases(
    folder: str | Path,
    names: Sequence[str] = (),
    devices: Sequence[str] = ("point", "omni"),
    grips: Sequence[str] = GRIPS,
    say: Callable[[str], None] = lambda _: None,
    limits: Limits | None = None,
) -> Iterator[ZooCase]:
    """Run the cases of a folder (those named, or all), with each device and grip; by default at the Omni's limits.

    Raises:
        OSError: a file that is not there.
    """
    folder = Path(folder)
    mesh, twin, bounds_m = "", None, np.zeros((2, 3))
    for case in json.loads((folder / "cases.json").read_text()):
        if names and case["name"] not in names:
            continue
        if twin is None or case["mesh"] != mesh:
            mesh = case["mesh"]
            twin, bounds_m = _twin(folder, mesh, limits or limits_of("omni", TICK_S))
        path = np.load(folder / f"{case['path']}.npz")
        plan = make_plan(twin.renderer, case, path["tool_m"], path.get("body_m"))
        twin.X_WD = stand(0.5 * (plan.on_m.min(axis=0) + plan.on_m.max(axis=0)))
        for device in devices:
            if device == "omni" and not reaches(twin.X_WD, plan):
                continue
            for grip in grips:
                row = _run(twin, bounds_m, case, plan, device, grip)
                say(f"{row}\n")
                yield row


def _run(twin: Twin, bounds_m: Array, case: dict[str, Any], plan: Plan, device: str, grip: str) -> ZooCase:
    twin.device = DEVICES[device]
    n = len(plan.on_m)
    rows, felt = records(n, ROW), records(n, FELT)
    made_J, lost = 0.0, 0
    for a, b in plan.parts:
        twin.reset(plan.on_m[a])
        hand = (plan.on_m[a:b], plan.nhat[a:b], np.zeros(1), grip_named(grip).row())
        render = (twin.renderer.world, twin.renderer.surface, twin.body)
        motor_m = np.zeros((b - a + 1, 3))
        press_along(*render, *hand, *plan.poses((a, b)), rows[a:b], felt[a:b], motor_m, np.zeros((2, 1)))
        body_m = plan.body_m[a:b]
        carried_m = np.diff(body_m, axis=0, append=body_m[-1:])
        made_J = max(made_J, _made_J(rows[a:b], felt[a:b], np.diff(motor_m, axis=0) - carried_m))
        lost += _lost(rows[a:b], body_m, bounds_m)
    v = felt.v_W_m_s[plan.rest]
    parts = [slice(a, b) for a, b in plan.parts]
    return ZooCase(
        id=f"{case['name']}/{device}/{grip}",
        touching=float(rows.touching.mean()),
        not_finite=int((~np.isfinite(rows.f_W_N + felt.p_W_m)).any(axis=1).sum()),
        lost=0 if case["name"] in LETS_GO else lost,
        jump_deg=max(_jump_deg(rows[part]) for part in parts),
        jump_limit_deg=_jump_limit_deg(case),
        rest_mm_s=1e3 * float(np.sqrt((v**2).sum(axis=1).mean())) if len(v) else 0.0,
        energy_mJ=1e3 * made_J,
        depth_mm=1e3 * float(rows.depth_m.max()),
        limited=float(((felt.trouble & int(OmniFlag.TORQUE_LIMITED)) > 0).mean()),
    )


def _made_J(rows: Any, felt: Any, way_m: Array) -> float:
    """Largest work of the motors over a contact [J], for the way (n, 3) over the body of what they act on.

    Not the way of the encoders, whose steps would add ½KΔ² of their own at each count, nor that of an Omni's tool,
    which is a spring further on.
    """
    work = (felt.f_motor_W_N * way_m).sum(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], rows.touching, [0]))))
    sums = np.concatenate(([0.0], np.cumsum(work)))
    return float((sums[edges[1::2]] - sums[edges[0::2]]).max(initial=0.0))


def _lost(rows: Any, body_m: Array, bounds_m: Array) -> int:
    """Ticks in which contact ended with the tool deeper than it moved, and it is still within the body's bounds (2, 3).

    Past them, where the surface ends, contact is rightly lost.
    """
    ended = np.flatnonzero((rows.touching[:-1] == 1) & (rows.touching[1:] == 0))
    moved = np.linalg.norm(np.diff(rows.p_WT_m, axis=0), axis=1)
    ended = ended[rows.depth_m[ended] > moved[ended] + LOST_M]
    after = rows.p_WT_m[ended + 1] - body_m[ended + 1]
    return int(((after > bounds_m[0]) & (after < bounds_m[1])).all(axis=1).sum())


def _jump_deg(rows: Any) -> float:
    """Largest turn of the direction from tool to proxy in a tick, beside what the tool's own way over its depth makes.

    Where the tool is 0.2 mm and more inside.
    """
    depth = np.maximum(rows.depth_m, 1e-12)
    held = (rows.touching == 1) & (depth > LOST_M)
    u = (rows.p_WP_m - rows.p_WT_m) / depth[:, None]
    turn = np.arccos(np.clip((u[1:] * u[:-1]).sum(axis=1), -1.0, 1.0))
    turn -= np.linalg.norm(np.diff(rows.p_WT_m, axis=0), axis=1) / np.minimum(depth[1:], depth[:-1])
    return float(np.degrees(turn[held[1:] & held[:-1]].max(initial=0.0)))


def _jump_limit_deg(case: dict[str, Any]) -> float:
    for name, limit in JUMP_DEG.items():
        if case["name"].startswith(name):
            return limit
    return JUMP_DEG.get(case["kind"], 180.0)


def _twin(folder: Path, name: str, limits: Limits) -> tuple[Twin, Array]:
    """A twin that touches one of the meshes, device and place to be set later; the mesh's bounds (2, 3)."""
    if name in SUBDIVISIONS:
        mesh = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS[name], radius=0.05)
    else:
        data = np.load(folder / f"mesh_{name}.npz")
        mesh = trimesh.Trimesh(data["vertices_m"], data["faces"], process=False)
    scene = Scene()
    swatch = Swatch("surface", stiffness_N_m=STIFFNESS_N_M)
    scene.add(Mesh.from_trimesh(mesh, "m"), name=BODY, swatch=swatch, two_sided=name in TWO_SIDED)
    twin = Twin(scene, DEVICES["point"], ["wall"], tick_s=TICK_S, a_rate_Hz=1.0 / TICK_S, limits=limits)
    return twin, np.asarray(mesh.bounds, np.float64)


def draw_zoo(rows: Sequence[ZooCase], path: Path, unguarded: Sequence[ZooCase] = ()) -> None:
    """Chart of all cases: energy of a contact, speed at rest, and how far the direction jumps of what is allowed.

    `unguarded` are the same cases without the passivity controller.
    """
    names = list(dict.fromkeys(row.id.split("/")[0] for row in rows))
    series: list[tuple[str, Sequence[ZooCase], dict[str, Any]]] = []
    for (device, grip), (colour, marker) in _MARKS.items():
        style = {"marker": marker, "color": OKABE_ITO[colour], "fillstyle": "none", "markersize": 6}
        series.append((f"{device}, {grip}", [row for row in rows if row.id.endswith(f"/{device}/{grip}")], style))
    if unguarded:
        style = {"marker": "x", "color": AIR, "markersize": 4, "zorder": 1}
        series.append(("all, without passivity controller", unguarded, style))
    height_in = 1.2 + 0.24 * len(names)

    def draw(figure: Any, axes: Any) -> None:
        for axis, (title, unit, limit, value) in zip(axes[0], _COLUMNS, strict=True):
            for label, some, style in series:
                x = [max(LEAST_DRAWN, value(row)) for row in some]
                y = [names.index(row.id.split("/")[0]) for row in some]
                axis.plot(x, y, label=label, linestyle="none", **style)
            axis.axvline(limit, color=OKABE_ITO["black"], linestyle="--", linewidth=1.0)
            axis.set(title=title, xlabel=unit, xscale="log", xlim=(0.7 * LEAST_DRAWN, 30.0))
            axis.set_yticks(range(len(names)), names)
            axis.set_ylim(len(names) - 0.5, -0.5)
        for axis in axes[0, 1:]:
            axis.tick_params(labelleft=False)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5)

    draw_panels(path, 1, 3, (4.6, height_in), draw)
