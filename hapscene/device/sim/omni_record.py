"""The simulated Phantom Omni as compiled code reads it, and what can go wrong with it."""

from enum import IntFlag
from typing import Final

import numpy as np

__all__ = ["OMNI", "OmniFlag"]


class OmniFlag(IntFlag):
    """What went wrong or was limited since the last `hold_omni` (bits of the record's `trouble`)."""

    FORCE_NOT_FINITE = 1
    """A force to be held was NaN or infinite: the motors held none."""
    TORQUE_LIMITED = 2
    """The force asks more of a motor than it has: it was scaled down, its direction kept."""
    HOT = 4
    """A motor is so warm that less than its peak torque is allowed."""
    SINGULAR = 8
    """The arm is nearly singular: forces along one direction cannot be made well."""
    AT_STOP = 16
    """A joint is at its mechanical stop."""
    HAND_NOT_FINITE = 32
    """A number of the hand's was NaN or infinite and counted as 0."""
    HAND_LIMITED = 64
    """The hand pulled harder than any hand can: its force was cut to `HAND_MAX_N`."""
    SPEED_LIMITED = 128
    """A joint was faster than `SPEED_MAX_RAD_S`: it was slowed to that."""


OMNI: Final = np.dtype(
    [
        ("R_WD", "f8", (3, 3)),  # where the device stands
        ("p_WD_m", "f8", (3,)),
        ("compliant", "i8"),  # 0: the tool is rigidly at the arm's end
        ("stiffness_N_m", "f8", (3,)),  # between the arm's end and the tool, along x, y, z of D
        ("damping_Ns_m", "f8", (3,)),
        ("tool_kg", "f8"),
        ("friction_Nm", "f8", (3,)),  # dry friction of each joint
        ("viscous_Nms", "f8", (3,)),  # torque per joint speed
        ("quantum_rad", "f8", (3,)),  # angle between two counts of each encoder, 0: exact
        ("peak_Nm", "f8", (3,)),  # most torque of each motor, for a short time
        ("continuous_Nm", "f8", (3,)),  # and for any time
        ("thermal_s", "f8"),  # time constant of a motor's warming, infinite: none
        ("gravity", "i8"),  # 1: weight and counterbalance act
        ("compensated", "i8"),  # 1: the motors carry them
        # state
        ("q", "f8", (3,)),  # joints [rad]
        ("dq", "f8", (3,)),  # [rad/s]
        ("ddq", "f8", (3,)),  # over the last step [rad/s²]
        ("p_DT_m", "f8", (3,)),  # the tool
        ("v_DT_m_s", "f8", (3,)),
        ("torque_Nm", "f8", (3,)),  # of the motors, held
        ("heat", "f8", (3,)),  # warmth of each motor over its surroundings, 1: as at continuous torque
        ("held_s", "f8"),  # how long these torques have been held
        ("trouble", "i8"),  # bits of `OmniFlag`
    ],
    align=True,
)
"""One Omni: its parameters, its place, its state."""
