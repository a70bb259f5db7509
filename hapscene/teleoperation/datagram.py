"""The messages of leader and follower, the UDP datagram that carries one, and the gate that checks what arrives.

    magic "HSTO" · version u8 · role u8 · scheme u8 · ends u8 · session u32 · tick i64 · echo i64 · position 3 f64 ·
    velocity 3 f64 · wave integral 3 f64 · wave energy f64 · acceleration 10 f32 · CRC-32 u32

Little-endian, 152 bytes, one a tick. The CRC finds what was damaged, not who forged it: whoever can send from the
peer's address and has seen the session's number can speak for it. So both ends stay on this machine unless told
otherwise, and over a network they belong in a tunnel.
"""

import zlib
from dataclasses import dataclass, field
from typing import Any, Final

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
        ("crc", "<u4"),  # of all before it
    ]
)
"""A datagram as it is sent, without padding."""

MAGIC: Final = b"HSTO"

VERSION: Final = 1
"""Version of the layout. A gate admits no other."""

AHEAD_MAX: Final = 60_000
"""Most ticks that a message may be ahead of the last one [count]: a minute."""

SEEN: Final = 1024
"""Ticks for which duplicates are detected [count]."""

LIMITS: Final = {"p_WT_m": 10.0, "v_WT_m_s": 100.0, "wave_sqrtJs": 1e6, "wave_J": 1e6, "a_m_s2": 1e4}
"""Largest magnitude of each quantity that is accepted, in the unit of its name."""


def pack(message: Any, role: int, session: int, scheme: int = 1, ends: bool = False) -> bytes:
    """The datagram of a message, one MESSAGE.

    Args:
        message: what it carries.
        role: of the sender, an index into `endpoint.ROLES`.
        session: a number by which this run of the sender is known.
        scheme: of its coupling, an index into `endpoint.SCHEMES`.
        ends: whether this is its last message.
    """
    made = np.zeros(1, DATAGRAM)
    made["magic"], made["version"], made["session"] = MAGIC, VERSION, session
    made["role"], made["scheme"], made["ends"] = role, scheme, ends
    with np.errstate(over="ignore"):  # a sample beyond float32 becomes infinite, which the gate refuses
        for name in MESSAGE.names or ():
            made[name] = message[name]
    made["crc"] = zlib.crc32(made.tobytes()[:-4])
    return made.tobytes()


@dataclass
class Gate:
    """Checks the datagrams that arrive.

    Attributes:
        role: of the peer, an index into `endpoint.ROLES`.
        scheme: of the coupling, an index into `endpoint.SCHEMES`.
        session: of the peer, None before it was heard.
        mismatched: whether a peer with another scheme was heard.
        ended: whether the peer has sent its last message.
        counts: datagrams by what became of them.
    """

    role: int
    scheme: int = 1
    session: int | None = None
    mismatched: bool = False
    ended: bool = False
    counts: dict[str, int] = field(
        default_factory=lambda: {"let in": 0, "malformed": 0, "foreign": 0, "duplicate": 0, "late": 0}
    )

    def __post_init__(self) -> None:
        self._newest = -1
        self._seen = np.full(SEEN, -1, np.int64)

    def admit(self, data: bytes, message: Any) -> bool:
        """Check a datagram; where it is let in, fill a message, one MESSAGE. Whatever it holds, nothing is raised."""
        fate = self._judge(data, message)
        self.counts[fate] += 1
        return fate == "let in"

    def _judge(self, data: bytes, message: Any) -> str:
        if len(data) != DATAGRAM.itemsize:
            return "malformed"
        found: Any = np.frombuffer(data, DATAGRAM)[0]
        if found["crc"] != zlib.crc32(data[:-4]):
            return "malformed"
        tick, session = int(found["tick"]), int(found["session"])
        if found["magic"] != MAGIC or found["version"] != VERSION or found["role"] != self.role:
            return "foreign"
        if found["scheme"] != self.scheme:
            self.mismatched = self.session is None
            return "foreign"
        if session != self.session and self.session is not None:
            return "foreign"
        sane = all(bool(np.all(np.abs(found[name]) <= most)) for name, most in LIMITS.items())  # NaN is not
        if found["ends"] > 1 or tick < 0 or found["echo"] < -1 or not sane:
            return "malformed"
        if self._newest >= 0 and tick > self._newest + AHEAD_MAX:
            return "foreign"
        if tick <= self._newest - SEEN:
            return "late"
        if self._seen[tick % SEEN] == tick:
            return "duplicate"
        self.session = session
        self.ended = self.ended or bool(found["ends"])
        self._newest = max(tick, self._newest)
        self._seen[tick % SEEN] = tick
        for name in MESSAGE.names or ():
            message[name] = found[name]
        return "let in"
