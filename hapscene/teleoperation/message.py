"""What leader and follower tell each other, once a tick: the same record in simulation and over UDP."""

from typing import Final

import numpy as np

SAMPLE_COUNT: Final = 10
"""Acceleration samples in a message [count]: a tick of 1 ms at 10 kHz. The datagram's layout depends on it."""

MESSAGE: Final = np.dtype(
    [
        ("tick", "i8"),  # of the sender, from 0: also the sequence number, since each tick sends one message
        ("echo", "i8"),  # newest tick the sender has heard from its peer, −1 before any: gives the round trip
        ("p_WT_m", "f8", (3,)),  # the sender's tool
        ("v_WT_m_s", "f8", (3,)),  # its velocity, low-passed
        ("wave_sqrtJs", "f8", (3,)),  # integral over time of the waves sent so far [√(J·s)]
        ("wave_J", "f8"),  # energy of the waves sent so far
        ("a_m_s2", "f8", (SAMPLE_COUNT,)),  # what the sender's accelerometer read in this tick, along the handle
    ],
    align=True,
)
"""One message. Waves are sent as totals since the start, so that a lost message costs nothing once the next arrives
(Niemeyer & Slotine 1998, "Towards force-reflecting teleoperation over the Internet")."""
