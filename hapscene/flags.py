"""What can go wrong in a tick, or be limited: a tick raises nothing, it flags."""

from enum import IntFlag
from functools import cache

__all__ = ["Flag", "flag_of"]


class Flag(IntFlag):
    """What went wrong in a tick, or was limited: a tick raises nothing (bits of `Recording.flags`)."""

    TOOL_NOT_FINITE = 1
    """The tool's position was NaN or infinite: the last good one was used."""
    UNSETTLED = 2
    """The proxy did not come to rest within `PASS_MAX` moves, or fewer among many bodies (`CAST_MAX`)."""
    EFFECT_MUTED = 4
    """An effect returned NaN or infinity: it is mute until the next `reset`, the others go on."""
    FORCE_LIMITED = 8
    """The force was over the device's limit: its magnitude was cut, its direction kept."""
    SLEW_LIMITED = 16
    """The force changed faster than the device's limit allows."""
    ACCELERATION_LIMITED = 32
    """Acceleration samples were over the device's limit and were cut."""
    ENERGY_DAMPED = 64
    """The wall had given out energy that it never took in: the passivity controller held the tool back."""
    CROWDED = 128
    """More bodies overlap where the tool is than one tick asks (`NEAR_MAX`): some of them are not felt."""
    POSE_REFUSED = 256
    """A body was given a pose that is not finite, or no rotation and translation: it stays at its last good one."""
    # what the servo's safety does to the force that goes to the device (`hapscene.device.safety`)
    OUT_OF_WORKSPACE = 512
    """The tool left the device's workspace: no force until it is back."""
    TOO_FAST = 1024
    """The tool moved faster than a hand moves it: no force until it rests."""
    FORCE_NOT_FINITE = 2048
    """The force was NaN or infinite: none was sent."""
    PEAK_LIMITED = 4096
    """The force was over what the device may ever be sent: its magnitude was cut, its direction kept."""
    HEAT_LIMITED = 8192
    """The motors are warm: no more than they bear for long was sent."""
    STEP_LIMITED = 16384
    """The force sent changed faster than the device may be made to."""
    RAMPED = 32768
    """Less than the whole force was sent, since it begins or ends."""
    APPLICATION_SILENT = 65536
    """The application is gone, stopped, or no longer asks: no force until it is back."""
    DEVICE_NOT_READY = 131072
    """The device is not calibrated, homed or powered, or says nothing new: no force until it does."""
    STALLED = 262144
    """The loop itself stood still, as when the machine slept: the force begins anew."""


@cache
def flag_of(bits: int) -> Flag:
    """A set of flags, by its bits: to make one costs a microsecond, to find it again a tenth."""
    return Flag(bits)
