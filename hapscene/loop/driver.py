"""The driver of all closed loops, simulated and in real time, compiled once.

A `Loop` holds everything that a tick acts on. `CHANNEL.pace` selects who waits for the next tick:

    FREE       no wait: the ticks of a reference trajectory run one after the other (`Twin`)
    TIMED      the driver waits until a tick is due (simulated devices of a `Servo`, and compiled drivers)
    CALLED     the caller waits, reads the device and writes to it between single ticks (drivers in Python)
    SCHEDULED  a thread of the vendor's library calls single ticks

With several devices, the servo keeps the time, and the vendors' threads call `remove_stale_force`.
"""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.bound_call import BoundCall
from hapscene.compiled.entry import address_of, c_caller, call_flags
from hapscene.compiled.native import inlined, native
from hapscene.constants import TINY
from hapscene.contact.prediction import FRAME, PREDICTED, predict_bodies
from hapscene.device.driver import BUTTON_ROOM
from hapscene.device.safety import STALL_S
from hapscene.device.sim.arm import CONNECTED
from hapscene.loop.checkpoint import memory_of, write_checkpoint
from hapscene.loop.closed_loop import Tool, take_grip, tick_tool
from hapscene.loop.timing import BIN_COUNT, TIMING, Timer, count_in_bin, wait_for_tick
from hapscene.records import Record, Records, records

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.render.renderer import Renderer
    from hapscene.surface.surface_arrays import Surface

__all__ = [
    "AIM",
    "BLOCKING",
    "CHANNEL",
    "ENDED",
    "Bodies",
    "Exchange",
    "Loop",
    "bound",
    "drive",
    "new_loop",
    "remove_stale_force",
    "static_bodies",
]

FREE, TIMED, CALLED, SCHEDULED = 0, 1, 2, 3

CHANNEL: Final = np.dtype(
    [
        # fields written by the application
        ("pause", "i8"),  # 1: the loop must return
        ("moving_count", "i8"),  # number of bodies that the application moves; length of `Channel.moving`
        ("heartbeat", "i8"),  # counter that the application increments every 2 ms while it runs
        ("stop_force", "i8"),  # 1: the force falls to zero and stays there; the servo resets it at `start` and `resume`
        # fields written by the servo
        ("pace", "i8"),  # FREE, TIMED, CALLED or SCHEDULED
        ("until", "i8"),  # the driver returns when this many ticks are complete
        ("done", "i8"),  # number of complete ticks
        ("done_ns", "i8"),  # time at which the newest was complete, by the clock of the loop
        ("missed", "i8"),  # deadline misses: ticks that were skipped
        ("waiting", "i8"),  # 0, or one of the following
        ("changed", "i8"),  # first tick after the last order that changed the scene or its parameters
        ("checkpoint_due", "i8"),  # tick at which the next checkpoint is written
        ("checkpoint_count", "i8"),  # number of checkpoints so far
        ("checkpoint_size", "i8"),  # size of a checkpoint [bytes]
        ("late", "i8", (BIN_COUNT,)),  # histogram of the delay of ticks
        ("busy", "i8", (BIN_COUNT,)),  # histogram of the duration of ticks
    ],
    align=True,
)
"""State of a loop. That of a servo is in memory shared with the application."""

BLOCKING, ENDED = 1, 2
"""Values of `CHANNEL.waiting`: code outside of the tick, which may block, reads, writes or stops a device; no tick is
expected, because the devices have received a force of zero."""

AIM: Final = np.dtype(
    [
        ("count", "i8"),  # odd while the target is being written (sequence lock)
        ("aim", "f8", (3, 3)),  # position in W [m]; grip: k_N_m, b_Ns_m, mass_kg; push in W [N]
    ]
)
"""Target of the hand on a tool, written by the application."""

FOLLOW_RAD_S: Final = 60.0
"""Bandwidth of the critically damped filter from the target to the hand [rad/s]. A mouse moves in steps at 60 Hz, a
hand does not. The delay of 17 ms is half the noticeable delay between vision and touch (45 ms, Adelstein et al.
2003)."""


