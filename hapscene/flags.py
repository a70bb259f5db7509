"""What can go wrong in a tick, or be limited: a tick raises nothing, it flags."""

from enum import IntFlag
from typing import Final


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


FLAGS: Final = [Flag(bits) for bits in range(2 * max(Flag))]
"""Every set of flags, by its bits: to make one costs a microsecond."""
