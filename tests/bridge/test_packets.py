"""Packets of the bridge: round trips, documented layout, invalid bytes."""

import random
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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

NUMBER = st.floats(allow_nan=False)


def vector(count: int) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(*[NUMBER] * count)


BODY = st.builds(
    lambda index, jumps, p, q, moving, applied: BodyFrame(index, jumps, p, q, *(moving or (None, None)), applied),
    st.integers(0, 65535),
    st.booleans(),
    vector(3),
    vector(4),
    st.none() | st.tuples(vector(3), vector(3)),
    vector(6),
)
FRAMES = st.builds(Frame, st.none() | vector(3), st.integers(0, 2**32 - 1), st.lists(BODY, max_size=5).map(tuple))
INDEX = st.integers(-1, 2**31 - 1)
EVENT = st.builds(
    Event, st.integers(0, 2**64 - 1), st.integers(1, 3), st.integers(0, 65535), st.integers(0, 65535), NUMBER
)
STATES = st.builds(
    State,
    st.integers(0, 2**64 - 1),
    NUMBER,
    *[vector(3)] * 4,
    NUMBER,
    NUMBER,
    *[INDEX] * 3,
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**32 - 1),
    st.lists(st.tuples(st.integers(0, 65535), vector(6)), max_size=4).map(tuple),
    st.lists(EVENT, max_size=4).map(tuple),
    st.just(()) | vector(6),
)


@given(FRAMES)
def test_frame_round_trip(frame: Frame) -> None:
    assert unpack_frame(pack_frame(frame)) == frame


@given(STATES)
def test_state_round_trip(state: State) -> None:
    assert unpack_state(pack_state(state)) == state


def test_layout() -> None:
    body = BodyFrame(7, True, (1, 2, 3), (0, 0, 0, 1), (4, 5, 6), (7, 8, 9), (1.5, 0, 0, 0, 0, 2.5))
    data = pack(Packet(FRAME, 0x1122334455667788, 9, pack_frame(Frame((0.1, 0.2, 0.3), 3, (body,)))))
    assert data[:6] == b"HSB1\x03\0" and len(data) == 24 + 32 + 160
    assert struct.unpack_from("<HQI", data, 6) == (len(data), 0x1122334455667788, 9)
    assert struct.unpack_from("<I", data, 20)[0] == zlib.crc32(data[:20] + data[24:])
    assert (data[24], data[25], struct.unpack_from("<I", data, 28)[0]) == (1, 1, 3)
    assert struct.unpack_from("<3d", data, 32) == (0.1, 0.2, 0.3)
    assert struct.unpack_from("<HH", data, 56) == (7, 3)
    assert struct.unpack_from("<19d", data, 64) == (1, 2, 3, 0, 0, 0, 1, 4, 5, 6, 7, 8, 9, 1.5, 0, 0, 0, 0, 2.5)
    state = State(5, 0.001, *[(float(k),) * 3 for k in range(4)], 0.25, 0.5, 1, 2, 3, 4, 6, ((7, (1.0,) * 6),), ())
    answer = pack_state(state)
    assert len(answer) == 152 + 56 and struct.unpack_from("<iiiIIHH", answer, 128) == (1, 2, 3, 4, 6, 0, 1)
    assert struct.unpack_from("<H", answer, 152)[0] == 7


def test_damaged_packets_are_refused() -> None:
    """Packets with changed, missing or additional bytes."""
    good = pack(Packet(FRAME, 1, 1, pack_frame(Frame((0.0, 0.0, 0.1), 0, ()))))
    rng = random.Random(3)
    for k in range(2_000):
        data = bytearray(good)
        for _ in range(rng.randrange(1, 4)):
            data[rng.randrange(len(data))] ^= rng.randrange(1, 256)
        if k % 3 == 0:
            data = data[: rng.randrange(len(data))] if k % 2 else data + rng.randbytes(rng.randrange(1, 50))
        if data == good:
            continue
        with pytest.raises(PacketError):
            unpack(bytes(data))


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
