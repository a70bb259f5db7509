"""The haptic tick. Start reading here: each phase names the module that implements it.

    read       device position; an invalid one is replaced by the last valid one
    couple     virtual coupling of device and proxy, if enabled             device/stabilisers.py
    sweep      move the proxy towards the device through the scene          contact/proxy.py, contact/ball.py
    constrain  the proxy by the faces in the way                            contact/
    describe   the contact in one record that all effects read              describe.py
    render     sum the effects of the touched swatch                        surface/mixer.py
    react      reaction forces and impulses on the bodies
    field      add the effects of the scene, which act on the hand only     surface/mixer.py
    passivity  energy of the wall, if enabled                               device/stabilisers.py
    mix        fade out a removed body, limit the sum to the device         surface/mixer.py
    note       write the row of the tick

`Renderer.step` (one tick), `Renderer.run` (many ticks) and the closed loops call the same function and get the same
bits. A tick never allocates memory, takes a lock or raises an exception; errors are reported as a `Flag`.
"""

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.entry import address_of, call_flags
from hapscene.compiled.native import inlined, native
from hapscene.contact.ball import move_ball
from hapscene.contact.inside import open_puncture
from hapscene.contact.moving import place_bodies
from hapscene.contact.proxy import move_proxy
from hapscene.contact.world import NO_SHADE
from hapscene.device.stabilisers import control_passivity, couple
from hapscene.flags import Flag
from hapscene.geometry import Vector, along, cross, dot, sub
from hapscene.records import Record, Records
from hapscene.render.describe import describe, shade
from hapscene.surface.mixer import FADE_S, fade_removed, limit, render_contact, render_fields
from hapscene.surface.surface_arrays import BALL, COUPLE, FADE, FIELDS, GUARD, PLACE, SHADE, TICK

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["Moved", "run_ticks", "tick", "tick_at", "use_fading", "use_moving_bodies", "use_tick"]

_NOT_FINITE = int(Flag.TOOL_NOT_FINITE)
_UNSETTLED = int(Flag.UNSETTLED)

Moved: TypeAlias = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64], int, int]
"""Moving bodies: arguments of `place_bodies` after the first two."""


@native
def tick(
    world: "World", surface: "Surface", x: float, y: float, z: float, row: Record, a_m_s2: NDArray[np.float64]
) -> int:
    """Compute one tick with the device at (x, y, z) [m] in W; returns flags.

    Writes one `ROW` to `row` and its acceleration samples (block,) to `a_m_s2`. Compiled once for all loops, which
    call it through `surface.entries[TICK]`. Phases that few scenes use are called the same way, if their entry is not
    0.
    """
    start_ns = now_ns(surface.clock)
    entries = surface.entries
    tool_W, flags = _read(surface, x, y, z)
    p_WT = tool_W
    if entries[COUPLE] != 0:
        p_WT = _coupled(surface, tool_W)
    if entries[BALL] != 0:
        flags |= call_flags(entries[BALL], (world, p_WT))
    elif not move_proxy(world, p_WT):
        flags |= _UNSETTLED
    flags |= world.proxy[0].near_flags | world.proxy[0].moving_flags
    contact_ns = now_ns(surface.clock) - start_ns
    describe(world, surface, p_WT)
    if entries[SHADE] != 0:
        call_flags(entries[SHADE], (world, surface))
    flags |= render_contact(surface)
    react(world, surface)
    if entries[FIELDS] != 0:
        flags |= call_flags(entries[FIELDS], (world, surface))
    if surface.total[0].release != 0:
        open_puncture(world)
    if entries[GUARD] != 0:
        flags |= call_flags(entries[GUARD], (surface, tool_W))
    if entries[FADE] != 0:
        flags |= call_flags(entries[FADE], (surface,))
    flags |= limit(surface)
    _keep(surface, tool_W)
    _note(surface, row, a_m_s2)
    row.flags = flags
    row.contact_ns = contact_ns
    row.tick_ns = now_ns(surface.clock) - start_ns
    return int(flags)


