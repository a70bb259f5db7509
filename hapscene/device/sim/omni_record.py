"""Record and flags of the simulated Phantom Omni, for compiled code."""

from enum import IntFlag
from typing import Final

import numpy as np

__all__ = ["OMNI", "OmniFlag"]


class OmniFlag(IntFlag):
    """Errors and limits since the last `hold_omni` (bits of the field `trouble`)."""

    FORCE_NOT_FINITE = 1
    """The commanded force was NaN or infinite, and was replaced by 0."""
    TORQUE_LIMITED = 2
    """The force exceeded the torque of a motor, and was scaled down in its direction."""
    HOT = 4
    """The temperature of a motor limits its torque below the peak torque."""
    SINGULAR = 8
    """The arm is nearly singular: forces along one direction are inaccurate."""
    AT_STOP = 16
    """A joint is at its mechanical stop."""
    HAND_NOT_FINITE = 32
    """A value of the hand was NaN or infinite, and was replaced by 0."""
    HAND_LIMITED = 64
    """The force of the hand exceeded `HAND_MAX_N`, and was limited to it."""
    SPEED_LIMITED = 128
    """The speed of a joint exceeded `SPEED_MAX_RAD_S`, and was limited to it."""


OMNI: Final = np.dtype(
    [
        ("R_WD", "f8", (3, 3)),  # pose of the device
        ("p_WD_m", "f8", (3,)),
        ("stiffness_N_m", "f8", (3,)),  # structure between arm and tool, along x, y, z of D
        ("damping_Ns_m", "f8", (3,)),
        ("tool_kg", "f8"),
        ("friction_Nm", "f8", (3,)),  # Coulomb friction of each joint
        ("viscous_Nms", "f8", (3,)),  # viscous friction of each joint
        ("quantum_rad", "f8", (3,)),  # resolution of each encoder; 0: exact
        ("peak_Nm", "f8", (3,)),  # peak torque of each motor
        ("continuous_Nm", "f8", (3,)),  # continuous torque of each motor
        ("thermal_s", "f8"),  # thermal time constant; infinite: no heating
        ("gravity", "i8"),  # 1: gravity and counterbalance act, and the motors compensate them
        # state
        ("q", "f8", (3,)),  # joints [rad]
        ("dq", "f8", (3,)),  # [rad/s]
        ("ddq", "f8", (3,)),  # mean over the last step [rad/s²]
        ("p_DT_m", "f8", (3,)),  # tool position
        ("v_DT_m_s", "f8", (3,)),
        ("torque_Nm", "f8", (3,)),  # motor torques, held
        ("heat", "f8", (3,)),  # temperature rise of each motor, 1: steady state at continuous torque
        ("held_s", "f8"),  # time since the torques were set
        ("trouble", "i8"),  # bits of `OmniFlag`
    ],
    align=True,
)
"""Parameters, pose and state of one Omni."""
