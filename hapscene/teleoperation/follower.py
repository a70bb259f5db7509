"""The follower: a device that touches the scene for the leader, with an accelerometer at its tool.

The surface is no haptic rendering here but the world that the tool touches, so it is computed finely: the real tick at
the rate of the accelerometer, from the tool's true position, its force acting on the tool from outside.
What the accelerometer reads is the tip's own acceleration along the handle, and on it the vibration of sliding and the
transients of taps, which is what the swatch's recordings held. The vibration also moves the tool, which the base
motors' controller is let see as if encoders had no steps: at 100 Hz, 1 m/s² are 2.5 µm, a twentieth of an Omni's.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.contact.geometry import Vector
from hapscene.contact.world import records
from hapscene.device.arm import Arm, advance_arm, drive_arm, find_tip, new_arm, read_arm
from hapscene.native import native
from hapscene.records import ROW
from hapscene.teleoperation.coupling import Coupling
from hapscene.teleoperation.message import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.port import End, control, new_end, place, tell
from hapscene.teleoperation.tool import accelerate, couple, new_tool, shake
from hapscene.tick import tick

if TYPE_CHECKING:
    from hapscene.renderer import Renderer


class Follower(NamedTuple):
    """All that the follower's tick reads and writes."""

    arm: Arm
    end: End
    world: Any
    surface: Any  # its tick lasts one sample of the accelerometer
    row: Any  # (1,) ROW of the last tick
    sample: NDArray[np.float64]  # (1,)
    tool: Any  # (1,) TOOL
    read_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) what the accelerometer read in the last tick
    told: Any  # (1,) MESSAGE to the leader


def new_follower(renderer: "Renderer", device: Any, coupling: Coupling, p_WT_m: Any, axis_W: Any) -> Follower:
    """A follower at rest at `p_WT_m` (3,). The renderer's tick must last one sample at 10 kHz; it must live as long."""
    renderer.reset(p_WT_m)
    arm = new_arm(device, p_WT_m)
    end = new_end(coupling, "follower", TICK_S)
    place(end, *read_arm(arm))
    return Follower(
        arm=arm,
        end=end,
        world=renderer.world,
        surface=renderer.surface,
        row=records(1, ROW),
        sample=np.zeros(1),
        tool=new_tool(find_tip(arm), axis_W),
        read_m_s2=np.zeros(SAMPLE_COUNT),
        told=records(1, MESSAGE),
    )


@native
def follow(follower: Any, k: int) -> Vector:
    """Tick `k` of the follower, whose message then waits in `told`; the force of its motors [N]."""
    told, tool, hand = follower.told, follower.tool[0], follower.arm.hand[0]
    x, y, z = read_arm(follower.arm)
    n, shift = tool.axis_W, tool.shake_m
    force = control(follower.end, k, x + shift * n[0], y + shift * n[1], z + shift * n[2])
    tell(follower.end, k, told)
    drive_arm(follower.arm, force)
    row = follower.row[0]
    for i in range(SAMPLE_COUNT):
        told[0].a_m_s2[i] = follower.read_m_s2[i]
    h_s = 1.0 / ACCELERATION_RATE_HZ
    for i in range(SAMPLE_COUNT):
        p = find_tip(follower.arm)
        tick(follower.world, follower.surface, p[0], p[1], p[2], row, follower.sample)
        for j in range(3):
            hand.push_N[j] = row.f_W_N[j]
        advance_arm(follower.arm, h_s)
        vibration = follower.sample[0]
        shake(tool, vibration, h_s)
        moved = accelerate(tool, find_tip(follower.arm), h_s)
        follower.read_m_s2[i] = couple(tool, moved + vibration, h_s)
    return force