class Bodies(NamedTuple):
    """The moving bodies of the scene: b bodies, t tools."""

    frames: Records  # (b,) FRAME, written by the application
    predicted: Records  # (b,) PREDICTED
    moving: NDArray[np.int64]  # (b,) indices of the bodies that move, as many as `CHANNEL.moving_count`
    given: NDArray[np.float64]  # (b, 6) impulse of all tools on each body
    X_WB: NDArray[np.float64]  # (1, b, 4, 4) poses, or (n, b, 4, 4) for each tick
    teleported: NDArray[np.int64]  # (b,) 1 for bodies that teleport
    jumps: NDArray[np.int64]  # (t, b) the same, until each tool has processed it


class Loop(NamedTuple):
    """Everything that a tick of t tools acts on."""

    worlds: "tuple[World, ...]"  # (t,)
    surfaces: "tuple[Surface, ...]"  # (t,)
    tools: tuple[Tool, ...]  # (t,)
    bodies: Bodies
    timer: Timer  # with the channel
    reference: tuple[NDArray[np.float64], ...]  # target [m], grip and push [N], (n, 3) each; if the pace is FREE
    aims: Records  # (t,) AIM; otherwise
    hands: NDArray[np.float64]  # (t, 5, 3) target, filtered target, its velocity, grip and push of each tool
    rows: Records  # (t, length) ROW
    loop_rows: Records  # (t, length) LOOP_ROW
    a_m_s2: NDArray[np.float64]  # (t, length, block) desired acceleration
    a_handle_m_s2: NDArray[np.float64]  # (t, length, block) of the handle
    memory: tuple[NDArray[np.uint8], ...]  # state of the ticks of all tools
    checkpoints: NDArray[np.uint8]  # (CHECKPOINT_COUNT, room) bytes
    checkpoint_ticks: NDArray[np.int64]  # (CHECKPOINT_COUNT,)
    drivers: NDArray[np.uintp]  # (d, 4) read function and its argument, write function and its argument; if TIMED


def new_loop(
    renderers: "list[Renderer]", tools: list[Tool], channel: Record, clock: NDArray[np.int64], **parts: Any
) -> Loop:
    """Make a loop of renderers and their tools; `parts` are further fields, empty if omitted."""
    tick_ns = round(float(renderers[0].surface.touch[0].tick_s) * 1e9)
    empty = np.zeros((0, 3))
    fields = {
        "reference": (empty, empty, empty),
        "aims": records(0, AIM),
        "hands": np.zeros((0, 5, 3)),
        "checkpoints": np.zeros((0, 0), np.uint8),
        "checkpoint_ticks": np.zeros(0, np.int64),
        "drivers": np.zeros((0, 4), np.uintp),
        "timer": Timer(channel, clock, parts.pop("timing", records(1, TIMING)[0]), tick_ns),
    }
    return Loop(
        worlds=tuple(renderer.world for renderer in renderers),
        surfaces=tuple(renderer.surface for renderer in renderers),
        tools=tuple(tools),
        memory=tuple(part for renderer in renderers for part in memory_of(renderer.world, renderer.surface)),
        **(fields | parts),
    )


def static_bodies(moving: NDArray[np.int64], X_WB: NDArray[np.float64], teleported: NDArray[np.int64]) -> Bodies:
    """Return bodies `moving` (m,) of one tool with known poses (n, m, 4, 4), so that nothing is predicted."""
    none = np.zeros((0, 6))
    return Bodies(records(0, FRAME), records(0, PREDICTED), moving, none, X_WB, teleported, teleported.reshape(1, -1))


class Exchange(NamedTuple):
    """Argument of `remove_stale_force`."""

    channel: Record  # CHANNEL
    state: Record  # DEVICE_STATE
    clock: NDArray[np.int64]


@native
def remove_stale_force(given: Exchange) -> None:
    """Remove the force of a device if the loop has stopped; a vendor's thread calls this between reading and
    writing."""
    channel, state = given.channel, given.state
    if channel.pause == 1 or now_ns(given.clock) - channel.done_ns > STALL_S * 1e9:
        state.f_D_N[0] = state.f_D_N[1] = state.f_D_N[2] = 0.0


