"""Messages between leader and follower, their UDP datagram, and the filter that checks received datagrams.

    magic "HSTO" · version u8 · role u8 · scheme u8 · ends u8 · session u32 · tick i64 · echo i64 ·
    position 3 f64 · velocity 3 f64 · wave integral 3 f64 · wave energy f64 · acceleration 10 f32 · CRC-32 u32

Little-endian, 152 bytes, one per tick. The CRC detects damage, not forgery: an attacker who can send from the
address of the peer and knows the session number can impersonate it. Both ends therefore use the loopback address by
default; over a network, use a tunnel.
"""

import zlib
from typing import Any, Final

import numpy as np

from hapscene.records import Record

__all__ = ["DATAGRAM", "MESSAGE", "SAMPLE_COUNT", "DatagramFilter", "pack"]

SAMPLE_COUNT: Final = 10
"""Acceleration samples in a message [count]: a tick of 1 ms at 10 kHz. The datagram's layout depends on it."""

MESSAGE: Final = np.dtype(
    [
        ("tick", "i8"),  # tick of the sender, from 0; also the sequence number, since each tick sends one message
        ("echo", "i8"),  # newest tick received from the peer, −1 before the first: yields the round-trip time
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


DATAGRAM: Final = np.dtype(
    [
        ("magic", "S4"),
        ("version", "u1"),
        ("role", "u1"),
        ("scheme", "u1"),
        ("ends", "u1"),
        ("session", "<u4"),
        ("tick", "<i8"),
        ("echo", "<i8"),
        ("p_WT_m", "<f8", (3,)),
        ("v_WT_m_s", "<f8", (3,)),
        ("wave_sqrtJs", "<f8", (3,)),
        ("wave_J", "<f8"),
        ("a_m_s2", "<f4", (SAMPLE_COUNT,)),
        ("crc", "<u4"),  # of all preceding bytes
    ]
)
"""A datagram as it is sent, without padding."""

MAGIC: Final = b"HSTO"

VERSION: Final = 1
"""Version of the layout; a filter rejects other versions."""

AHEAD_MAX: Final = 60_000
"""Most ticks between the newest message and the next one [count]: a minute."""

SEEN: Final = 1024
"""Ticks for which duplicates are detected [count]."""

LIMITS: Final = {"p_WT_m": 10.0, "v_WT_m_s": 100.0, "wave_sqrtJs": 1e6, "wave_J": 1e6, "a_m_s2": 1e4}
"""Largest accepted magnitude of each quantity, in the unit of its name."""


def pack(message: Record, role: int, session: int, scheme: int = 1, ends: bool = False) -> bytes:
    """Encode a message, one MESSAGE, as a datagram.

    Args:
        message: the message.
        role: role of the sender, an index into `endpoint.ROLES`.
        session: number that identifies this run of the sender.
        scheme: coupling scheme of the sender, an index into `endpoint.SCHEMES`.
        ends: whether this is the last message of the sender.
    """
    made = np.zeros(1, DATAGRAM)
    made["magic"], made["version"], made["session"] = MAGIC, VERSION, session
    made["role"], made["scheme"], made["ends"] = role, scheme, ends
    with np.errstate(over="ignore"):  # a sample beyond the range of float32 becomes infinite, which the filter rejects
        for name in MESSAGE.names or ():
            made[name] = message[name]
    made["crc"] = zlib.crc32(made.tobytes()[:-4])
    return made.tobytes()


class DatagramFilter:
    """Checks received datagrams, and decodes valid ones.

    Attributes:
        session: session number of the peer, None before its first message.
        mismatched: whether a peer with another coupling scheme has sent a message.
        ended: whether the peer has sent its last message.
        counts: number of datagrams by result.
    """

    def __init__(self, role: int, scheme: int = 1) -> None:
        """Accept datagrams of a peer with this role and scheme, indices into `endpoint.ROLES` and `SCHEMES`."""
        self._role, self._scheme = role, scheme
        self.session: int | None = None
        self.mismatched = self.ended = False
        self.counts = {"accepted": 0, "malformed": 0, "foreign": 0, "duplicate": 0, "outdated": 0}
        self._newest, self._seen = -1, np.full(SEEN, -1, np.int64)

    def accept(self, data: bytes, message: Record) -> bool:
        """Check a datagram; if it is valid, decode it into `message`, one MESSAGE. Never raises.

        Returns whether the datagram is valid.
        """
        result = self._classify(data)
        self.counts[result] += 1
        if result != "accepted":
            return False
        found = np.frombuffer(data, DATAGRAM)[0]
        tick = int(found["tick"])
        self.session, self.ended = int(found["session"]), self.ended or bool(found["ends"])
        self._newest, self._seen[tick % SEEN] = max(tick, self._newest), tick
        for name in MESSAGE.names or ():
            message[name] = found[name]
        return True

    def _classify(self, data: bytes) -> str:
        """The result under which a datagram is counted."""
        if len(data) != DATAGRAM.itemsize:
            return "malformed"
        found: Any = np.frombuffer(data, DATAGRAM)[0]
        if found["crc"] != zlib.crc32(data[:-4]):
            return "malformed"
        if found["magic"] != MAGIC or found["version"] != VERSION or found["role"] != self._role:
            return "foreign"
        if found["scheme"] != self._scheme:
            self.mismatched = self.session is None
            return "foreign"
        if self.session not in (None, int(found["session"])):
            return "foreign"
        tick = int(found["tick"])
        in_range = all(bool(np.all(np.abs(found[name]) <= most)) for name, most in LIMITS.items())  # False for NaN
        if found["ends"] > 1 or tick < 0 or found["echo"] < -1 or not in_range:
            return "malformed"
        if self._newest >= 0 and tick > self._newest + AHEAD_MAX:
            return "foreign"
        if tick <= self._newest - SEEN:
            return "outdated"
        return "duplicate" if self._seen[tick % SEEN] == tick else "accepted"
