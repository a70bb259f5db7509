"""The zoo in closed loop: meshes and tool paths that are hard for point contact, with a hand that pushes 3 N.

A folder as ../shared/zoo has `cases.json`, and for each case a mesh and the path of a tool. The path is first played
through the renderer as it is; what it meets there is what the hand then aims for. It goes along the proxy, on the
surface, and pushes with `PUSH_N` against the normal: that of the surface where it touches, else that of the plan. Such
a push has a potential, the depth, so the hand itself adds no energy; a push along the planned normals would drive a
light hand off any body rounder than `PUSH_N` over its spring. It comes and goes as fast as muscles do, and the spring
aims as deep as the push will bring the tool, so that the push and not the grip sets the force. Where the path last is
well inside, the hand holds still for a second, still pressed, and draws the tool out. Pokes are held where they are
deepest.

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
from numpy.typing import NDArray

from hapscene.contact.world import records
from hapscene.device.arm import find_tip
from hapscene.device.hand import grip_named
from hapscene.device.model import limits_of
from hapscene.device.omni import Omni, stand
from hapscene.device.omni_kinematics import reachable, tip, turns_at
from hapscene.device.omni_record import OmniFlag
from hapscene.device.point import PointMass
from hapscene.native import native
from hapscene.records import ROW
from hapscene.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.chart import draw_panels
from hapscene.surface.swatch import Swatch
from hapscene.tick import place_bodies
from hapscene.twin.feel import FELT
from hapscene.twin.loop import beat, take_grip
from hapscene.twin.twin import Twin
from hapscene.view.palette import OKABE_ITO

Array = NDArray[np.float64]

TICK_S: Final = 1e-3
"""Period of the force channel [s]: the zoo's paths are sampled at it."""

STIFFNESS_N_M: Final = 500.0
"""Stiffness of every surface [N/m]."""

PUSH_N: Final = 3.0
"""With what the hand pushes [N]: nearly all that an Omni can answer."""

HAND_S: Final = 0.05
"""Time constant with which a push comes and goes [s]: that of muscles."""

HOLD_S: Final = 1.0
"""How long the hand holds still at the end [s]."""

RELEASE_S: Final = 0.3
"""How long it takes to draw the tool out [s]."""

RELEASE_M: Final = 0.02
"""How far [m]."""

POKE_TICKS: Final = 20
"""Ticks of each poke, in the cases that are many pokes: the renderer starts anew at each."""

POKE_HOLD: Final = 130
"""Ticks for which the hand then goes on pushing: it is slower than the path."""

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

LETS_GO: Final = ("open", "edge90", "wedge20")
"""Kinds and cases where a surface ends: contact is rightly lost there while the tool is deep."""

DEVICES: Final[dict[str, PointMass | Omni]] = {
    "point": PointMass(0.045, 0.1, 0.26, 5.5e-5),
    "omni": Omni(thermal_s=math.inf),
}
"""What the hand holds: the Omni as a point mass, and all of it, its motors cold: 3 N overheat them within 5 s."""

GRIPS: Final = ("light", "firm")
"""How it holds it."""

_NONE: Final = (np.zeros(0, np.int64), np.zeros((1, 0, 4, 4)))


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
    (
        "jump of direction",
        "largest turn in a tick, of what is allowed [1]",
        1.0,
        lambda row: row.jump_deg / row.jump_limit_deg,
    ),
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
) -> Iterator[ZooCase]:
    """Run the cases of a folder (those named, or all), with each device and grip, at the Omni's limits.

    Raises:
        OSError: a file that is not there.
    """
    folder = Path(folder)
    mesh, twin = "", None
    for case in json.loads((folder / "cases.json").read_text()):
        if names and case["name"] not in names:
            continue
        if twin is None or case["mesh"] != mesh:
            mesh, twin = case["mesh"], _twin(folder, case["mesh"])
        path = np.load(folder / f"{case['path']}.npz")
        plan = _plan(twin.renderer, case, path["tool_m"], path.get("body_m"))
        twin.X_WD = stand(0.5 * (plan.on_m.min(axis=0) + plan.on_m.max(axis=0)))
        for device in devices:
            if device == "omni" and not _reaches(twin.X_WD, plan):
                continue
            for grip in grips:
                row = _run(twin, case, plan, device, grip)
                say(f"{row}\n")
                yield row


