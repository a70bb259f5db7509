"""From one level of a fidelity to another between two ticks: what is felt is coarser or finer, and nothing jumps.

All levels are there from the start: their meshes in one world, their swatches' numbers and tables in one surface, and
a step only writes anew which of them each body and swatch has. What effects remember goes on.

**The proxy** is on the same side of each body before and after. Which that is, rays tell (`WAYS`): from outside they
meet fronts, from inside backs. Where a surface of the new level has passed the proxy, it is set beyond it, a skin off,
and from there moves to the tool as in any tick. Where it cannot be told, the step is not taken, and tried again in the
next tick.

**The force** of the first tick is that of the last one. What it so differs by from the new level's becomes an offset,
which goes by at most `HANDOVER_N` a tick; nothing else of the path is held back. An offset of size o does at most
o² v / (2 · 50 N/s) of work beyond that of the two levels on a tool that moves at v: 0.25 mJ at 0.5 N and 0.1 m/s. What
the two levels hold of potential energy where the tool is differs by ½ K (d² − d′²), as their depths differ: that much a
step gives or takes, and the passivity controller does not count it.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.contact.deformation import look_direction
from hapscene.contact.embree import first_face
from hapscene.contact.planes import copy_plane
from hapscene.contact.proxy import move
from hapscene.contact.triangle import corners, plane, to_body, to_world
from hapscene.contact.world import WAYS, place_ball
from hapscene.device.stabilisers import stored_energy
from hapscene.flags import Flag
from hapscene.geometry import Vector, along, dot, norm, sub
from hapscene.native import native

HANDOVER_N: Final = 0.05
"""Most by which the force changes in a tick because of a step [N]: a tenth of what is felt of the 0.7 N (7 %, Pang et
al. 1991) that a hand presses with, every tick; 0.5 N are handed over in 10 ms."""

ROUNDS: Final = 4
"""How often the proxy is set beyond a surface, as where two bodies meet, before the step is given up [count]."""

_COARSER: Final = int(Flag.COARSER)

JUST: Final = 1
"""Value of `stepped`: the next tick is the first after a step."""

SINCE: Final = 2
"""Value of `stepped`: an offset is left, or the level is not the first."""

LEVEL_STATE: Final = np.dtype(
    [
        ("level", "i8"),  # that is felt
        ("wanted", "i8"),  # that is to be felt from the next tick on
        ("count", "i8"),  # levels in all
        ("down", "i8"),  # steps so far to a coarser one
        ("up", "i8"),  # and to a finer one
        ("given_up", "i8"),  # ticks between which a step could not be taken
        # of the load watcher, see `hapscene.fidelity.load`
        ("budget_ns", "i8"),  # what a tick may take, 0 where nobody watches
        ("tick", "i8"),
        ("over", "i8", (2,)),  # the last ticks that took longer
        ("calm", "i8"),  # ticks in a row that took well less
        ("patience", "i8"),  # how many there must be before a step up
        ("up_at", "i8"),  # tick of the last step up
    ],
    align=True,
)


class Levels(NamedTuple):
    """The levels of a world and its surface. l levels, b bodies, s swatches, e effects; l is 0 where there is but one.

    What bodies have is as in `BODY`, what swatches have as in `Surface`.
    """

    state: Any  # (1,) LEVEL_STATE
    search: NDArray[np.int64]  # (l, b)
    center_B_m: NDArray[np.float64]  # (l, b, 3)
    radius_m: NDArray[np.float64]  # (l, b)
    face: NDArray[np.int64]  # (l, b)
    paint_start: NDArray[np.int64]  # (l, b)
    param_start: NDArray[np.int64]  # (l, s + 1, e)
    table_start: NDArray[np.int64]  # (l, s + 1, e + 1)
    fold_mass_kg: NDArray[np.float64]  # (l, s)
    side: NDArray[np.int64]  # (b,) scratch: on which side of a body the proxy is; 0 of no matter


@native
def hand_over(surface: Any) -> int:
    """Add what is left of the last step to this tick's force; returns flags."""
    memory, f = surface.memory[0], surface.total[0].f_W_N
    offset = memory.offset_W_N
    if memory.stepped == JUST:
        for i in range(3):
            offset[i] = memory.f_W_N[i] - f[i]
    else:
        size = norm((offset[0], offset[1], offset[2]))
        less = HANDOVER_N * min(1.0, surface.touch[0].tick_s / TICK_S)
        for i in range(3):
            offset[i] *= (size - less) / size if size > less else 0.0
    surface.touch[0].stepped = 0
    memory.stepped = SINCE if memory.level > 0 or offset[0] != 0.0 or offset[1] != 0.0 or offset[2] != 0.0 else 0
    for i in range(3):
        f[i] += offset[i]
    return _COARSER if memory.level > 0 else 0


