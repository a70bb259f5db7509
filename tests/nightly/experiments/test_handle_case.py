"""The handle where it fails: learning is of use, given up or of harm; stops are met, and then no more."""

from pathlib import Path

import pytest

from hapscene.handle.handle_record import LATE_S
from hapscene_experiments.handle_case import (
    draw_handle_limits,
    handle_cases,
    harm,
    hits_after,
    knocks,
    later_than_believed_s,
    travel_ratio,
)


def test_answers() -> None:
    for answer in handle_cases():
        assert answer.ok, answer


@pytest.mark.parametrize(("late_s", "bandwidth"), [(0.0002, 1.0), (0.0, 0.25), (0.0004, 1.0), (0.0002, 0.5)])
def test_what_is_given_up_is_what_is_later_than_the_bound(late_s: float, bandwidth: float) -> None:
    assert (harm(late_s, bandwidth) > 0.5) == (later_than_believed_s(late_s, bandwidth) > 3.0 * LATE_S)


@pytest.mark.parametrize("size_m_s2", [10.0, 50.0])
def test_knocks_that_go_on_take_the_travel_away(size_m_s2: float) -> None:
    """Where the nominal handle's coil would be far from its stops, the real one's meets them in each half cycle."""
    assert hits_after(0.0, 0.3, size_m_s2=size_m_s2) > 5
    assert hits_after(1.0, 2.0, size_m_s2=size_m_s2) < 25


def test_a_handle_as_believed_meets_no_stop() -> None:
    assert travel_ratio(30.0, 0.0) == 1.0
    assert knocks(30.0, off=0.0, each=64) == 0.0 < knocks(30.0, off=0.3, each=8)


def test_chart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, few in (("LATE_S", (0.0, 0.001)), ("BANDWIDTHS", (0.5, 1.0)), ("FREQUENCIES_HZ", (30.0,))):
        monkeypatch.setattr(f"hapscene_experiments.handle_case.{name}", few)
    draw_handle_limits(tmp_path / "handle.png")
    assert (tmp_path / "handle-dark.png").read_bytes().startswith(b"\x89PNG")
