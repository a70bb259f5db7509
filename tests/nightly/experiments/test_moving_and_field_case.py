"""What moves under the tool, and fields: their closed forms, and that they can be missed."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.constants import TICK_S
from hapscene.device.model import limits_of
from hapscene_experiments.field_case import balance, draw_fields, field_cases, hum, hum_m
from hapscene_experiments.moving_case import STIFFNESS_N_M, draw_moving, flown_through, force_under, moving_cases


@pytest.mark.parametrize("cases", [moving_cases, field_cases])
def test_answers(cases) -> None:
    for answer in cases():
        assert answer.ok, answer


def test_what_is_made_under_a_cut_force_is_taken_back() -> None:
    """Also what encoder steps would excuse elsewhere: where the force is cut it does not change with them."""
    limits = limits_of("omni", TICK_S)
    _, made_J = flown_through(2.0, limits)
    assert made_J < 0.7 * STIFFNESS_N_M * (2.0 * TICK_S) ** 2


def test_a_wall_that_stands_makes_no_step() -> None:
    assert np.ptp(force_under(np.full(20, 1e-3))[1:]) == 0.0


def test_a_magnet_hums_from_its_limit_on_and_throws_out_at_last() -> None:
    assert balance(1e-3) == pytest.approx(1.0, abs=1e-5) and balance(1.0) == pytest.approx(3.2)
    assert hum_m(0.9) == 0.0 and np.isnan(hum_m(3.3))
    assert hum(0.5) < 1e-4


def test_charts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene_experiments.field_case.critical", lambda *_: 100.0)
    monkeypatch.setattr("hapscene_experiments.field_case.hum", lambda _: 5e-3)
    monkeypatch.setattr("hapscene_experiments.moving_case.chatter_ratio", lambda _: 2.0)
    monkeypatch.setattr("hapscene_experiments.moving_case.flown_through", lambda *_: (1e-3, 1e-3))
    monkeypatch.setattr("hapscene_experiments.moving_case.stalled", lambda *_: (np.arange(40.0), 20))
    for name, draw in (("fields", draw_fields), ("moving", draw_moving)):
        draw(tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}-dark.png").read_bytes().startswith(b"\x89PNG")