@inlined
def _drive_at(given: tuple[int, Loop]) -> None:
    """Call `drive` through its address: inlined, with a thousand values loaded at once, ticks are 5 % slower."""
    call_flags(given[0], (given[1],))


def bound(loop: Loop) -> BoundCall:
    """Return the driver of a loop as a C function without arguments."""
    return BoundCall(_drive_at, (address_of(drive, loop), loop))


@native
def drive(loop: Loop) -> int:
    """Run ticks until `channel.pause` is set or `channel.until` are complete; just one if the caller keeps time."""
    channel, drivers = loop.timer.channel, loop.drivers
    once = channel.pace >= CALLED
    while once or (channel.pause == 0 and channel.done < channel.until):
        if channel.pace == TIMED:
            wait_for_tick(loop.timer)
            for k in range(len(drivers)):
                _call(drivers[k, 0], (drivers[k, 1],))
        elif channel.pace == SCHEDULED:
            _note_start(loop.timer)
        _tick_tools(loop)
        if once:
            break
        for k in range(len(drivers)):
            _call(drivers[k, 2], (drivers[k, 3],))
    return 0


_call = c_caller(types.void, types.uintp)


@native
def _note_start(timer: Timer) -> None:
    """Start a tick that a thread of the vendor's library called; its delay counts from the tick before."""
    channel, timing, tick_ns = timer.channel, timer.timing, timer.tick_ns
    start = now_ns(timer.clock)
    late = max(start - timing.began_ns - tick_ns, 0)
    timing.elapsed_ns = start - timing.began_ns
    timing.due_ns = timing.began_ns = start
    timing.late, timing.stalled = 0, int(late > STALL_S * 1e9)
    channel.missed += late // tick_ns
    count_in_bin(channel.late, late)


@inlined
def _tick_tools(loop: Loop) -> None:
    """Run one tick of all tools, one after the other."""
    worlds, surfaces, tools, bodies, channel = loop.worlds, loop.surfaces, loop.tools, loop.bodies, loop.timer.channel
    rows, a_m_s2, loop_rows, a_handle_m_s2 = loop.rows, loop.a_m_s2, loop.loop_rows, loop.a_handle_m_s2
    clock, timing, hands = loop.timer.clock, loop.timer.timing, loop.hands
    tick_s, count, now = surfaces[0].touch[0].tick_s, channel.moving_count, channel.done
    real_time = channel.pace != FREE
    if real_time:
        write_checkpoint(channel, loop.memory, loop.checkpoints, loop.checkpoint_ticks, rows.shape[1])
        _predict(worlds, bodies, count, timing.began_ns, clock, tick_s)
    slot = now if now < rows.shape[1] else now % rows.shape[1]  # avoids a slow division
    pose = now if bodies.X_WB.shape[0] > 1 else 0
    for t in range(len(worlds)):
        world, surface, tool = worlds[t], surfaces[t], tools[t]
        if real_time:
            safety = tool.safety[0]
            safety.heartbeat_now, safety.late, safety.stalled = channel.heartbeat, timing.late, timing.stalled
            safety.elapsed_s, safety.stopped = 1e-9 * timing.elapsed_ns, channel.stop_force
            _read_aim(loop.aims[t], hands[t], clock)
            _follow(tool, hands[t], tick_s)
        else:
            _set_reference(tool, loop.reference[0], loop.reference[1], loop.reference[2], now, tick_s)
        if tool.arm.kind == CONNECTED:
            _note_buttons(tool.arm.state[0], now, timing.began_ns)
        moved = (bodies.moving, bodies.X_WB, bodies.jumps[t], count, pose)
        notes = (rows[t, slot], a_m_s2[t, slot], loop_rows[t, slot], a_handle_m_s2[t, slot])
        tick_tool(world, surface, tool, moved, notes)
    if real_time:  # the compiler cannot move code across the call of the clock
        end = now_ns(clock)
        count_in_bin(channel.busy, end - timing.began_ns)
        channel.done_ns = end
    channel.done += 1


