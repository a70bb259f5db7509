"""One tick of the closed loop of device, haptic tick and handle, compiled.

    read       position from the encoders of the device                 device/
    tick       the haptic tick                                          render/tick.py
    protect    limits and safety stops of a real device                 device/safety.py
    delay      the force takes effect `delay` ticks later
    hold       the motors hold the force until the next tick            device/
    advance    device, hand and handle, one acceleration sample a step  device/, handle/

The force of a tick is computed from the position at the start of the tick and is held until the next one (zero-order
hold) if the delay is 0. The displacement by the actuator of the handle is added to that by the dynamics of the device:
both are linear, and the encoders measure the sum.
"""

import math
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import inlined, native
from hapscene.device.safety import protect
from hapscene.device.sim.arm import (
    CONNECTED,
    SIMULATED_OMNI,
    Arm,
    advance_arm,
    drive_arm,
    find_tip,
    find_tip_velocity,
    read_arm,
    write_orientation,
)
from hapscene.device.sim.hand import pull
from hapscene.geometry import Vector
from hapscene.handle.handle_dynamics import grip_handle
from hapscene.handle.handle_loop import vibrate
from hapscene.records import Record, Records
from hapscene.render.tick import Moved, tick_at

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["DELAY_MAX", "Tool", "take_grip", "tick_tool"]

DELAY_MAX: Final = 256
"""Longest delay between a tick and its force [ticks]."""

Notes: TypeAlias = tuple[Record, NDArray[np.float64], Record, NDArray[np.float64]]
"""Records that a tick fills: see `tick_tool`."""


class Tool(NamedTuple):
    """One tool of a closed loop: device, hand, handle, delayed forces and safety."""

    arm: Arm  # device and hand
    handle: Records  # (1,) HANDLE
    has_handle: int  # 1 with a handle
    axis_W: NDArray[np.float64]  # (3,) unit vector along the handle
    shift_m: NDArray[np.float64]  # (1,) displacement of the handle by its actuator
    quantum_m: float  # resolution with which the encoders measure that displacement
    wait_N: NDArray[np.float64]  # (DELAY_MAX, 3) ring buffer of delayed forces
    ticks: NDArray[np.int64]  # (1,) ticks so far
    delay: int
    safety: Records  # (1,) SAFETY


@inlined
def tick_tool(world: "World", surface: "Surface", tool: Tool, moved: Moved, notes: Notes) -> None:
    """Compute one tick of the closed loop; the target of the hand is already set.

    Args:
        world, surface: arrays of the renderer.
        tool: device, hand and handle.
        moved: arguments of `place_bodies`: indices, poses, teleports, their number and the row of the poses.
        notes: records to fill: a ROW, its acceleration samples (block,), a LOOP_ROW and the samples of the handle
            (block,).
    """
    row, a_m_s2, loop_row, a_handle_m_s2 = notes
    touch, arm = surface.touch[0], tool.arm
    x, y, z = _read(tool)
    loop_row.read_W_m[0], loop_row.read_W_m[1], loop_row.read_W_m[2] = x, y, z
    if arm.kind == CONNECTED:
        write_orientation(arm, touch.R_WT)
        write_orientation(arm, loop_row.R_WT)
    tick_at(world, surface, moved, (x, y, z), row, a_m_s2)
    _send(tool, _protect(tool, row, touch), loop_row)
    _note(arm, loop_row)
    for i in range(touch.block):
        a_handle_m_s2[i] = _advance_handle(tool, a_m_s2[i], loop_row)
    advance_arm(arm, touch.tick_s / touch.block, touch.block)
    _record_work(tool, loop_row)


@inlined
def _read(tool: Tool) -> Vector:
    """Return the position that the encoders measure, in W [m]: tip of the arm plus displacement of the handle."""
    x, y, z = read_arm(tool.arm)
    shift, axis = tool.shift_m[0], tool.axis_W
    if tool.quantum_m > 0.0:
        shift = tool.quantum_m * math.floor(shift / tool.quantum_m + 0.5)
    return x + shift * axis[0], y + shift * axis[1], z + shift * axis[2]


@inlined
def _protect(tool: Tool, row: Record, touch: Record) -> Vector:
    """Return the force that may be sent to the device, in W [N]."""
    f, safety, arm = row.f_W_N, tool.safety[0], tool.arm
    if safety.on == 0:
        return f[0], f[1], f[2]
    if arm.kind == CONNECTED:
        p, state = arm.state[0].p_DT_m, arm.state[0]
        sent, flags = protect(safety, (p[0], p[1], p[2]), state.ready, state.count, f, touch.tick_s)
    else:
        sent, flags = protect(safety, (0.0, 0.0, 0.0), 1, touch.tick, f, touch.tick_s)
    row.flags |= flags
    return sent


@inlined
def _advance_handle(tool: Tool, desired_m_s2: float, loop_row: Record) -> float:
    """Compute one sample of the handle. Without a handle, the acceleration is as desired and nothing moves."""
    if tool.has_handle == 0:
        return desired_m_s2
    acceleration, shift, force = vibrate(tool.handle[0], desired_m_s2)
    tool.shift_m[0] = shift
    loop_row.f_coil_N = max(loop_row.f_coil_N, abs(force))
    return acceleration


@native
def take_grip(tool: Tool, k_N_m: float, b_Ns_m: float, mass_kg: float) -> None:
    """Change the grip on the tool and on the handle from now on."""
    hand = tool.arm.hand[0]
    if tool.has_handle == 1 and (tool.ticks[0] == 0 or hand.k_N_m != k_N_m or hand.b_Ns_m != b_Ns_m):
        grip_handle(tool.handle[0], k_N_m, b_Ns_m)
    hand.k_N_m, hand.b_Ns_m, hand.mass_kg = k_N_m, b_Ns_m, mass_kg


@inlined
def _send(tool: Tool, f_N: Vector, loop_row: Record) -> None:
    """Put a force into the delay line, and send the one that leaves it to the device."""
    k = tool.ticks[0]
    enter, leave = k % DELAY_MAX, (k - tool.delay) % DELAY_MAX
    for i in range(3):
        tool.wait_N[enter, i] = f_N[i]
    for i in range(3):
        loop_row.f_motor_W_N[i] = tool.wait_N[leave, i] if k >= tool.delay else 0.0
    drive_arm(tool.arm, (loop_row.f_motor_W_N[0], loop_row.f_motor_W_N[1], loop_row.f_motor_W_N[2]))
    tool.ticks[0] = k + 1


@inlined
def _note(arm: Arm, loop_row: Record) -> None:
    """Record the true state at the start of the tick."""
    p, v = find_tip(arm), find_tip_velocity(arm)
    for i in range(3):
        loop_row.p_W_m[i], loop_row.v_W_m_s[i] = p[i], v[i]
        loop_row.f_hand_W_N[i] = pull(arm.hand[0], i, p[i], v[i])


@inlined
def _record_work(tool: Tool, loop_row: Record) -> None:
    """Record the work of the motors at the tip. Exact for a point mass: the motor force is constant over the tick."""
    arm = tool.arm
    p = find_tip(arm)
    work = 0.0
    for i in range(3):
        work += loop_row.f_motor_W_N[i] * (p[i] - loop_row.p_W_m[i])
    loop_row.work_J = work
    if arm.kind == CONNECTED:
        loop_row.trouble, loop_row.heat = arm.state[0].trouble, tool.safety[0].heat
    if arm.kind == SIMULATED_OMNI:
        loop_row.trouble = arm.omni[0].trouble
        loop_row.heat = max(arm.omni[0].heat[0], arm.omni[0].heat[1], arm.omni[0].heat[2])
