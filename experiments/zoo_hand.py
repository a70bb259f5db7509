"""The hand of the zoo in closed loop, compiled, so apart from its cases: what it means to do, and how it pushes.

The path is first played through the renderer as it is; what it meets there is what the hand then aims for. It goes
along the proxy, on the surface, and pushes with `PUSH_N` against the normal: that of the surface where it touches, else
that of the plan. Such a push has a potential, the depth, so the hand itself adds no energy; a push along the planned
normals would drive a light hand off any body rounder than `PUSH_N` over its spring. It comes and goes as fast as
muscles do, and the spring aims as deep as the push will bring the tool, so that the push and not the grip sets the
force. Where the path last is well inside, the hand holds still for a second, still pressed, and draws the tool out.
Pokes are held where they are deepest.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.arm import SIMULATED_POINT, find_tip
from hapscene.device.omni_kinematics import reachable, tip, turns_at
from hapscene.loop.closed_loop import take_grip, tick_tool
from hapscene.native import native
from hapscene.renderer import Renderer

Array = NDArray[np.float64]

BODY: Final = "it"
"""Name of the body in a case's scene."""

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


@dataclass(frozen=True)
class Plan:
    """What the hand means to do.

    Attributes:
        parts: (start, stop) of what starts anew each time: all, or a poke.
        on_m: (n, 3) place on the surface, or in the air, that it goes along.
        nhat: (n, 3) the surface's normal there; 0 where it does not push.
        body_m: (n, 3) place of the body.
        moves: whether it does.
        rest: ticks in which rest is looked for.
    """

    parts: list[tuple[int, int]]
    on_m: Array
    nhat: Array
    body_m: Array
    moves: bool
    rest: slice

    def poses(self, part: tuple[int, int]) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
        """The scene's only body at its poses in a part, as the compiled tick takes them; it never jumps."""
        moving = np.zeros(int(self.moves), np.int64)
        X_WB = np.tile(np.eye(4), (part[1] - part[0], len(moving), 1, 1))
        X_WB[..., :3, 3] = self.body_m[part[0] : part[1], None]
        return moving, X_WB, np.zeros_like(moving)


def make_plan(renderer: Renderer, case: dict[str, Any], tool_m: Array, body_m: Array | None) -> Plan:
    """What the hand is to do along a path (n, 3) of the tool, as the renderer has it; the body at places (n, 3)."""
    if case["name"].startswith("poke"):
        return _plan_pokes(renderer, tool_m.reshape(-1, POKE_TICKS, 3))
    renderer.reset(tool_m[0])
    seen = renderer.run(tool_m, {} if body_m is None else {BODY: _poses(body_m)})
    stop = int(np.flatnonzero(seen.depth_m >= 0.5 * seen.depth_m.max())[-1])
    hold, release = round(HOLD_S / TICK_S), round(RELEASE_S / TICK_S)
    still = np.concatenate((np.arange(stop + 1), np.full(hold + release, stop)))
    out_m = np.concatenate((np.zeros(stop + 1 + hold), np.linspace(0.0, RELEASE_M, release)))
    nhat = (seen.nhat_W * seen.touching[:, None])[still]
    on_m = seen.p_WP_m[still] + nhat * out_m[:, None]
    nhat[stop + 1 + hold :] = 0.0
    rest = slice(stop + 1 + hold // 2, stop + 1 + hold)
    where_m = np.zeros((len(still), 3)) if body_m is None else body_m[still]
    return Plan([(0, len(still))], on_m, nhat, where_m, body_m is not None, rest)


def _plan_pokes(renderer: Renderer, tool_m: Array) -> Plan:
    """Each poke (m, POKE_TICKS, 3) to where it is deepest, and on pushing there."""
    n = POKE_TICKS + POKE_HOLD
    on_m, nhat = np.zeros((len(tool_m), n, 3)), np.zeros((len(tool_m), n, 3))
    for k, poke in enumerate(tool_m):
        renderer.reset(poke[0])
        seen = renderer.run(poke)
        still = np.minimum(np.arange(n), int(np.argmax(seen.depth_m)))
        on_m[k], nhat[k] = seen.p_WP_m[still], (seen.nhat_W * seen.touching[:, None])[still]
    parts = [(a, a + n) for a in range(0, n * len(tool_m), n)]
    return Plan(parts, on_m.reshape(-1, 3), nhat.reshape(-1, 3), np.zeros((on_m.size // 3, 3)), False, slice(0, 0))


def reaches(X_WD: Array, plan: Plan) -> bool:
    """Whether an Omni there reaches all of a plan; looked at each tenth tick."""
    return all(reachable(X_WD[:3, :3].T @ (p - X_WD[:3, 3])) for p in plan.on_m[::10])


def _poses(body_m: Array) -> Array:
    X_WB = np.tile(np.eye(4), (len(body_m), 1, 1))
    X_WB[:, :3, 3] = body_m
    return X_WB


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
    teleported: NDArray[np.int64],
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
        moved = (moving, X_WB, teleported, len(moving), k)
        tick_tool(world, surface, body, moved, (rows[k], a_m_s2[0], felt[k], a_m_s2[1]))
    _find_motors(body.arm, motor_m[len(on_m)])


@native
def _find_motors(arm: Any, place_m: Array) -> None:
    """Where the motors' force acts: a point mass's place, or the end of an Omni's arm without its structure's give."""
    if arm.kind == SIMULATED_POINT:
        p = find_tip(arm)
        place_m[0], place_m[1], place_m[2] = p[0], p[1], p[2]
        return
    omni = arm.omni[0]
    p = tip(turns_at(omni.q[0], omni.q[1], omni.q[2]))
    for i in range(3):
        place_m[i] = omni.p_WD_m[i] + omni.R_WD[i, 0] * p[0] + omni.R_WD[i, 1] * p[1] + omni.R_WD[i, 2] * p[2]
