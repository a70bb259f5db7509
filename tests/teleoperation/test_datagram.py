"""Datagrams: encoding, and rejection of invalid ones."""

import math
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapscene.records import records
from hapscene.teleoperation.datagram import AHEAD_MAX, DATAGRAM, MESSAGE, SEEN, DatagramFilter, pack

SIZE = DATAGRAM.itemsize


def message(tick: int = 7) -> Any:
    outgoing = records(1, MESSAGE)[0]
    outgoing.tick, outgoing.echo = tick, max(tick - 3, -1)
    outgoing.p_WT_m, outgoing.v_WT_m_s, outgoing.wave_sqrtJs = (0.1, -0.2, 1e-9), (1.0, 2.0, -3.0), (0.5, -1e-17, 3.0)
    outgoing.wave_J = 0.25
    outgoing.a_m_s2 = np.linspace(-40.0, 40.0, 10).astype(np.float32)
    return outgoing


def fate(filter_: DatagramFilter, data: bytes) -> str:
    """The result under which a datagram is counted."""
    before = dict(filter_.counts)
    filter_.accept(data, records(1, MESSAGE)[0])
    (name,) = (name for name, count in filter_.counts.items() if count != before[name])
    return name


def checked(body: bytes) -> bytes:
    return body + struct.pack("<I", zlib.crc32(body))


def test_encoding_is_exact() -> None:
    outgoing, received = message(), records(1, MESSAGE)[0]
    data = pack(outgoing, 1, 99)
    assert len(data) == SIZE
    assert DatagramFilter(1).accept(data, received)
    assert received.tobytes() == outgoing.tobytes()


@given(st.binary(max_size=2 * SIZE))
def test_arbitrary_bytes_are_malformed(data: bytes) -> None:
    assert fate(DatagramFilter(1), data) == "malformed"


@given(st.binary(min_size=SIZE - 16, max_size=SIZE - 16))
def test_accepted_content_is_finite_and_in_range(rest: bytes) -> None:
    received = records(1, MESSAGE)[0]
    filter_ = DatagramFilter(1)
    if filter_.accept(checked(pack(message(), 1, 99)[:12] + rest), received):
        numbers = np.concatenate([np.ravel(received[name]) for name in MESSAGE.names])
        assert np.isfinite(numbers).all() and received.tick >= 0
        assert np.abs(received.p_WT_m).max() <= 10.0


@given(st.integers(0, 8 * SIZE - 1))
def test_a_flipped_bit_is_malformed(bit: int) -> None:
    data = bytearray(pack(message(), 1, 99))
    data[bit // 8] ^= 1 << bit % 8
    assert fate(DatagramFilter(1), bytes(data)) == "malformed"


def test_other_sessions_roles_and_versions_are_foreign() -> None:
    filter_ = DatagramFilter(1)
    assert fate(filter_, pack(message(1), 1, 99)) == "accepted"
    assert fate(filter_, pack(message(2), 1, 98)) == "foreign"
    assert fate(filter_, pack(message(2), 0, 99)) == "foreign"
    assert fate(filter_, pack(message(2), 1, 99, scheme=0)) == "foreign" and not filter_.mismatched
    body = bytearray(pack(message(2), 1, 99)[:-4])
    body[4] += 1
    assert fate(filter_, checked(bytes(body))) == "foreign"
    assert fate(filter_, pack(message(2), 1, 99)) == "accepted"


def test_scheme_mismatch_is_detected() -> None:
    filter_ = DatagramFilter(1)
    assert fate(filter_, pack(message(), 1, 99, scheme=0)) == "foreign"
    assert filter_.mismatched


def test_duplicates_and_outdated_datagrams_are_rejected() -> None:
    filter_ = DatagramFilter(1)
    for tick in (5, 4, 6 + SEEN):
        assert fate(filter_, pack(message(tick), 1, 9)) == "accepted"
    assert fate(filter_, pack(message(6 + SEEN), 1, 9)) == "duplicate"
    assert fate(filter_, pack(message(6), 1, 9)) == "outdated"
    assert fate(filter_, pack(message(7), 1, 9)) == "accepted"
    assert fate(filter_, pack(message(7 + SEEN + AHEAD_MAX), 1, 9)) == "foreign"


@pytest.mark.parametrize(
    ("field", "value"),
    [("p_WT_m", math.nan), ("v_WT_m_s", math.inf), ("wave_sqrtJs", 1e30), ("wave_J", -1e30), ("a_m_s2", 1e30)],
)
def test_numbers_out_of_range_are_malformed(field: str, value: float) -> None:
    outgoing = message()
    outgoing[field] = value
    assert fate(DatagramFilter(1), pack(outgoing, 1, 9)) == "malformed"


def test_end_of_the_peer_is_detected() -> None:
    filter_ = DatagramFilter(1)
    filter_.accept(pack(message(), 1, 9, ends=True), records(1, MESSAGE)[0])
    assert filter_.ended
