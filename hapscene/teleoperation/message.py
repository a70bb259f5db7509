"""Message that leader and follower send each other in every tick."""

from typing import Final

import numpy as np

__all__ = ["MESSAGE", "SAMPLE_COUNT"]

SAMPLE_COUNT: Final = 10
"""Acceleration samples in a message [count]: a tick of 1 ms at 10 kHz."""

MESSAGE: Final = np.dtype(
    [
        ("tick", "i8"),  # tick of the sender, from 0; also the sequence number, since each tick sends one message
        ("p_WT_m", "f8", (3,)),  # position of the sender's tool
        ("v_WT_m_s", "f8", (3,)),  # its velocity, low-passed
        ("wave_sqrtJs", "f8", (3,)),  # integral over time of the waves sent so far [√(J·s)]
        ("wave_J", "f8"),  # energy of the waves sent so far
        ("a_m_s2", "f8", (SAMPLE_COUNT,)),  # accelerometer samples of this tick, along the handle
    ],
    align=True,
)
"""One message. Waves are sent as totals since the start, so that a lost message has no effect once the next one arrives
(Niemeyer & Slotine 1998, "Towards force-reflecting teleoperation over the Internet")."""
