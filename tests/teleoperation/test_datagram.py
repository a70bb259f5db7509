"""The datagram: what goes in comes out, and nothing else comes in."""

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
    told = records(1, MESSAGE)[0]
    told.tick, told.echo = tick, max(tick - 3, -1)
    told.p_WT_m, told.v_WT_m_s, told.wave_sqrtJs = (0.1, -0.2, 1e-9), (1.0, 2.0, -3.0), (0.5, -1e-17, 3.0)
    told.wave_J = 0.25
    told.a_m_s2 = np.linspace(-40.0, 40.0, 10).astype(np.float32)
    return told


def fate(filter_: DatagramFilter, data: bytes) -> str:
    """What becomes of a datagram."""
    before = dict(filter_.counts)
    filter_.accept(data, records(1, MESSAGE)[0])
    (name,) = (name for name, count in filter_.counts.items() if count != before[name])
    return name


def checked(body: bytes) -> bytes:
    return body + struct.pack("<I", zlib.crc32(body))


def test_what_is_packed_comes_out_to_the_bit() -> None:
    told, heard = message(), records(1, MESSAGE)[0]
    data = pack(told, 1, 99)
    assert len(data) == SIZE
    assert DatagramFilter(1).accept(data, heard)
    assert heard.tobytes() == told.tobytes()


@given(st.binary(max_size=2 * SIZE))
def test_no_bytes_from_strangers_are_let_in_or_raise(data: bytes) -> None:
    assert fate(DatagramFilter(1), data) == "malformed"


@given(st.binary(min_size=SIZE - 16, max_size=SIZE - 16))
def test_bytes_with_a_right_head_and_check_are_let_in_only_if_sane(rest: bytes) -> None:
    heard = records(1, MESSAGE)[0]
    filter_ = DatagramFilter(1)
    if filter_.accept(checked(pack(message(), 1, 99)[:12] + rest), heard):
        numbers = np.concatenate([np.ravel(heard[name]) for name in MESSAGE.names])
        assert np.isfinite(numbers).all() and heard.tick >= 0
        assert np.abs(heard.p_WT_m).max() <= 10.0


@given(st.integers(0, 8 * SIZE - 1))
def test_one_flipped_bit_is_found(bit: int) -> None:
    data = bytearray(pack(message(), 1, 99))
    data[bit // 8] ^= 1 << bit % 8
    assert fate(DatagramFilter(1), bytes(data)) == "malformed"


def test_another_session_role_or_version_is_foreign() -> None:
    filter_ = DatagramFilter(1)
    assert fate(filter_, pack(message(1), 1, 99)) == "accepted"
    assert fate(filter_, pack(message(2), 1, 98)) == "foreign"
    assert fate(filter_, pack(message(2), 0, 99)) == "foreign"
    assert fate(filter_, pack(message(2), 1, 99, scheme=0)) == "foreign" and not filter_.mismatched
    body = bytearray(pack(message(2), 1, 99)[:-4])
    body[4] += 1
    assert fate(filter_, checked(bytes(body))) == "foreign"
    assert fate(filter_, pack(message(2), 1, 99)) == "accepted"


def test_a_peer_tied_by_another_scheme_is_known() -> None:
    filter_ = DatagramFilter(1)
    assert fate(filter_, pack(message(), 1, 99, scheme=0)) == "foreign"
    assert filter_.mismatched


def test_twice_is_once_and_long_ago_is_too_late() -> None:
    filter_ = DatagramFilter(1)
    for tick in (5, 4, 6 + SEEN):
        assert fate(filter_, pack(message(tick), 1, 9)) == "accepted"
    assert fate(filter_, pack(message(6 + SEEN), 1, 9)) == "duplicate"
    assert fate(filter_, pack(message(6), 1, 9)) == "late"
    assert fate(filter_, pack(message(7), 1, 9)) == "accepted"
    assert fate(filter_, pack(message(7 + SEEN + AHEAD_MAX), 1, 9)) == "foreign"


@pytest.mark.parametrize(
    ("field", "value"),
    [("p_WT_m", math.nan), ("v_WT_m_s", math.inf), ("wave_sqrtJs", 1e30), ("wave_J", -1e30), ("a_m_s2", 1e30)],
)
def test_numbers_out_of_range_are_malformed(field: str, value: float) -> None:
    told = message()
    told[field] = value
    assert fate(DatagramFilter(1), pack(told, 1, 9)) == "malformed"


def test_the_last_word_is_heard() -> None:
    filter_ = DatagramFilter(1)
    filter_.accept(pack(message(), 1, 9, ends=True), records(1, MESSAGE)[0])
    assert filter_.ended