@dataclass(frozen=True)
class _Plan:
    """What the hand means to do.

    Attributes:
        parts: (start, stop) of what starts anew each time: all, or a poke.
        on_m: (n, 3) place on the surface, or in the air, that it goes along.
        nhat: (n, 3) the surface's normal there; 0 where it does not push.
        body_m: (n, 3) place of the body, or None for one that stands still.
        rest: ticks in which rest is looked for.
    """

    parts: list[tuple[int, int]]
    on_m: Array
    nhat: Array
    body_m: Array | None
    rest: slice


def _plan(renderer: Renderer, case: dict[str, Any], tool_m: Array, body_m: Array | None) -> _Plan:
    if case["name"].startswith("poke"):
        return _plan_pokes(renderer, tool_m.reshape(-1, POKE_TICKS, 3))
    renderer.reset(tool_m[0])
    seen_all = renderer.run(tool_m, _poses(body_m, 0, len(tool_m)))
    stop = int(np.flatnonzero(seen_all.depth_m >= 0.5 * seen_all.depth_m.max())[-1])
    hold, release = round(HOLD_S / TICK_S), round(RELEASE_S / TICK_S)
    still = np.concatenate((np.arange(stop + 1), np.full(hold + release, stop)))
    out_m = np.concatenate((np.zeros(stop + 1 + hold), np.linspace(0.0, RELEASE_M, release)))
    nhat = (seen_all.nhat_W * seen_all.touching[:, None])[still]
    on_m = seen_all.p_WP_m[still] + nhat * out_m[:, None]
    nhat[stop + 1 + hold :] = 0.0
    rest = slice(stop + 1 + hold // 2, stop + 1 + hold)
    return _Plan([(0, len(still))], on_m, nhat, None if body_m is None else body_m[still], rest)


def _plan_pokes(renderer: Renderer, tool_m: Array) -> _Plan:
    """Each poke (m, POKE_TICKS, 3) to where it is deepest, and on pushing there."""
    n = POKE_TICKS + POKE_HOLD
    on_m, nhat = np.zeros((len(tool_m), n, 3)), np.zeros((len(tool_m), n, 3))
    for k, poke in enumerate(tool_m):
        renderer.reset(poke[0])
        seen = renderer.run(poke)
        still = np.minimum(np.arange(n), int(np.argmax(seen.depth_m)))
        on_m[k], nhat[k] = seen.p_WP_m[still], (seen.nhat_W * seen.touching[:, None])[still]
    parts = [(a, a + n) for a in range(0, n * len(tool_m), n)]
    return _Plan(parts, on_m.reshape(-1, 3), nhat.reshape(-1, 3), None, slice(0, 0))


def _run(twin: Twin, case: dict[str, Any], plan: _Plan, device: str, grip: str) -> ZooCase:
    twin.device = DEVICES[device]
    n = len(plan.on_m)
    rows, felt = records(n, ROW), records(n, FELT)
    made_J = [0.0]
    for a, b in plan.parts:
        twin.reset(plan.on_m[a])
        poses = _NONE if plan.body_m is None else (np.zeros(1, np.int64), _poses(plan.body_m, a, b)["it"][:, None])
        hand = (plan.on_m[a:b], plan.nhat[a:b], np.zeros(1), grip_named(grip).row())
        render = (twin.renderer.world, twin.renderer.surface, twin.body)
        motor_m = np.zeros((b - a + 1, 3))
        press_along(*render, *hand, *poses, rows[a:b], felt[a:b], motor_m, np.zeros((2, 1)))
        carried_m = (
            np.zeros((b - a, 3))
            if plan.body_m is None
            else np.diff(plan.body_m[a:b], axis=0, append=plan.body_m[b - 1 : b])
        )
        made_J.append(_made_J(rows[a:b], felt[a:b], np.diff(motor_m, axis=0) - carried_m))
    v = felt.v_W_m_s[plan.rest]
    parts = [slice(a, b) for a, b in plan.parts]
    lets_go = case["name"] in LETS_GO or case["kind"] in LETS_GO
    return ZooCase(
        id=f"{case['name']}/{device}/{grip}",
        touching=float(rows.touching.mean()),
        not_finite=int((~np.isfinite(rows.f_W_N + felt.p_W_m)).any(axis=1).sum()),
        lost=0 if lets_go else sum(_lost(rows[part]) for part in parts),
        jump_deg=max(_jump_deg(rows[part]) for part in parts),
        jump_limit_deg=_jump_limit_deg(case),
        rest_mm_s=1e3 * float(np.sqrt((v**2).sum(axis=1).mean())) if len(v) else 0.0,
        energy_mJ=1e3 * max(made_J),
        depth_mm=1e3 * float(rows.depth_m.max()),
        limited=float(((felt.trouble & int(OmniFlag.TORQUE_LIMITED)) > 0).mean()),
    )


@native
def press_along(
    world: Any,
    surface: Any,
    body: Any,
    on_m: Array,
    nhat: Array,
    push_N: Array,
    grip: Array,
    moving: NDArray[np.int64],
    X_WB: Array,
    rows: Any,
    felt: Any,
    motor_m: Array,
    a_m_s2: Array,
) -> None:
    """Go along places `on_m` (n, 3) and push against the normal: of the surface that is touched, else `nhat` (n, 3).

    Where `nhat` is 0 the hand does not push. `push_N` (1,) is what it pushes with, `grip` (3,) how it holds. Fills
    `motor_m` (n+1, 3) with where the motors' force acts, at the start of each tick and the end of the last; a_m_s2
    (2, block) is room for samples.
    """
    hand, touch = body.arm.hand[0], surface.touch[0]
    share = 1.0 - math.exp(-touch.tick_s / HAND_S)
    for k in range(len(on_m)):
        place_bodies(world, surface, moving, X_WB, k)
        take_grip(body, grip[0], grip[1], grip[2])
        after = min(k + 1, len(on_m) - 1)
        pushes = nhat[k, 0] != 0.0 or nhat[k, 1] != 0.0 or nhat[k, 2] != 0.0
        push_N[0] += share * ((PUSH_N if pushes else 0.0) - push_N[0])
        for i in range(3):
            into = -touch.nhat_W[i] if touch.touching == 1 else -nhat[k, i]
            hand.push_N[i] = push_N[0] * into
            hand.target_m[i] = on_m[k, i] + push_N[0] * into / STIFFNESS_N_M
            hand.target_m_s[i] = (on_m[after, i] - on_m[k, i]) / touch.tick_s
        _find_motors(body.arm, motor_m[k])
        beat(world, surface, body, rows[k], a_m_s2[0], felt[k], a_m_s2[1])
    _find_motors(body.arm, motor_m[len(on_m)])


@native
def _find_motors(arm: Any, place_m: Array) -> None:
    """Where the motors' force acts: a point mass's place, or the end of an Omni's arm without its structure's give."""
    if arm.is_omni == 0:
        p = find_tip(arm)
        place_m[0], place_m[1], place_m[2] = p[0], p[1], p[2]
        return
    omni = arm.omni[0]
    p = tip(turns_at(omni.q[0], omni.q[1], omni.q[2]))
    for i in range(3):
        place_m[i] = omni.p_WD_m[i] + omni.R_WD[i, 0] * p[0] + omni.R_WD[i, 1] * p[1] + omni.R_WD[i, 2] * p[2]


def _made_J(rows: Any, felt: Any, way_m: Array) -> float:
    """Largest work of the motors over a contact [J], for the way (n, 3) over the body of what they act on.

    Not the way of the encoders, whose steps would add ½KΔ² of their own at each count, nor that of an Omni's tool,
    which is a spring further on.
    """
    work = (felt.f_motor_W_N * way_m).sum(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], rows.touching, [0]))))
    sums = np.concatenate(([0.0], np.cumsum(work)))
    return float((sums[edges[1::2]] - sums[edges[0::2]]).max(initial=0.0))