@native
def run_ticks(
    world: "World",
    surface: "Surface",
    p_WT_m: NDArray[np.float64],
    moving: NDArray[np.int64],
    X_WB: NDArray[np.float64],
    teleported: NDArray[np.int64],
    rows: Records,
    a_m_s2: NDArray[np.float64],
) -> None:
    """Compute a tick for each position of a path `p_WT_m` (n, 3), with the bodies `moving` (m,) at `X_WB` (n, m, 4, 4).

    A body whose entry in `teleported` (m,) is not 0 jumps to its first pose.
    """
    for k in range(len(p_WT_m)):
        p, moved = p_WT_m[k], (moving, X_WB, teleported, len(moving), k)
        tick_at(world, surface, moved, (p[0], p[1], p[2]), rows[k], a_m_s2[k])


@inlined
def tick_at(
    world: "World", surface: "Surface", moved: Moved, p_WT: Vector, row: Record, a_m_s2: NDArray[np.float64]
) -> None:
    """Place the moving bodies and compute one tick. `moved` holds the arguments of `place_bodies` after these."""
    entries = surface.entries
    if entries[PLACE] != 0:
        call_flags(entries[PLACE], (world, surface, moved[0], moved[1], moved[2], moved[3], moved[4]))
    call_flags(entries[TICK], (world, surface, p_WT[0], p_WT[1], p_WT[2], row, a_m_s2))


def use_tick(world: "World", surface: "Surface", rows: Records, a_m_s2: NDArray[np.float64]) -> None:
    """Compile the tick and the phases that device, mesh and effects need, or load them from the cache.

    Args:
        world, surface: arrays on which the tick will work.
        rows, a_m_s2: (n,) ROW and (n, block) samples of the types that the tick will write.
    """
    entries, point = surface.entries, (0.0, 0.0, 0.0)
    if surface.limits[0].coupling_N_m > 0.0:
        entries[COUPLE] = address_of(couple, surface)
    if surface.limits[0].passivity_Ns_m > 0.0:
        entries[GUARD] = address_of(control_passivity, surface, point)
    if world.proxy[0].radius_m > 0.0:
        entries[BALL] = address_of(move_ball, world, point)
    if world.proxy[0].crease_cos < NO_SHADE:
        entries[SHADE] = address_of(shade, world, surface)
    if len(surface.effects) > surface.contact_count[0]:
        entries[FIELDS] = address_of(render_fields, world, surface)
    entries[TICK] = address_of(tick, world, surface, *point, rows[0], a_m_s2[0])


def use_moving_bodies(world: "World", surface: "Surface") -> None:
    """Compile the code that moves and deforms bodies, or load it from the cache."""
    none = np.zeros(0, np.int64)
    if surface.entries[PLACE] == 0:
        surface.entries[PLACE] = address_of(place_bodies, world, surface, none, np.zeros((1, 0, 4, 4)), none, 0, 0)


def use_fading(surface: "Surface", touched: bool) -> None:
    """Compile the fading of removed bodies, and start it if the removed body is touched."""
    if surface.entries[FADE] == 0:
        surface.entries[FADE] = address_of(fade_removed, surface)
    if touched:
        surface.memory["fading_s"] = FADE_S


@inlined
def _coupled(surface: "Surface", tool_W: Vector) -> Vector:
    """Return the position of the virtual tool of the coupling."""
    now = surface.memory[0].now_W_m
    now[0], now[1], now[2] = tool_W
    call_flags(surface.entries[COUPLE], (surface,))
    return now[0], now[1], now[2]


@inlined
def _read(surface: "Surface", x: float, y: float, z: float) -> tuple[Vector, int]:
    """Return the device position, or the last valid one and a flag if it is not finite."""
    if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
        return (x, y, z), 0
    last = surface.memory[0].tool_W_m
    return (last[0], last[1], last[2]), _NOT_FINITE


@inlined
def _keep(surface: "Surface", tool_W: Vector) -> None:
    """Store the measured device position."""
    last = surface.memory[0].tool_W_m
    last[0], last[1], last[2] = tool_W[0], tool_W[1], tool_W[2]


