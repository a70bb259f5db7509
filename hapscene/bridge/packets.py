"""Packets of the bridge protocol, version 1, little-endian, as specified in docs/reference/bridge-protocol.md."""

import json
import struct
import zlib
from typing import Final, NamedTuple

from hapscene.errors import FormatError
from hapscene.io.files import Json

__all__ = [
    "ANSWER",
    "BYE",
    "EVENTS_MAX",
    "FRAME",
    "HELLO",
    "ORDER",
    "REFUSED",
    "SIZE_MAX",
    "STATE",
    "VERSION",
    "WELCOME",
    "BodyFrame",
    "Event",
    "Frame",
    "Packet",
    "PacketError",
    "State",
    "pack",
    "pack_json",
    "pack_state",
    "unpack",
    "unpack_frame",
    "unpack_json",
]

VERSION: Final = 1
MAGIC: Final = b"HSB1"

HELLO, WELCOME, FRAME, STATE, ORDER, ANSWER, BYE, REFUSED = range(1, 9)

SIZE_MAX: Final = 32_768
"""Longest packet [bytes]: half of the largest datagram on the local host."""

EVENTS_MAX: Final = 64
"""Most events in a STATE [count]; further events follow in the next one."""

_HEAD: Final = struct.Struct("<4sBBHQI")
_CHECK: Final = struct.Struct("<I")
_AIM: Final = struct.Struct("<BBHI3d")
_BODY: Final = struct.Struct("<HHI3d4d3d3d6d")
_STATE: Final = struct.Struct("<Qd3d3d3d3dddiiiIIHH")
_IMPULSE: Final = struct.Struct("<HHI6d")
_EVENT: Final = struct.Struct("<QBBHHHd")


class PacketError(FormatError):
    """Bytes that are not a valid packet of the protocol."""


class Packet(NamedTuple):
    """One packet.

    Attributes:
        kind: HELLO … REFUSED.
        key: key of the session; 0 before it begins.
        sequence: number from 1, counted by the client; an answer has the number of the packet that it answers.
        payload: content.
    """

    kind: int
    key: int
    sequence: int
    payload: bytes


class BodyFrame(NamedTuple):
    """Pose and velocity of a body in client coordinates; the quaternion is x y z w, velocities are None if not
    given."""

    body: int
    teleport: bool
    p: tuple[float, ...]
    q: tuple[float, ...]
    v: tuple[float, ...] | None
    w: tuple[float, ...] | None
    applied: tuple[float, ...]


class Frame(NamedTuple):
    """Content of a FRAME: target of the hand (None: unchanged), number of received events, bodies."""

    aim: tuple[float, ...] | None
    event_count: int
    bodies: tuple[BodyFrame, ...]


class Event(NamedTuple):
    """A change of contact: kind 1 began, 2 crossed to another swatch, 3 ended; indices into the lists of the WELCOME.
    Or a button was pressed (4) or released (5): `body` is its number."""

    tick: int
    kind: int
    body: int
    swatch: int
    approach: float


class State(NamedTuple):
    """Content of a STATE, in client coordinates; forces in N, impulses in N·s."""

    tick: int
    age_s: float
    tool: tuple[float, ...]
    proxy: tuple[float, ...]
    normal: tuple[float, ...]
    force: tuple[float, ...]
    depth: float
    slip: float
    body: int
    face: int
    swatch: int
    flags: int
    first_event: int
    impulses: tuple[tuple[int, tuple[float, ...]], ...]
    events: tuple[Event, ...]
    axes: tuple[float, ...] = ()  # axes x and z of the tool, for clients that request them


def pack(packet: Packet) -> bytes:
    """Encode a packet."""
    size = _HEAD.size + _CHECK.size + len(packet.payload)
    if size > SIZE_MAX:
        raise PacketError(f"packet of {size} bytes; expected at most {SIZE_MAX}")
    head = _HEAD.pack(MAGIC, packet.kind, 0, size, packet.key, packet.sequence)
    return head + _CHECK.pack(zlib.crc32(head + packet.payload)) + packet.payload


def unpack(data: bytes) -> Packet:
    """Decode a packet from an untrusted source.

    Raises:
        PacketError: invalid bytes.
    """
    start = _HEAD.size + _CHECK.size
    if not start <= len(data) <= SIZE_MAX:
        raise PacketError(f"packet of {len(data)} bytes; expected {start} to {SIZE_MAX}")
    magic, kind, _, size, key, sequence = _HEAD.unpack_from(data)
    if magic != MAGIC or size != len(data) or not HELLO <= kind <= REFUSED:
        raise PacketError("invalid header; expected a packet of version 1")
    if zlib.crc32(data[: _HEAD.size] + data[start:]) != _CHECK.unpack_from(data, _HEAD.size)[0]:
        raise PacketError("wrong checksum")
    return Packet(kind, key, sequence, data[start:])


def pack_json(content: dict[str, Json]) -> bytes:
    return json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()


def unpack_json(payload: bytes | str) -> dict[str, Json]:
    """Decode a JSON object.

    Raises:
        PacketError: invalid JSON, or another type.
    """
    try:
        content = json.loads(payload)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise PacketError("expected a JSON object")
    return content


def unpack_frame(payload: bytes) -> Frame:
    """Decode the content of a FRAME.

    Raises:
        PacketError: the length does not match the number of bodies.
    """
    if len(payload) < _AIM.size:
        raise PacketError("truncated FRAME")
    aims, count, _, event_count, *aim = _AIM.unpack_from(payload)
    if len(payload) != _AIM.size + count * _BODY.size:
        raise PacketError(f"FRAME of {count} bodies has {len(payload)} bytes")
    bodies = []
    for at in range(_AIM.size, len(payload), _BODY.size):
        body, bits, _, *n = _BODY.unpack_from(payload, at)
        v, w = (tuple(n[7:10]), tuple(n[10:13])) if bits & 2 else (None, None)
        bodies.append(BodyFrame(body, bool(bits & 1), tuple(n[:3]), tuple(n[3:7]), v, w, tuple(n[13:19])))
    return Frame(tuple(aim) if aims else None, event_count, tuple(bodies))


def pack_state(state: State) -> bytes:
    vectors = (*state.tool, *state.proxy, *state.normal, *state.force)
    numbers = (state.depth, state.slip, state.body, state.face, state.swatch, state.flags, state.first_event)
    parts = [_STATE.pack(state.tick, state.age_s, *vectors, *numbers, len(state.events), len(state.impulses))]
    parts += [_IMPULSE.pack(body, 0, 0, *impulse) for body, impulse in state.impulses]
    parts += [_EVENT.pack(e.tick, e.kind, 0, e.body, e.swatch, 0, e.approach) for e in state.events]
    return b"".join([*parts, struct.pack(f"<{len(state.axes)}d", *state.axes)])
