"""Flags of a tick."""

from hapscene.flags import Flag


def test_each_flag_is_a_bit_of_its_own() -> None:
    assert list(map(int, Flag.__members__.values())) == [1 << k for k in range(len(Flag.__members__))]