@inlined
def _note(surface: "Surface", row: np.record, a_m_s2: NDArray[np.float64]) -> None:
    """Write the row of the tick."""
    touch, total = surface.touch[0], surface.total[0]
    for i in range(3):
        row.p_WT_m[i] = touch.p_WT_m[i]
        row.p_WP_m[i] = touch.p_WP_m[i]
        row.p_WC_m[i] = touch.p_WC_m[i]
        row.nhat_W[i] = touch.nhat_W[i]
        row.f_W_N[i] = total.f_W_N[i]
        row.f_body_W_N[i] = surface.memory[0].f_body_W_N[i]
    row.depth_m = touch.depth_m
    row.touching = touch.touching
    row.began = touch.began
    row.approach_m_s = touch.approach_m_s
    row.body = touch.body
    row.face = touch.face
    row.swatch = touch.swatch if touch.touching == 1 else -1
    row.slip_m_s = touch.slip_m_s
    row.normal_force_N = touch.normal_force_N
    for i in range(touch.block):
        a_m_s2[i] = total.a_m_s2[i]


@inlined
def react(world: "World", surface: "Surface") -> None:
    """Write the reaction on the touched body, which acts at the contact point, and add the impulses on all bodies.

    If the active planes belong to several bodies, each of the others receives the share of the normal force with which
    its planes push, and the touched body receives the rest with the whole tangential force, so that the sum is exact.
    Forces that an effect assigns to a punctured body (`f_inside_W_N`) act on that body. Impulses are running totals, so
    that a program that reads them rarely loses nothing. Runs before the effects of the scene, so `surface.total` holds
    the contact force alone.
    """
    touch, proxy, memory = surface.touch[0], world.proxy[0], surface.memory[0]
    f = surface.total[0].f_W_N
    force = (-f[0], -f[1], -f[2])
    at = (touch.p_WC_m[0], touch.p_WC_m[1], touch.p_WC_m[2])
    index = touch.body
    for k in range(touch.inside):
        g = surface.total[0].f_inside_W_N[k]
        force = (force[0] + g[0], force[1] + g[1], force[2] + g[2])
        _give(world, proxy.punctured[k], touch, at, (-g[0], -g[1], -g[2]))
    if touch.touching == 0:
        index = proxy.punctured[proxy.puncture_count - 1] if proxy.puncture_count > 0 else -1
        if index < 0 and dot(force, force) > 0.0:  # pulls of adhesion after the contact act on the body that was left
            index = touch.left_body
    elif touch.depth_m > 0.0:
        normal_N = dot(force, (touch.nhat_W[0], touch.nhat_W[1], touch.nhat_W[2]))
        # the device presses along the normal with depth = Σ push; each plane carries push/depth of the normal force
        for i in range(proxy.count):
            if proxy.body[i] != index:
                share_N = normal_N * proxy.push_m[i] / touch.depth_m
                n = (proxy.nhat_W[i, 0], proxy.nhat_W[i, 1], proxy.nhat_W[i, 2])
                force = along(force, -share_N, n)
                # the force passes through the centre of the tip, so its moment is that about the point of contact
                centre = (touch.p_WP_m[0], touch.p_WP_m[1], touch.p_WP_m[2])
                _give(world, proxy.body[i], touch, centre, (share_N * n[0], share_N * n[1], share_N * n[2]))
    if index < 0:
        force = (0.0, 0.0, 0.0)
    else:
        _give(world, index, touch, at, force)
    for i in range(3):
        memory.f_body_W_N[i] = force[i]


@native
def _give(world: "World", index: int, touch: np.record, at: Vector, force: Vector) -> None:
    """Add the linear and angular impulse of a force at a point over this tick."""
    o, lead, impulse = world.bodies[index].p_WB_m, world.bodies[index].shift_W_m, world.impulse[index]
    arm = sub(at, (o[0] - lead[0], o[1] - lead[1], o[2] - lead[2]))
    torque = cross(arm, force)
    for i in range(3):
        impulse[i] += force[i] * touch.tick_s
        impulse[3 + i] += torque[i] * touch.tick_s
