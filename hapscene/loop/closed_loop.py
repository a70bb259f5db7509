"""The closed loop, compiled. One tick of it:

    read       the device's encoders                                    device/
    tick       the real one                                             tick.py
    protect    the person, where the device is real                     device/safety.py
    wait       the force goes out `delay` ticks later
    hold       it, until the next tick                                  device/
    move       device, hand and handle, a sample of the channel a time  device/ handle/

The force of a tick is computed from the position read at its start, and held over it (at no delay). What the handle's
actuator moves is added to what the device's own dynamics move: both are linear, and the encoders see the sum.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import inlined, native
from hapscene.device.safety import protect
from hapscene.device.sim.arm import (
    CONNECTED,
    SIMULATED_OMNI,
    advance_arm,
    drive_arm,
    find_tip,
    find_tip_velocity,
    read_arm,
)
from hapscene.device.sim.hand import pull
from hapscene.geometry import Vector
from hapscene.handle.handle_dynamics import grip_handle
from hapscene.handle.handle_loop import vibrate
from hapscene.render.tick import tick_at

__all__ = ["DELAY_MAX", "Tool", "take_grip", "tick_tool"]

DELAY_MAX: Final = 256
"""Longest delay between a tick and its force [ticks]."""


class Tool(NamedTuple):
    """One tool of a closed loop: device and hand, handle, forces on their way, safety."""

    arm: Any  # device and hand
    handle: Any  # (1,) HANDLE
    has_handle: int
    axis_W: NDArray[np.float64]  # (3,) unit vector along the handle
    shift_m: NDArray[np.float64]  # (1,) displacement of the handle by its actuator
    quantum_m: float  # the encoders' step, in which the displacement is seen
    wait_N: NDArray[np.float64]  # (DELAY_MAX, 3) forces on their way
    ticks: NDArray[np.int64]  # (1,) so far
    delay: int
    safety: Any  # (1,) SAFETY


@inlined
def tick_tool(world: Any, surface: Any, tool: Any, moved: Any, notes: Any) -> None:
    """One tick of the closed loop, the hand's intent being set.

    `moved` are the bodies' indices, poses and jumps, their count and the row of the poses, as `tick_at` has them;
    `notes` are a ROW, the desired samples (block,), a FELT and the handle's samples (block,), which are filled.
    """
    row, a_m_s2, felt, a_handle_m_s2 = notes
    touch, arm = surface.touch[0], tool.arm
    x, y, z = _read(tool)
    felt.read_W_m[0], felt.read_W_m[1], felt.read_W_m[2] = x, y, z
    tick_at(world, surface, moved, (x, y, z), row, a_m_s2)
    _send(tool, _protect(tool, row, touch), felt)
    _note(arm, felt)
    for i in range(touch.block):
        a_handle_m_s2[i] = _shake(tool, a_m_s2[i], felt)
    advance_arm(arm, touch.tick_s / touch.block, touch.block)
    _close(tool, felt)


@inlined
def _read(tool: Any) -> Vector:
    """The tool as the encoders have it, in W [m]: the arm's tip, moved by the handle's actuator."""
    x, y, z = read_arm(tool.arm)
    shift, axis = tool.shift_m[0], tool.axis_W
    if tool.quantum_m > 0.0:
        shift = tool.quantum_m * math.floor(shift / tool.quantum_m + 0.5)
    return x + shift * axis[0], y + shift * axis[1], z + shift * axis[2]


@inlined
def _protect(tool: Any, row: Any, touch: Any) -> Vector:
    """The force that may go out, in W [N]."""
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
def _shake(tool: Any, desired_m_s2: float, felt: Any) -> float:
    """One sample of the handle. Without one the acceleration is as desired, and moves nothing."""
    if tool.has_handle == 0:
        return desired_m_s2
    acceleration, shift, force = vibrate(tool.handle[0], desired_m_s2)
    tool.shift_m[0] = shift
    felt.f_coil_N = max(felt.f_coil_N, abs(force))
    return acceleration


@native
def take_grip(tool: Any, k_N_m: float, b_Ns_m: float, mass_kg: float) -> None:
    """Hold the tool, and the handle on it, as firmly as that from now on."""
    hand = tool.arm.hand[0]
    if tool.has_handle == 1 and (tool.ticks[0] == 0 or hand.k_N_m != k_N_m or hand.b_Ns_m != b_Ns_m):
        grip_handle(tool.handle[0], k_N_m, b_Ns_m)
    hand.k_N_m, hand.b_Ns_m, hand.mass_kg = k_N_m, b_Ns_m, mass_kg


@inlined
def _send(tool: Any, f_N: Vector, felt: Any) -> None:
    """Put a force on its way; hold the one that arrives."""
    k = tool.ticks[0]
    enter, leave = k % DELAY_MAX, (k - tool.delay) % DELAY_MAX
    for i in range(3):
        tool.wait_N[enter, i] = f_N[i]
    for i in range(3):
        felt.f_motor_W_N[i] = tool.wait_N[leave, i] if k >= tool.delay else 0.0
    drive_arm(tool.arm, (felt.f_motor_W_N[0], felt.f_motor_W_N[1], felt.f_motor_W_N[2]))
    tool.ticks[0] = k + 1


@inlined
def _note(arm: Any, felt: Any) -> None:
    """The tick's start as it truly is."""
    p, v = find_tip(arm), find_tip_velocity(arm)
    for i in range(3):
        felt.p_W_m[i], felt.v_W_m_s[i] = p[i], v[i]
        felt.f_hand_W_N[i] = pull(arm.hand[0], i, p[i], v[i])


@inlined
def _close(tool: Any, felt: Any) -> None:
    """Work at the tip: exact for a point mass, whose motors' force is held."""
    arm = tool.arm
    p = find_tip(arm)
    work = 0.0
    for i in range(3):
        work += felt.f_motor_W_N[i] * (p[i] - felt.p_W_m[i])
    felt.work_J = work
    if arm.kind == CONNECTED:
        felt.trouble, felt.heat = arm.state[0].trouble, tool.safety[0].heat
    if arm.kind == SIMULATED_OMNI:
        felt.trouble = arm.omni[0].trouble
        felt.heat = max(arm.omni[0].heat[0], arm.omni[0].heat[1], arm.omni[0].heat[2])
