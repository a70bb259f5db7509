"""Packets of the bridge: round trips, documented layout, invalid bytes."""

import struct
import zlib

import numpy as np
import pytest

from hapscene.bridge.packets import (
    FRAME,
    SIZE_MAX,
    BodyFrame,
    Event,
    Frame,
    Packet,
    PacketError,
    State,
    pack,
    pack_state,
    unpack,
    unpack_frame,
    unpack_json,
)

from .client_packets import pack_frame, unpack_state


def test_layout() -> None:
    body = BodyFrame(7, True, (1, 2, 3), (0, 0, 0, 1), (4, 5, 6), (7, 8, 9), (1.5, 0, 0, 0, 0, 2.5))
    frame = Frame((0.1, 0.2, 0.3), 3, (body, BodyFrame(8, False, (1, 2, 3), (0, 0, 0, 1), None, None, (0,) * 6)))
    assert unpack_frame(pack_frame(frame)) == frame
    data = pack(Packet(FRAME, 0x1122334455667788, 9, pack_frame(Frame(frame.aim, 3, (body,)))))
    assert data[:6] == b"HSB1\x03\0" and len(data) == 24 + 32 + 160
    assert struct.unpack_from("<HQI", data, 6) == (len(data), 0x1122334455667788, 9)
    assert struct.unpack_from("<I", data, 20)[0] == zlib.crc32(data[:20] + data[24:])
    assert (data[24], data[25], struct.unpack_from("<I", data, 28)[0]) == (1, 1, 3)
    assert struct.unpack_from("<3d", data, 32) == (0.1, 0.2, 0.3)
    assert struct.unpack_from("<HH", data, 56) == (7, 3)
    assert struct.unpack_from("<19d", data, 64) == (1, 2, 3, 0, 0, 0, 1, 4, 5, 6, 7, 8, 9, 1.5, 0, 0, 0, 0, 2.5)
    state = State(5, 0.001, *[(float(k),) * 3 for k in range(4)], 0.25, 0.5, 1, 2, 3, 4, 6, ((7, (1.0,) * 6),), ())
    answer = pack_state(state)
    assert unpack_state(answer) == state
    other = state._replace(events=(Event(9, 2, 1, 3, 0.5),), axes=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    assert unpack_state(pack_state(other)) == other
    assert len(answer) == 152 + 56 and struct.unpack_from("<iiiIIHH", answer, 128) == (1, 2, 3, 4, 6, 0, 1)
    assert struct.unpack_from("<H", answer, 152)[0] == 7


@pytest.mark.parametrize(("at", "byte"), [(3, b"2"), (4, b"\0"), (4, b"\x09"), (6, b"\x1a")])
def test_an_invalid_header_is_refused(at: int, byte: bytes) -> None:
    """Another version, kinds that do not exist, and another length, with the right checksum."""
    data = pack(Packet(FRAME, 1, 2, b"?"))
    assert unpack(data) == (FRAME, 1, 2, b"?")
    head = data[:at] + byte + data[at + 1 : 20]
    with pytest.raises(PacketError, match="header"):
        unpack(head + struct.pack("<I", zlib.crc32(head + b"?")) + b"?")
    for wrong in (data[:23], data + bytes(SIZE_MAX)):
        with pytest.raises(PacketError, match="expected 24 to"):
            unpack(wrong)


def test_inconsistent_packets_are_refused() -> None:
    with pytest.raises(PacketError, match="expected at most"):
        pack(Packet(FRAME, 1, 1, bytes(SIZE_MAX)))
    frame = pack_frame(Frame(None, 0, (BodyFrame(0, False, (0,) * 3, (0,) * 4, None, None, (0,) * 6),)))
    for payload in (b"", frame[:20], frame[:-1], frame + b"\0", frame[:32]):
        with pytest.raises(PacketError):
            unpack_frame(payload)
    for payload in (b"", bytes(151), bytes(153)):
        with pytest.raises(PacketError):
            unpack_state(payload)
    for payload in (b"", b"\xff", b"[]", b"1", b"[" * 100_000):
        with pytest.raises(PacketError):
            unpack_json(payload)
    assert np.isnan(
        unpack_frame(pack_frame(Frame((np.nan, 0, 0), 0, ()))).aim[0]
    )  # finite or not is the server's affair
