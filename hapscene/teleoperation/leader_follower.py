"""A tick of each end: the leader in the hand, with the haptography handle, and the follower at the surface.

The base motors of the leader tie it to the follower. As in the haptography paper's experiment, what the follower's
accelerometer reads is the acceleration that the handle is asked for; its compensator makes a force of it. The handle is
what the hand holds and what the encoders see, so what it does goes back to the follower.
"""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.entry import call_flags
from hapscene.compiled.native import native
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.sim.arm import Arm, advance_arm, drive_arm, find_tip, new_arm, read_arm
from hapscene.geometry import Vector
from hapscene.handle.handle_dynamics import grip_handle
from hapscene.handle.handle_loop import vibrate
from hapscene.records import ROW, records
from hapscene.surface.surface_arrays import TICK
from hapscene.teleoperation.datagram import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.endpoint import Coupling, Endpoint, control, new_endpoint, place, tell
from hapscene.teleoperation.jitter_buffer import play_samples

if TYPE_CHECKING:
    from hapscene.render.renderer import Renderer

__all__ = [
    "COUPLING_HZ",
    "SHAKE_HZ",
    "Follower",
    "Leader",
    "accelerate",
    "couple",
    "follow",
    "intend",
    "lead",
    "new_follower",
    "new_leader",
    "new_tool",
    "shake",
]


# The tool at the tip of a device: its handle's direction, its acceleration along it, and how vibration moves it.


SHAKE_HZ: Final = 10.0
"""Corner below which a vibration's displacement is let go [Hz]: keeps its double integral from drifting. Half of where
the acceleration channel begins."""

COUPLING_HZ: Final = 12.0
"""Corner of the high-pass, Butterworth of second order, through which the accelerometer is heard [Hz]: gravity and the
hand's own motion are none of the handle's, which has no travel for them. 6 % are lost at 20 Hz."""

CROSSOVER_HZ: Final = 30.0
"""Corner of the same high-pass on what the handle is asked for [Hz]: below, the base motors move the tip as the
follower's moves, some ms before the handle could, and both together are too much. It leaves the coil's travel to taps.
Tried on wood in three grips: 20 to 45 Hz do much the same."""

TOOL: Final = np.dtype(
    [
        ("axis_W", "f8", (3,)),  # along the handle, a unit vector
        ("before_m", "f8"),  # along it: the tip a sample ago
        ("before_m_s", "f8"),  # and its velocity
        ("shake_m", "f8"),  # displacement by vibration
        ("shake_m_s", "f8"),
        ("slow", "f8", (2,)),  # state of the high-pass: of the accelerometer, or before the handle
    ],
    align=True,
)
"""What is remembered of a tool from sample to sample."""


def new_tool(p_W_m: Any, axis_W: Any) -> Any:
    """(1,) TOOL at rest at `p_W_m` (3,), with the handle along `axis_W` (3,)."""
    tool = records(1, TOOL)
    tool.axis_W = np.asarray(axis_W, np.float64) / np.linalg.norm(axis_W)
    tool.before_m = tool.axis_W[0] @ np.asarray(p_W_m)
    return tool


@native
def accelerate(tool: Any, p_W_m: Vector, h_s: float) -> float:
    """Acceleration of the tip along the handle in the sample that ended at `p_W_m` [m/s²]: its second difference."""
    n = tool.axis_W
    x = n[0] * p_W_m[0] + n[1] * p_W_m[1] + n[2] * p_W_m[2]
    v = (x - tool.before_m) / h_s
    a = (v - tool.before_m_s) / h_s
    tool.before_m, tool.before_m_s = x, v
    return float(a)


@native
def couple(tool: Any, a_m_s2: float, h_s: float, corner_Hz: float = COUPLING_HZ) -> float:
    """A sample of acceleration, high-passed [m/s²].

    Trapezoidal state-variable filter (Zavalishin 2012, "The Art of VA Filter Design", 4.4): exact at its corner.
    """
    g = math.tan(math.pi * corner_Hz * h_s)
    slow, damping = tool.slow, math.sqrt(2.0)
    high = (a_m_s2 - (damping + g) * slow[0] - slow[1]) / (1.0 + g * (damping + g))
    band = g * high + slow[0]
    low = g * band + slow[1]
    slow[0], slow[1] = g * high + band, g * band + low
    return float(high)


@native
def shake(tool: Any, a_m_s2: float, h_s: float) -> None:
    """Move the tool by a sample of vibration [m/s²]."""
    leak = 2.0 * math.pi * SHAKE_HZ * h_s
    tool.shake_m_s += a_m_s2 * h_s - leak * tool.shake_m_s
    tool.shake_m += tool.shake_m_s * h_s - leak * tool.shake_m


class Leader(NamedTuple):
    """All that the leader's tick reads and writes."""

    arm: Arm
    end: Endpoint
    tool: Any  # (1,) TOOL
    handle: Any  # (1,) HANDLE that plays what the follower's accelerometer read
    wanted_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) what the handle is asked for in this tick
    tip_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) acceleration of the tip along the handle, by base motors and hand
    handle_m_s2: NDArray[np.float64]  # (SAMPLE_COUNT,) and of the handle on it, by the voice coil
    told: Any  # (1,) MESSAGE to the follower


def new_leader(device: Any, handle: Any, coupling: Coupling, p_WT_m: Any, axis_W: Any) -> Leader:
    """A leader at rest at `p_WT_m` (3,), its handle along `axis_W` (3,)."""
    arm = new_arm(device, p_WT_m)
    end = new_endpoint(coupling, "leader", TICK_S)
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
    play_samples(leader.end.queue[0], leader.wanted_m_s2)
    h_s = 1.0 / ACCELERATION_RATE_HZ
    for i in range(SAMPLE_COUNT):
        advance_arm(leader.arm, h_s)
        leader.tip_m_s2[i] = accelerate(tool, find_tip(leader.arm), h_s)
        wanted = couple(tool, leader.wanted_m_s2[i], h_s, CROSSOVER_HZ)
        leader.handle_m_s2[i], tool.shake_m, _ = vibrate(handle, wanted)
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


# The follower: a device that touches the scene for the leader, with an accelerometer at its tool.
#
# The surface is no haptic rendering here but the world that the tool touches, so it is computed finely: the real tick
# at the rate of the accelerometer, from the tool's true position, its force acting on the tool from outside. What the
# accelerometer reads is the tip's own acceleration along the handle, and on it the vibration of sliding and the
# transients of taps, which is what the swatch's recordings held. The vibration also moves the tool, which the base
# motors' controller is let see as if encoders had no steps: at 100 Hz, 1 m/s² are 2.5 µm, a twentieth of an Omni's.


class Follower(NamedTuple):
    """All that the follower's tick reads and writes."""

    arm: Arm
    end: Endpoint
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
    end = new_endpoint(coupling, "follower", TICK_S)
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
        tick = follower.surface.entries[TICK]
        call_flags(tick, (follower.world, follower.surface, p[0], p[1], p[2], row, follower.sample))
        for j in range(3):
            hand.push_N[j] = row.f_W_N[j]
        advance_arm(follower.arm, h_s)
        vibration = follower.sample[0]
        shake(tool, vibration, h_s)
        moved = accelerate(tool, find_tip(follower.arm), h_s)
        follower.read_m_s2[i] = couple(tool, moved + vibration, h_s)
    return force