@native
def _note_buttons(state: Record, tick: int, now: int) -> None:
    """Log a change of the buttons; the count is written last, because the application reads both."""
    count, log = state.button_count, state.button_log
    if state.buttons != (log[(count - 1) % BUTTON_ROOM, 2] if count > 0 else 0):
        at = count % BUTTON_ROOM
        log[at, 0], log[at, 1], log[at, 2] = tick, now, state.buttons
        state.button_count = count + 1


@inlined
def _set_reference(
    tool: Tool,
    target: NDArray[np.float64],
    grip: NDArray[np.float64],
    push: NDArray[np.float64],
    k: int,
    tick_s: float,
) -> None:
    """Set the target, grip and push of tick `k` of a reference trajectory; the target moves linearly to the next."""
    hand = tool.arm.hand[0]
    after = min(k + 1, len(target) - 1)
    take_grip(tool, grip[k, 0], grip[k, 1], grip[k, 2])
    for i in range(3):
        hand.target_m[i] = target[k, i]
        hand.target_m_s[i] = (target[after, i] - target[k, i]) / tick_s
        hand.push_N[i] = push[k, i]


@native
def _predict(
    worlds: "tuple[World, ...]", bodies: Bodies, count: int, now: int, clock: NDArray[np.int64], tick_s: float
) -> None:
    """Predict the poses of the bodies that the application moves, under the impulses of all tools."""
    for m in range(count):
        index = bodies.moving[m]
        for i in range(6):
            total = 0.0
            for t in range(len(worlds)):
                total += worlds[t].impulse[index, i]
            bodies.given[index, i] = total
    frames, moving, X_WB, jump = bodies.frames, bodies.moving[:count], bodies.X_WB[:, :count], bodies.teleported[:count]
    predict_bodies(frames, bodies.predicted, moving, bodies.given, X_WB, jump, now, clock, tick_s)
    for m in range(count):
        for t in range(len(worlds)):
            bodies.jumps[t, m] |= jump[m]
        jump[m] = 0


@inlined
def _read_aim(shared: Record, hand: NDArray[np.float64], clock: NDArray[np.int64]) -> None:
    """Read the target that the application wrote, unless it is being written.

    The two calls of the clock keep the compiler and the processor from moving the reads of the count (sequence lock).
    """
    count = shared.count
    now_ns(clock)
    p, grip, push = shared.aim[0], shared.aim[1], shared.aim[2]
    x, y, z = p[0], p[1], p[2]
    k, b, m = grip[0], grip[1], grip[2]
    u, v, w = push[0], push[1], push[2]
    now_ns(clock)
    if count % 2 == 1 or count != shared.count:
        return
    hand[0, 0], hand[0, 1], hand[0, 2] = x, y, z
    hand[3, 0], hand[3, 1], hand[3, 2] = k, b, m
    hand[4, 0], hand[4, 1], hand[4, 2] = u, v, w


@inlined
def _follow(tool: Tool, aim: NDArray[np.float64], tick_s: float) -> None:
    """Filter the target of the hand: critically damped, exact for a constant target over the tick."""
    take_grip(tool, aim[3, 0], aim[3, 1], aim[3, 2])
    hand = tool.arm.hand[0]
    fade = math.exp(-FOLLOW_RAD_S * tick_s)
    for i in range(3):
        ahead = aim[1, i] - aim[0, i]
        pull = (aim[2, i] + FOLLOW_RAD_S * ahead) * tick_s
        after = aim[0, i] + (ahead + pull) * fade
        aim[2, i] = (aim[2, i] - FOLLOW_RAD_S * pull) * fade
        if abs(ahead) < TINY and abs(aim[2, i]) < TINY:
            after, aim[2, i] = aim[0, i], 0.0
        hand.target_m[i] = aim[1, i]
        hand.target_m_s[i] = (after - aim[1, i]) / tick_s
        hand.push_N[i] = aim[4, i]
        aim[1, i] = after
