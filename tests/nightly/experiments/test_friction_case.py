"""Friction in closed loop: the answers of the reference, and that they can be missed."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.device.point import PointMass
from hapscene_experiments.friction_case import (
    STICK_NS_M,
    dragged,
    draw_friction,
    loop_area,
    no_drift,
    period_and_amplitude,
    rest_of_omni,
    slid,
    stick_slip,
    stop,
)


@pytest.mark.parametrize("cases", [loop_area, stick_slip, no_drift, stop, rest_of_omni])
def test_answers(cases) -> None:
    answers = cases()
    assert answers
    for answer in answers:
        assert answer.ok, answer


def test_periods_of_stick_and_slip_are_alike() -> None:
    period_s, _ = period_and_amplitude()
    t_s, stretch_m = dragged(3.5 * period_s)
    second = np.flatnonzero((t_s > 1.5 * period_s) & (t_s < 2.4 * period_s))
    later = second + round(period_s / (t_s[1] - t_s[0]))
    assert np.abs(stretch_m[second] - stretch_m[later]).max() < 0.02 * np.ptp(stretch_m)


def test_without_own_friction_only_a_damped_adhesion_rests() -> None:
    """A bare spring of adhesion rings for ever on a device that has less damping than k_t T/2: it feeds the swing."""
    bare, damped = (slid(PointMass(0.045, 0.1), 0.2, b)[0].v_W_m_s[-100:, 0] for b in (0.0, STICK_NS_M))
    assert np.abs(bare).max() > 0.03
    assert np.abs(damped).max() < 1e-9


def test_chart(tmp_path: Path) -> None:
    draw_friction(tmp_path / "friction.png")
    assert (tmp_path / "friction.png").read_bytes().startswith(b"\x89PNG")