@native
def take_step(world: Any, surface: Any, levels: Any) -> None:
    """Between two ticks: go to the level that is wanted, where it can be."""
    state = levels.state[0]
    before, to = state.level, state.wanted
    if to == before:
        return
    if not _go_to(world, surface, levels, to):
        state.given_up += 1
        return
    if to > before:
        state.down += 1
    else:
        state.up += 1


@native
def _go_to(world: Any, surface: Any, levels: Any, to: int) -> bool:
    """Feel a level from the next tick on; False, and nothing changed, where the proxy would change sides."""
    proxy, state = world.proxy[0], levels.state[0]
    before = state.level
    p_W = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    for k in range(len(world.bodies)):
        levels.side[k] = 0
        body, ball = world.bodies[k], world.ball_W_m[k]
        if levels.search[before, k] == levels.search[to, k] or body.passed != 0 or body.radius_m < 0.0:
            continue
        reach = max(levels.radius_m[before, k], levels.radius_m[to, k])
        if norm(sub(p_W, (ball[0], ball[1], ball[2]))) <= reach + ball[3]:
            levels.side[k] = _side(world, k, p_W)
    _put_shapes(world, levels, to)
    found, p_W = _keep_sides(world, levels, p_W)
    if not found:
        _put_shapes(world, levels, before)
        return False
    _put_surface(surface, levels, to)
    _drop_planes(world, levels, before, to)
    for i in range(3):
        proxy.p_W_m[i] = p_W[i]
    proxy.near_room_m = 0.0
    state.level = to
    _meet(world, surface)
    surface.memory[0].level, surface.memory[0].stepped = to, JUST
    return True


@native
def _put_shapes(world: Any, levels: Any, to: int) -> None:
    """Give each body the shape of a level."""
    for k in range(len(world.bodies)):
        body = world.bodies[k]
        if body.radius_m < 0.0:  # it was removed
            continue
        body.search, body.radius_m, body.face = levels.search[to, k], levels.radius_m[to, k], levels.face[to, k]
        body.mesh_row = levels.face[to, k]  # such worlds have no other rows
        for i in range(3):
            body.center_B_m[i] = levels.center_B_m[to, k, i]
        place_ball(body, world.ball_W_m[k])


@native
def _put_surface(surface: Any, levels: Any, to: int) -> None:
    """Give each face, swatch and effect what a level has."""
    for k in range(len(surface.paint_start)):
        surface.paint_start[k] = levels.paint_start[to, k]
    for s in range(surface.param_start.shape[0]):
        for e in range(surface.param_start.shape[1]):
            surface.param_start[s, e] = levels.param_start[to, s, e]
        for e in range(surface.table_start.shape[1]):
            surface.table_start[s, e] = levels.table_start[to, s, e]
    for s in range(len(surface.fold_mass_kg)):
        surface.fold_mass_kg[s] = levels.fold_mass_kg[to, s]


