"""Encoding and decoding of packets on the client side."""

import struct

from hapscene.bridge.packets import _AIM, _BODY, _EVENT, _IMPULSE, _STATE, Event, Frame, PacketError, State


def pack_frame(frame: Frame) -> bytes:
    aim = frame.aim or (0.0, 0.0, 0.0)
    parts = [_AIM.pack(frame.aim is not None, len(frame.bodies), 0, frame.event_count, *aim)]
    for body in frame.bodies:
        bits = body.teleport | 2 * (body.v is not None)
        v, w = body.v or (0.0,) * 3, body.w or (0.0,) * 3
        parts.append(_BODY.pack(body.body, bits, 0, *body.p, *body.q, *v, *w, *body.applied))
    return b"".join(parts)


def unpack_state(payload: bytes) -> State:
    """A state.

    Raises:
        PacketError: its length is not that of what it counts.
    """
    if len(payload) < _STATE.size:
        raise PacketError("a state that is cut short")
    tick, age_s, *n = _STATE.unpack_from(payload)
    tool, proxy, normal, force = (tuple(n[i : i + 3]) for i in (0, 3, 6, 9))
    depth, slip, body, face, swatch, flags, first_event, event_count, body_count = n[12:]
    at = _STATE.size + body_count * _IMPULSE.size
    end = at + event_count * _EVENT.size
    if len(payload) not in (end, end + 48):
        raise PacketError("a state of another length than it says")
    impulses = [(index, tuple(J)) for index, _, _, *J in _IMPULSE.iter_unpack(payload[_STATE.size : at])]
    events = [Event(t, kind, on, of, v) for t, kind, _, on, of, _, v in _EVENT.iter_unpack(payload[at:end])]
    contact = (depth, slip, body, face, swatch, flags, first_event)
    axes = struct.unpack(f"<{(len(payload) - end) // 8}d", payload[end:])
    return State(tick, age_s, tool, proxy, normal, force, *contact, tuple(impulses), tuple(events), axes)