def _lost(rows: Any) -> int:
    """Ticks in which contact ended with the tool deeper than it moved."""
    ended = np.flatnonzero((rows.touching[:-1] == 1) & (rows.touching[1:] == 0))
    moved = np.linalg.norm(np.diff(rows.p_WT_m, axis=0), axis=1)
    return int((rows.depth_m[ended] > moved[ended] + LOST_M).sum())


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


def _reaches(X_WD: Array, plan: _Plan) -> bool:
    """Whether an Omni there reaches all of a plan; looked at each tenth tick."""
    return all(reachable(X_WD[:3, :3].T @ (p - X_WD[:3, 3])) for p in plan.on_m[::10])


def _poses(body_m: Array | None, start: int, stop: int) -> dict[str, Array]:
    if body_m is None:
        return {}
    X_WB = np.tile(np.eye(4), (stop - start, 1, 1))
    X_WB[:, :3, 3] = body_m[start:stop]
    return {"it": X_WB}


def _twin(folder: Path, name: str) -> Twin:
    """A twin that touches one of the meshes; device and place are set later."""
    import trimesh

    if name in SUBDIVISIONS:
        mesh = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS[name], radius=0.05)
    else:
        data = np.load(folder / f"mesh_{name}.npz")
        mesh = trimesh.Trimesh(data["vertices_m"], data["faces"], process=False)
    scene = Scene()
    swatch = Swatch("surface", stiffness_N_m=STIFFNESS_N_M)
    scene.add(Mesh.from_trimesh(mesh, "m"), name="it", swatch=swatch, two_sided=name in TWO_SIDED)
    limits = limits_of("omni", TICK_S)
    return Twin(scene, DEVICES["point"], ["wall"], tick_s=TICK_S, a_rate_Hz=1.0 / TICK_S, limits=limits)