@native
def _side(world: Any, index: int, p_W: Vector) -> int:
    """On which side of a body's surface a point is: 1 where rays from it meet more fronts than backs, −1 else."""
    p_B, fronts = to_body(world.bodies[index], p_W), 0
    for way in range(WAYS):
        face, _ = _face_along(world, index, p_B, look_direction(way))
        if face >= 0:
            n, _ = plane(*corners(world, world.bodies[index], face))
            fronts += 1 if dot(n, look_direction(way)) < 0.0 else -1
    return 1 if fronts >= 0 else -1


@native
def _face_along(world: Any, index: int, p_B: Vector, direction: Vector) -> tuple[int, float]:
    """The first face of a body along a ray, −1 for none, and how far off it is [m]."""
    body = world.bodies[index]
    c = body.center_B_m
    origin = (p_B[0] - c[0], p_B[1] - c[1], p_B[2] - c[2])
    face = first_face(body.search, world.ray, origin, direction, norm(origin) + body.radius_m, 0)
    return face, float(world.ray[8])


@native
def _keep_sides(world: Any, levels: Any, p_W: Vector) -> tuple[bool, Vector]:
    """The point, set beyond the surfaces that have passed it; False where it cannot be on its side of all bodies."""
    for _ in range(ROUNDS):
        stays = True
        for k in range(len(world.bodies)):
            side = levels.side[k]
            if side != 0 and _side(world, k, p_W) != side:
                stays = False
                p_W = _beyond(world, k, p_W, side)
        if stays:
            return True, p_W
    return False, p_W


@native
def _beyond(world: Any, index: int, p_W: Vector, side: int) -> Vector:
    """The nearest place on that side of a body's surface, along one of `WAYS`; the point itself where there is none."""
    body = world.bodies[index]
    p_B = to_body(body, p_W)
    nearest, at = math.inf, p_B
    for way in range(WAYS):
        direction = look_direction(way)
        face, away = _face_along(world, index, p_B, direction)
        if face < 0 or away >= nearest:
            continue
        n, _ = plane(*corners(world, body, face))
        if side * dot(n, direction) > 0.0:
            nearest = away
            at = along(along(p_B, away, direction), side * 2.0 * body.skin_m, n)
    return to_world(body, at)


@native
def _drop_planes(world: Any, levels: Any, before: int, to: int) -> None:
    """Have the bodies hold the proxy no more that have another shape."""
    proxy = world.proxy[0]
    kept, count = 0, proxy.count
    for i in range(count):
        k = proxy.body[i]
        if levels.search[before, k] == levels.search[to, k]:
            copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept


@native
def _meet(world: Any, surface: Any) -> None:
    """Find the contact where the tool was last, and have it remembered as the last tick's: nothing slipped, or hit."""
    proxy, touch, memory, moved = world.proxy[0], surface.touch[0], surface.memory[0], world.moved
    for i in range(1, moved[0] + 1):
        world.bodies[moved[i]].moved = 0  # it was taken along in the last tick
    tool_W = (memory.p_WT_m[0], memory.p_WT_m[1], memory.p_WT_m[2])
    move(world, tool_W)
    for i in range(1, moved[0] + 1):
        world.bodies[moved[i]].moved = 1
    for i in range(3):
        memory.p_WP_m[i] = proxy.p_WP_m[i]
    touch.depth_m = 0.0
    if proxy.held == 1:
        touch.depth_m = norm(sub((proxy.p_WP_m[0], proxy.p_WP_m[1], proxy.p_WP_m[2]), tool_W))
        touch.body = proxy.body[proxy.by]
        if touch.touching == 0:
            touch.touching = 1
            for i in range(3):
                memory.slip_m_s[i] = 0.0
    touch.stepped = 1
    f, n = memory.f_W_N, memory.nhat_W
    memory.stored_J = stored_energy(surface.limits[0], touch, f[0] * n[0] + f[1] * n[1] + f[2] * n[2])
