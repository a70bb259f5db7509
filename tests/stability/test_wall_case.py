"""The cases with known answers, through the real tick; and that they would show a tick that is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.stability.closed_form import limit_of_passivity, peak_speed, restitution
from hapscene.stability.rig import Rig
from hapscene.stability.wall_case import bounce, own_cases, passivity_limit, read_cases, run_case, wall_cases
from hapscene.stability.wall_case import peak_speed as found_speed


@pytest.mark.nightly
def test_all_cases_of_the_reference(shared: Path) -> None:
    cases = read_cases(shared / "reference" / "wall_cases.json")
    assert len(cases) == 45
    rows = [row for case in cases for row in run_case(case)]
    assert [(row.id, row.found, row.expected) for row in rows if not row.ok] == []


@pytest.mark.nightly
def test_cases_of_the_table() -> None:
    rows = list(own_cases())
    assert {row.id[:2] for row in rows} == {"W4", "W5", "W6"}
    assert [(row.id, row.found, row.expected) for row in rows if not row.ok] == []


def test_passivity_counts_wall_damping() -> None:
    """Colgate & Schenkel: damping of the wall costs stiffness."""
    setup = {"m": 0.05, "b": 0.5, "T": 1e-3, "B": 0.2}
    assert passivity_limit(setup) == pytest.approx(limit_of_passivity(0.5, 0.2, 1e-3), rel=1e-6)


def test_speed_with_delay_and_wall_damping() -> None:
    setup = {"m": 0.1, "b": 0.05, "c": 0.1, "T": 5e-4, "K": 800.0, "B": 0.1, "delay": 1}
    assert found_speed(setup) == pytest.approx(peak_speed(0.1, 800.0, 5e-4, 0.05, 0.1, 1), rel=0.05)


def test_bounce_with_damping() -> None:
    setup = {"m": 0.1, "b": 0.2, "T": 2e-4, "K": 1000.0, "B": 0.5, "delay": 0}
    assert bounce(setup) == pytest.approx(restitution(0.1, 1000.0, 2e-4, 0, 0.2, 0.5), rel=0.02)


def test_friction_stops_small_motion_at_any_wall() -> None:
    """Why the critical stiffness is infinite with friction and exact encoders."""
    rig = Rig(PointMass(0.05, 0.0, 0.1), 1e-3, 1)
    for stiffness in (1e3, 1e4, 1e5):
        rig.tune(stiffness)
        felt = rig.let_go(1e-2, 1e-6, stiffness * 1e-2, 500)
        assert (felt.v_W_m_s[-100:, 2] == 0.0).all()


def test_the_tool_is_let_go_where_and_as_asked() -> None:
    rig = Rig(PointMass(0.05, 0.3), 1e-3)
    rig.tune(500.0)
    felt = rig.let_go(0.02, 0.4, 10.0, 4)
    assert -felt.p_W_m[0, 2] == pytest.approx(0.0204, rel=1e-3)  # a tick after
    assert -felt.v_W_m_s[0, 2] == pytest.approx(0.4, rel=2e-2)
    np.testing.assert_array_equal(felt.f_hand_W_N[:, 2], -10.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "list of cases"),
        ('[{"id": "W1"}]', "case 0 must have"),
        ('[{"id": "X9", "what": "", "setup": {}, "expected": 1, "rel_tol": 1}]', "'X9'"),
        ("[", "not a list of wall cases"),
    ],
)
def test_no_cases(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "cases.json").write_text(text)
    with pytest.raises(HapsceneError, match=said):
        wall_cases(tmp_path / "cases.json")


def test_a_wrong_answer_is_not_ok() -> None:
    case = {"id": "W1-x", "what": "K", "setup": {"m": 0.05, "b": 0.1, "T": 1e-3, "delay": 0, "B": 0}, "rel_tol": 1e-3}
    (row,) = run_case(json.loads(json.dumps(case)) | {"expected": 201.0})
    assert not row.ok
    assert row.found == pytest.approx(200.0667, rel=1e-5)


CASE = {
    "id": "W7-x",
    "what": "speed",
    "rel_tol": 0.1,
    "expected": 0.1,
    "setup": {"m": 0.1, "b": 0.05, "c": 0.1, "T": 5e-4, "K": 800.0},
}


@pytest.mark.parametrize(
    "change",
    [
        {"id": 7},
        {"id": "X1"},
        {"what": None},
        {"setup": [1]},
        {"setup": {"m": 0.1}},
        {"setup": CASE["setup"] | {"c": 0.0}},
        {"setup": CASE["setup"] | {"m": "0.1"}},
        {"setup": CASE["setup"] | {"T": -1.0}},
        {"setup": CASE["setup"] | {"K": 1e300}},
        {"expected": {"alpha": 1.0}},
        {"rel_tol": True},
        {"id": "W5-apex-d0", "setup": {"delay": 0}},
        {"id": "W5-apex-d0", "setup": {}, "expected": {"alpha": 1.0, "beta": 1.0}},
    ],
)
def test_a_case_that_is_none(change: dict[str, object], tmp_path: Path) -> None:
    file = tmp_path / "cases.json"
    file.write_text(json.dumps([CASE]))
    assert len(read_cases(file)) == 1
    file.write_text(json.dumps([CASE | change]))
    with pytest.raises(HapsceneError, match=r"cases.json"):
        read_cases(file)
