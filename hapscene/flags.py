"""Flags of a tick: errors and active limits. A tick raises no exceptions."""

from enum import IntFlag
from functools import cache

__all__ = ["Flag", "flag_of"]


class Flag(IntFlag):
    """Errors and active limits of a tick (bits of `Recording.flags`)."""

    TOOL_NOT_FINITE = 1
    """The device position was NaN or infinite; the last valid position was used."""
    UNSETTLED = 2
    """The proxy did not settle within `PASS_MAX` moves, or fewer with many bodies (`CAST_MAX`)."""
    EFFECT_MUTED = 4
    """An effect returned NaN or infinity and is muted until the next `reset`."""
    FORCE_LIMITED = 8
    """The force was limited to the maximum of the device; its direction was kept."""
    SLEW_LIMITED = 16
    """The slew rate of the force was limited to the maximum of the device."""
    ACCELERATION_LIMITED = 32
    """Acceleration samples were limited to the maximum of the device."""
    ENERGY_DAMPED = 64
    """The passivity controller damped the tool because the wall had generated energy."""
    CROWDED = 128
    """More than `NEAR_MAX` bodies overlap near the tool; some of them were ignored."""
    POSE_REFUSED = 256
    """The new pose of a body was not finite or not rigid; its last valid pose was kept."""
    # safety functions for the force that is sent to the device (`hapscene.device.safety`)
    OUT_OF_WORKSPACE = 512
    """The tool is outside the workspace of the device; no force until it is back."""
    TOO_FAST = 1024
    """The speed of the tool was above the limit; no force until it rests."""
    FORCE_NOT_FINITE = 2048
    """The force was NaN or infinite; no force was sent."""
    PEAK_LIMITED = 4096
    """The sent force was limited to the peak force of the device; its direction was kept."""
    HEAT_LIMITED = 8192
    """The motors are warm; the force was limited to the continuous force."""
    STEP_LIMITED = 16384
    """The change of the sent force was limited."""
    RAMPED = 32768
    """The force is ramped up or down."""
    APPLICATION_SILENT = 65536
    """The application does not respond; no force until it does."""
    DEVICE_NOT_READY = 131072
    """The device is not calibrated, homed or powered, or sends no new samples; no force until it is ready."""
    STALLED = 262144
    """The loop was stalled, for example because the machine slept; the force ramps up again."""
    PROXY_RESET = 524288
    """A new shape of a body enclosed the proxy; the proxy was set on the nearest surface of the body."""
    BODY_REMOVED = 1048576
    """A touched body was removed; its force fades out."""
    TOOL_FAR = 2097152
    """The device position is far from all bodies, or has jumped as far in one tick (see `hapscene.contact.world`); its
    unit is probably wrong."""


@cache
def flag_of(bits: int) -> Flag:
    """The set of flags for a bit mask, cached: construction costs 1 µs, a lookup 0.1 µs."""
    return Flag(bits)
