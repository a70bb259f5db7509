"""One tick of the leader, a device with a haptography handle in a hand, and of the follower, a device at a surface.

The base motors couple the leader to the follower. As in the experiment of the haptography paper, the acceleration
that the follower's accelerometer reads is the desired acceleration of the leader's handle, whose compensator
converts it to a force. The hand holds the handle and the encoders measure it, so that its motion also reaches the
follower.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.entry import call_flags
from hapscene.compiled.native import native
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.contact.world import World
from hapscene.device.sim.arm import Arm, advance_arm, drive_arm, find_tip, new_arm, read_arm
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.geometry import Vector
from hapscene.handle.handle_dynamics import grip_handle
from hapscene.handle.handle_loop import vibrate
from hapscene.records import ROW, Record, Records, records
from hapscene.surface.surface_arrays import TICK, Surface
from hapscene.teleoperation.endpoint import Coupling, Endpoint, control, fill_message, new_endpoint, set_start
from hapscene.teleoperation.jitter_buffer import MESSAGE, SAMPLE_COUNT, play_samples

if TYPE_CHECKING:
    from hapscene.render.renderer import Renderer

Array = NDArray[np.float64]
Hand = tuple[Array, Array, Array]
"""Target, grip and push of the hand of the leader, one row per tick, as in `ReferenceTrajectory`."""

__all__ = ["Follower", "Hand", "Leader", "new_follower", "new_leader", "step_follower", "step_leader"]


# The tool at the tip of a device: direction of the handle, acceleration along it, displacement by vibration.


VIBRATION_CORNER_HZ: Final = 10.0
"""Corner of the leaky double integration of vibrations [Hz], which prevents drift: half of the lowest frequency of the
acceleration channel."""

ACCELEROMETER_CORNER_HZ: Final = 12.0
"""Corner of the high-pass behind the accelerometer, Butterworth of second order [Hz]. It removes gravity and hand
motion, for which the handle has no travel; it attenuates 20 Hz by 6 %."""

HANDLE_CORNER_HZ: Final = 30.0
"""Corner of the same high-pass before the handle [Hz]. Below it, the base motors already move the tip as the follower
moves, a few ms before the handle could, and the coil travel is kept for taps. On wood in three grips, corners of 20 to
45 Hz differ little."""

TOOL: Final = np.dtype(
    [
        ("axis_W", "f8", (3,)),  # unit vector along the handle
        ("before_m", "f8"),  # position of the tip along it, one sample ago
        ("before_m_s", "f8"),  # and its velocity
        ("vibration_m", "f8"),  # displacement by vibration
        ("vibration_m_s", "f8"),
        ("slow", "f8", (2,)),  # state of the high-pass
    ],
    align=True,
)
"""State of a tool from sample to sample."""


def new_tool(p_W_m: ArrayLike, axis_W: ArrayLike = (0.0, 0.0, 1.0)) -> Records:
    """Return a tool (1,) TOOL at rest at `p_W_m` (3,), with the handle along `axis_W` (3,), by default upright."""
    tool: Records = records(1, TOOL)
    tool.axis_W = np.asarray(axis_W, np.float64) / np.linalg.norm(axis_W)
    tool.before_m = tool.axis_W[0] @ np.asarray(p_W_m)
    return tool


@native
def tip_acceleration(tool: Record, p_W_m: Vector, h_s: float) -> float:
    """Acceleration of the tip along the handle, as the second difference of its positions; the newest is `p_W_m`
    [m/s²]."""
    n = tool.axis_W
    x = n[0] * p_W_m[0] + n[1] * p_W_m[1] + n[2] * p_W_m[2]
    v = (x - tool.before_m) / h_s
    a = (v - tool.before_m_s) / h_s
    tool.before_m, tool.before_m_s = x, v
    return float(a)


@native
def high_pass(tool: Record, a_m_s2: float, h_s: float, corner_Hz: float = ACCELEROMETER_CORNER_HZ) -> float:
    """Filter a sample of acceleration by a high-pass of second order [m/s²].

    Trapezoidal state-variable filter (Zavalishin 2012, "The Art of VA Filter Design", 4.4), exact at its corner.
    """
    g = math.tan(math.pi * corner_Hz * h_s)
    slow, damping = tool.slow, math.sqrt(2.0)
    high = (a_m_s2 - (damping + g) * slow[0] - slow[1]) / (1.0 + g * (damping + g))
    band = g * high + slow[0]
    low = g * band + slow[1]
    slow[0], slow[1] = g * high + band, g * band + low
    return float(high)


@native
def move_by_vibration(tool: Record, a_m_s2: float, h_s: float) -> None:
    """Integrate a sample of vibration [m/s²] to a displacement of the tool."""
    leak = 2.0 * math.pi * VIBRATION_CORNER_HZ * h_s
    tool.vibration_m_s += a_m_s2 * h_s - leak * tool.vibration_m_s
    tool.vibration_m += tool.vibration_m_s * h_s - leak * tool.vibration_m


# The leader.


class Leader(NamedTuple):
    """State of the leader."""

    arm: Arm
    end: Endpoint
    tool: Records  # (1,) TOOL
    handle: Records  # (1,) HANDLE, which plays the accelerometer signal of the follower
    wanted_m_s2: Array  # (SAMPLE_COUNT,) desired acceleration of the handle in this tick
    tip_m_s2: Array  # (SAMPLE_COUNT,) acceleration of the tip along the handle, by base motors and hand
    handle_m_s2: Array  # (SAMPLE_COUNT,) acceleration of the handle relative to it, by the voice coil
    outgoing: Records  # (1,) MESSAGE to the follower


def new_leader(device: PointMass | Omni, handle: Records, coupling: Coupling, p_WT_m: Sequence[float]) -> Leader:
    """Return a leader at rest at `p_WT_m` (3,)."""
    arm = new_arm(device, p_WT_m)
    end = new_endpoint(coupling, "leader", TICK_S)
    set_start(end, *read_arm(arm))
    return Leader(
        arm=arm,
        end=end,
        tool=new_tool(find_tip(arm)),
        handle=handle,
        wanted_m_s2=np.zeros(SAMPLE_COUNT),
        tip_m_s2=np.zeros(SAMPLE_COUNT),
        handle_m_s2=np.zeros(SAMPLE_COUNT),
        outgoing=records(1, MESSAGE),
    )


@native
def step_leader(leader: Leader, trajectory: Hand, row: int, now: int) -> Vector:
    """Run tick `now` of the leader, whose hand is at row `row` of its reference trajectory (target, grip, push).

    Returns the force of the base motors [N]; the message to the follower is in `leader.outgoing`.
    """
    set_hand(leader, trajectory[0], trajectory[1], trajectory[2], row)
    x, y, z = read_arm(leader.arm)
    tool, handle = leader.tool[0], leader.handle[0]
    n, shift = tool.axis_W, tool.vibration_m
    force = control(leader.end, now, x + shift * n[0], y + shift * n[1], z + shift * n[2])
    fill_message(leader.end, now, leader.outgoing)
    drive_arm(leader.arm, force)
    play_samples(leader.end.queue[0], leader.wanted_m_s2)
    h_s = 1.0 / ACCELERATION_RATE_HZ
    for i in range(SAMPLE_COUNT):
        advance_arm(leader.arm, h_s)
        leader.tip_m_s2[i] = tip_acceleration(tool, find_tip(leader.arm), h_s)
        wanted = high_pass(tool, leader.wanted_m_s2[i], h_s, HANDLE_CORNER_HZ)
        leader.handle_m_s2[i], tool.vibration_m, _ = vibrate(handle, wanted)
    return force


@native
def set_hand(leader: Leader, target_W_m: Array, grip: Array, push_W_N: Array, row: int) -> None:
    """Set target, grip and push of the hand to a row of the trajectory; the target moves linearly to the next row."""
    hand = leader.arm.hand[0]
    after = min(row + 1, len(target_W_m) - 1)
    if hand.k_N_m != grip[row, 0] or hand.b_Ns_m != grip[row, 1]:
        grip_handle(leader.handle[0], grip[row, 0], grip[row, 1])
    hand.k_N_m, hand.b_Ns_m, hand.mass_kg = grip[row, 0], grip[row, 1], grip[row, 2]
    for i in range(3):
        hand.target_m[i] = target_W_m[row, i]
        hand.target_m_s[i] = (target_W_m[after, i] - target_W_m[row, i]) / TICK_S
        hand.push_N[i] = push_W_N[row, i]


# The follower: a device with an accelerometer at its tool, which touches the scene for the leader.
#
# The surface is here the physical world, not a haptic rendering. Therefore the haptic tick runs at the sample rate of
# the accelerometer, from the exact position of the tool, and its force acts on the tool. The accelerometer reads the
# acceleration of the tip along the handle, and in addition the vibration of sliding and the transients of taps, which
# the recordings of the swatch contain. The vibration also moves the tool; the position controller sees this motion
# without encoder quantisation: at 100 Hz, 1 m/s² is 2.5 µm, a twentieth of an encoder step of the Omni.


class Follower(NamedTuple):
    """State of the follower."""

    arm: Arm
    end: Endpoint
    world: World
    surface: Surface  # its tick lasts one sample of the accelerometer
    row: Records  # (1,) ROW of the last tick
    sample: Array  # (1,)
    tool: Records  # (1,) TOOL
    read_m_s2: Array  # (SAMPLE_COUNT,) accelerometer samples of the last tick
    outgoing: Records  # (1,) MESSAGE to the leader


def new_follower(
    renderer: "Renderer", device: PointMass | Omni, coupling: Coupling, p_WT_m: Sequence[float]
) -> Follower:
    """Return a follower at rest at `p_WT_m` (3,).

    The tick of the renderer must last one sample at 10 kHz, and the renderer must live as long as the follower.
    """
    renderer.reset(p_WT_m)
    arm = new_arm(device, p_WT_m)
    end = new_endpoint(coupling, "follower", TICK_S)
    set_start(end, *read_arm(arm))
    return Follower(
        arm=arm,
        end=end,
        world=renderer.world,
        surface=renderer.surface,
        row=records(1, ROW),
        sample=np.zeros(1),
        tool=new_tool(find_tip(arm)),
        read_m_s2=np.zeros(SAMPLE_COUNT),
        outgoing=records(1, MESSAGE),
    )


@native
def step_follower(follower: Follower, now: int) -> Vector:
    """Run tick `now` of the follower; return the motor force [N]. The message to the leader is in `outgoing`."""
    outgoing, tool, hand = follower.outgoing, follower.tool[0], follower.arm.hand[0]
    x, y, z = read_arm(follower.arm)
    n, shift = tool.axis_W, tool.vibration_m
    force = control(follower.end, now, x + shift * n[0], y + shift * n[1], z + shift * n[2])
    fill_message(follower.end, now, outgoing)
    drive_arm(follower.arm, force)
    row = follower.row[0]
    for i in range(SAMPLE_COUNT):
        outgoing[0].a_m_s2[i] = follower.read_m_s2[i]
    h_s = 1.0 / ACCELERATION_RATE_HZ
    for i in range(SAMPLE_COUNT):
        p = find_tip(follower.arm)
        tick = follower.surface.entries[TICK]
        call_flags(tick, (follower.world, follower.surface, p[0], p[1], p[2], row, follower.sample))
        for j in range(3):
            hand.push_N[j] = row.f_W_N[j]
        advance_arm(follower.arm, h_s)
        vibration = follower.sample[0]
        move_by_vibration(tool, vibration, h_s)
        moved = tip_acceleration(tool, find_tip(follower.arm), h_s)
        follower.read_m_s2[i] = high_pass(tool, moved + vibration, h_s)
    return force