def draw_zoo(rows: Sequence[ZooCase], path: Path) -> None:
    """Chart of all cases: energy of a contact, speed at rest, and how far the direction jumps of what is allowed."""
    names = list(dict.fromkeys(row.id.split("/")[0] for row in rows))
    height_in = 1.2 + 0.24 * len(names)

    def draw(_: Any, axes: Any) -> None:
        for axis, (title, unit, limit, value) in zip(axes[0], _COLUMNS, strict=True):
            for (device, grip), (colour, marker) in _MARKS.items():
                some = [row for row in rows if row.id.endswith(f"/{device}/{grip}")]
                x = [max(LEAST_DRAWN, value(row)) for row in some]
                y = [names.index(row.id.split("/")[0]) for row in some]
                style = {"color": OKABE_ITO[colour], "fillstyle": "none", "markersize": 6}
                axis.plot(x, y, marker, label=f"{device}, {grip}", **style)
            axis.axvline(limit, color=OKABE_ITO["black"], linestyle="--", linewidth=1.0)
            axis.set(title=title, xlabel=unit, xscale="log", xlim=(0.7 * LEAST_DRAWN, 30.0))
            axis.set_yticks(range(len(names)), names)
            axis.set_ylim(len(names) - 0.5, -0.5)
        for axis in axes[0, 1:]:
            axis.tick_params(labelleft=False)
        axes[0, 2].legend(loc="upper center", bbox_to_anchor=(-0.6, -0.12), ncols=4)

    draw_panels(path, 1, 3, (4.6, height_in), draw)
