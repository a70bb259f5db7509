"""The leader: the device in the hand, whose base motors tie it to the follower, and in it the haptography handle.

As in the haptography paper's experiment, what the follower's accelerometer reads is the acceleration that the handle is
asked for; its compensator makes a force of it. The handle is what the hand holds and what the encoders see, so what it
does goes back to the follower.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.contact.geometry import Vector
from hapscene.contact.world import records
from hapscene.device.arm import Arm, advance_arm, drive_arm, find_tip, new_arm, read_arm
from hapscene.handle.loop import vibrate
from hapscene.handle.motion import grip_handle
from hapscene.native import native
from hapscene.teleoperation.coupling import Coupling
from hapscene.teleoperation.message import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.port import End, control, new_end, place, tell
from hapscene.teleoperation.queue import play
from hapscene.teleoperation.tool import accelerate, new_tool


class Leader(NamedTuple):
    """All that the leader's tick reads and writes."""

    arm: Arm
    end: End
    tool: Any  # (1,) TOOL
    handle: Any  # (1,) HANDLE that plays what the follower's accelerometer read
    wanted_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) what the handle is asked for in this tick
    tip_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) acceleration of the tip along the handle, by base motors and hand
    handle_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) and of the handle on it, by the voice coil
    told: Any  # (1,) MESSAGE to the follower


def new_leader(device: Any, handle: Any, coupling: Coupling, p_WT_m: Any, axis_W: Any) -> Leader:
    """A leader at rest at `p_WT_m` (3,), its handle along `axis_W` (3,)."""
    arm = new_arm(device, p_WT_m)
    end = new_end(coupling, "leader", TICK_S)
    place(end, *read_arm(arm))
    return Leader(
        arm=arm,
        end=end,
        tool=new_tool(find_tip(arm), axis_W),
        handle=handle,
        wanted_m_s2=np.zeros(SAMPLE_COUNT),
        tip_m_s2=np.zeros(SAMPLE_COUNT),
        handle_m_s2=np.zeros(SAMPLE_COUNT),
        told=records(1, MESSAGE),
    )


@native
def lead(leader: Any, k: int) -> Vector:
    """Tick `k` of the leader, whose message then waits in `told`; the force of its base motors [N]."""
    x, y, z = read_arm(leader.arm)
    tool, handle = leader.tool[0], leader.handle[0]
    n, shift = tool.axis_W, tool.shake_m
    force = control(leader.end, k, x + shift * n[0], y + shift * n[1], z + shift * n[2])
    tell(leader.end, k, leader.told)
    drive_arm(leader.arm, force)
    play(leader.end.queue[0], leader.wanted_m_s2)
    h_s = 1.0 / ACCELERATION_RATE_HZ
    for i in range(SAMPLE_COUNT):
        advance_arm(leader.arm, h_s)
        leader.tip_m_s2[i] = accelerate(tool, find_tip(leader.arm), h_s)
        leader.handle_m_s2[i], tool.shake_m, _ = vibrate(handle, leader.wanted_m_s2[i])
    return force


@native
def intend(leader: Any, target_W_m: Any, grip: Any, push_W_N: Any, k: int) -> None:
    """What the hand means to do in row `k` of an intention: its target moves straight to that of the next."""
    hand = leader.arm.hand[0]
    after = min(k + 1, len(target_W_m) - 1)
    if hand.k_N_m != grip[k, 0] or hand.b_Ns_m != grip[k, 1]:
        grip_handle(leader.handle[0], grip[k, 0], grip[k, 1])
    hand.k_N_m, hand.b_Ns_m, hand.mass_kg = grip[k, 0], grip[k, 1], grip[k, 2]
    for i in range(3):
        hand.target_m[i] = target_W_m[k, i]
        hand.target_m_s[i] = (target_W_m[after, i] - target_W_m[k, i]) / TICK_S
        hand.push_N[i] = push_W_N[k, i]
