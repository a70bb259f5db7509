"""What leader and follower tell each other, the UDP datagram that carries it, and the gate for the peer's alone.

    magic "HSTO" · version u8 · role u8 · scheme u8 · ends u8 · session u32 · tick i64 · echo i64 · position 3 f64 ·
    velocity 3 f64 · wave integral 3 f64 · wave energy f64 · acceleration 10 f32 · CRC-32 u32

Little-endian, 148 bytes, one a tick. The CRC finds what was damaged, not who forged it: whoever can send from the
peer's address and has seen the session's number can speak for it. So both ends stay on this machine unless told
otherwise, and over a network they belong in a tunnel.
"""

import math
import struct
import zlib
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

# What leader and follower tell each other, once a tick: the same record in simulation and over UDP.


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


VERSION: Final = 1
"""Version of the layout. A gate lets in no other."""

LAYOUT: Final = struct.Struct(f"<4sBBBBIqq10d{SAMPLE_COUNT}f")
CHECK: Final = struct.Struct("<I")
SIZE: Final = LAYOUT.size + CHECK.size

MAGIC: Final = b"HSTO"

AHEAD_MAX: Final = 60_000
"""Most ticks that a message may be ahead of the last one [count]: a minute. Beyond it, it is none of this session."""

SEEN: Final = 1024
"""Ticks for which it is known whether they were heard [count]."""

POSITION_MAX_M: Final = 10.0
"""Farthest that a tool is believed to be [m]."""

SPEED_MAX_M_S: Final = 100.0
"""Fastest that a tool is believed to be [m/s]."""

WAVE_MAX: Final = 1e6
"""Largest total of waves that is believed [√(J·s)], [J]."""

ACCELERATION_MAX_M_S2: Final = 1e4
"""Largest sample that is believed [m/s²]."""


def pack(message: Any, role: int, session: int, scheme: int = 1, ends: bool = False) -> bytes:
    """The datagram of a message, one MESSAGE.

    Args:
        message: what it carries.
        role: of the sender, an index into `port.ROLES`.
        session: a number by which this run of the sender is known.
        scheme: by which it is tied, an index into `coupling.SCHEMES`.
        ends: whether this is its last word.
    """
    body = LAYOUT.pack(
        MAGIC,
        VERSION,
        role,
        scheme,
        ends,
        session,
        int(message["tick"]),
        int(message["echo"]),
        *message["p_WT_m"],
        *message["v_WT_m_s"],
        *message["wave_sqrtJs"],
        message["wave_J"],
        *message["a_m_s2"],
    )
    return body + CHECK.pack(zlib.crc32(body))


@dataclass
class Gate:
    """What of the datagrams that arrive is let in.

    Attributes:
        role: of the peer, an index into `port.ROLES`.
        scheme: that it must be tied by, an index into `coupling.SCHEMES`.
        session: of the peer, None before it was heard.
        mismatched: whether a peer was heard that is tied by another scheme.
        ended: whether the peer said that it ends.
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
        if len(data) != SIZE or CHECK.unpack_from(data, LAYOUT.size)[0] != zlib.crc32(data[: LAYOUT.size]):
            return "malformed"
        magic, version, role, scheme, ends, session, tick, echo, *numbers = LAYOUT.unpack_from(data)
        if magic != MAGIC or version != VERSION or role != self.role:
            return "foreign"
        if scheme != self.scheme:
            self.mismatched = self.session is None
            return "foreign"
        if session != self.session and self.session is not None:
            return "foreign"
        if ends not in (0, 1) or not _sane(tick, echo, numbers):
            return "malformed"
        if self._newest >= 0 and tick > self._newest + AHEAD_MAX:
            return "foreign"
        if tick <= self._newest - SEEN:
            return "late"
        if self._seen[tick % SEEN] == tick:
            return "duplicate"
        self.session = session
        self.ended = self.ended or bool(ends)
        self._newest = max(tick, self._newest)
        self._seen[tick % SEEN] = tick
        message["tick"], message["echo"] = tick, echo
        message["p_WT_m"], message["v_WT_m_s"], message["wave_sqrtJs"] = numbers[0:3], numbers[3:6], numbers[6:9]
        message["wave_J"], message["a_m_s2"] = numbers[9], numbers[10:]
        return "let in"


def _sane(tick: int, echo: int, numbers: list[float]) -> bool:
    """Whether the numbers can be those of a tool."""
    bounds = [POSITION_MAX_M] * 3 + [SPEED_MAX_M_S] * 3 + [WAVE_MAX] * 4 + [ACCELERATION_MAX_M_S2] * SAMPLE_COUNT
    finite = all(math.isfinite(x) and abs(x) <= most for x, most in zip(numbers, bounds, strict=True))
    return finite and tick >= 0 and echo >= -1
