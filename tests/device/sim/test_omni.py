"""The Omni as a device: frames, encoders, motors, structure."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hapscene.device.sim.hand import HAND
from hapscene.device.sim.omni import Omni, advance_omni, hold_omni, read_omni, stand, tip_omni, tip_velocity_omni
from hapscene.device.sim.omni_kinematics import NOMINAL_RAD, forward, jacobian
from hapscene.device.sim.omni_record import OmniFlag
from hapscene.errors import HapsceneError
from hapscene.records import records

ORIGIN = (0.0, 0.0, 0.0)
EXACT = Omni(friction_N=0.0, damping_Ns_m=0.0, resolution_m=0.0, gravity=False)


def hand(**fields: Any) -> Any:
    row = records(1, HAND)
    for name, value in fields.items():
        row[name] = value
    return row


poses = st.tuples(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-5, 5)] * 3))
offsets = st.tuples(st.floats(-0.08, 0.08), st.floats(-0.06, 0.06), st.floats(-0.035, 0.035))


@settings(deadline=None)
@given(poses, offsets)
def test_arm_starts_at_the_given_position_and_pose(pose: Any, offset: tuple[float, ...]) -> None:
    X_WD = np.eye(4)
    X_WD[:3, :3], X_WD[:3, 3] = Rotation.from_rotvec(pose[0]).as_matrix(), pose[1]
    p_WT = X_WD[:3, :3] @ (forward(NOMINAL_RAD) + offset) + X_WD[:3, 3]
    omni = Omni().record(p_WT, X_WD)
    assert tip_omni(omni[0]) == pytest.approx(p_WT, abs=1e-12)
    error_m = np.linalg.norm(np.array(read_omni(omni[0])) - p_WT)
    assert error_m < 0.5 * 1.05 * math.hypot(0.0694e-3, 0.055e-3, 0.055e-3)  # half a count of each joint


def test_stand_has_the_user_in_front_and_up_above() -> None:
    X_WD = stand((1.0, 2.0, 3.0))
    assert X_WD[:3, :3] @ np.eye(3) == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]))
    assert tip_omni(Omni().record((1.0, 2.0, 3.0))[0]) == pytest.approx((1.0, 2.0, 3.0))


@settings(deadline=None, max_examples=30)
@given(poses, st.tuples(*[st.floats(-1, 1)] * 3), offsets)
def test_motors_do_the_work_of_the_force_they_are_asked_for(
    pose: Any, force: tuple[float, ...], offset: tuple[float, ...]
) -> None:
    """τ · q̇ = f · v for every motion, in every pose of the device."""
    X_WD = np.eye(4)
    X_WD[:3, :3], X_WD[:3, 3] = Rotation.from_rotvec(pose[0]).as_matrix(), pose[1]
    p_WT = X_WD[:3, :3] @ (forward(NOMINAL_RAD) + offset) + X_WD[:3, 3]
    omni = Omni(resolution_m=0.0, gravity=False, peak_N=100.0).record(p_WT, X_WD)
    hold_omni(omni[0], *force)
    for dq in np.eye(3):
        v_W = X_WD[:3, :3] @ jacobian(omni.q[0]) @ dq
        assert omni.torque_Nm[0] @ dq == pytest.approx(np.dot(force, v_W), abs=1e-12)


@settings(deadline=None, max_examples=30)
@given(poses, st.tuples(*[st.floats(-5, 5)] * 3))
def test_hand_values_are_in_the_world_frame(pose: Any, push: tuple[float, ...]) -> None:
    """In any pose of the device the tool, heavy with a hand of 1 kg, starts along push, spring and damper together."""
    X_WD = np.eye(4)
    X_WD[:3, :3], X_WD[:3, 3] = Rotation.from_rotvec(pose[0]).as_matrix(), pose[1]
    p_WT = X_WD[:3, :3] @ forward(NOMINAL_RAD) + X_WD[:3, 3]
    away_m, rate_m_s = np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.2, -0.3])
    omni = Omni().record(p_WT, X_WD)
    holder = hand(k_N_m=50.0, b_Ns_m=2.0, mass_kg=1.0, target_m=p_WT + away_m, target_m_s=rate_m_s, push_N=push)
    advance_omni(omni[0], holder[0], 1e-6)
    force_N = np.array(push) + 50.0 * away_m + 2.0 * rate_m_s
    assert tip_velocity_omni(omni[0]) == pytest.approx(force_N * 1e-6 / 1.0079, rel=1e-3, abs=1e-10)
    assert holder.target_m[0] == pytest.approx(p_WT + away_m + rate_m_s * 1e-6, abs=1e-15)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_deflection_at_rest_is_force_over_stiffness(axis: int) -> None:
    """Motors hold what the hand pushes: the encoders see nothing, the tool gives by f/k of the data sheet."""
    omni = Omni().record(forward(NOMINAL_RAD), np.eye(4))
    push = np.zeros(3)
    push[axis] = -1.0
    pusher = hand(push_N=push, b_Ns_m=5.0)
    for k in range(600):
        hold_omni(omni[0], *(-push * min(1.0, k / 100)))
        pusher.push_N = push * min(1.0, k / 100)
        advance_omni(omni[0], pusher[0], 1e-3)
    given_m = forward(omni.q[0])[axis] - tip_omni(omni[0])[axis]
    assert given_m == pytest.approx(1.0 / (1260.0, 2310.0, 1020.0)[axis], rel=1e-6)
    assert np.array_equal(omni.dq[0], np.zeros(3))
    assert np.linalg.norm(np.array(read_omni(omni[0])) - forward(NOMINAL_RAD)) < 2e-4


def test_tool_rings_at_the_resonance_and_dies_away_at_its_damping() -> None:
    model = Omni(friction_N=0.0, damping_Ns_m=0.0, gravity=False)
    omni = model.record(ORIGIN)
    known_Hz = np.array(model.stiffness_N_m) * model.damping_ratio / (np.pi * omni.damping_Ns_m[0])
    omni.v_DT_m_s = (0.01, 0.0, 0.0)
    no_hand, stretch = hand(), []
    for _ in range(1000):
        stretch.append(omni.p_DT_m[0, 0] - forward(omni.q[0])[0])
        advance_omni(omni[0], no_hand[0], 1e-4)
    signs = np.sign(stretch[1:])
    turns = np.flatnonzero(np.diff(signs))
    measured_Hz = 0.5 * (len(turns) - 1) / ((turns[-1] - turns[0]) * 1e-4)
    assert measured_Hz == pytest.approx(known_Hz[0], rel=0.03)
    size = np.abs(stretch)
    peaks = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    decay_s = -np.polyfit(peaks * 1e-4, np.log(size[peaks]), 1)[0]
    assert decay_s == pytest.approx(0.05 * 2.0 * math.pi * measured_Hz, rel=0.05)  # ζω
    assert known_Hz == pytest.approx([66.0, 90.8, 61.5], abs=0.1)


def test_full_force_in_the_nominal_posture_is_the_data_sheet_s() -> None:
    """3.3 N along each joint's way, and not more."""
    for way in jacobian(NOMINAL_RAD).T:
        omni = Omni(gravity=False, resolution_m=0.0).record(forward(NOMINAL_RAD), np.eye(4))
        way = way / np.linalg.norm(way)
        hold_omni(omni[0], *(3.299 * way))
        assert not omni.trouble[0] & OmniFlag.TORQUE_LIMITED
        for most_N in (50.0, 1.7e308):
            hold_omni(omni[0], *(most_N * way))
            assert omni.trouble[0] & OmniFlag.TORQUE_LIMITED
            made_N = np.linalg.solve(jacobian(omni.q[0]).T, omni.torque_Nm[0])
            assert made_N == pytest.approx(3.3 * way, abs=1e-9)


def test_motors_warm_as_a_single_node_and_come_down_to_the_continuous_force() -> None:
    """I²R with one time constant: warm at −τ ln(1 − 0.9/(3.3/0.88)²), and 0.88 N in the end."""
    omni = Omni(gravity=False, resolution_m=0.0).record(forward(NOMINAL_RAD), np.eye(4))
    way = jacobian(NOMINAL_RAD)[:, 2] / np.linalg.norm(jacobian(NOMINAL_RAD)[:, 2])
    forces, heats = [], []
    for _ in range(6000):  # only the motors' clock runs
        hold_omni(omni[0], *(3.3 * way))
        forces.append(float(np.linalg.norm(np.linalg.solve(jacobian(omni.q[0]).T, omni.torque_Nm[0]))))
        heats.append(float(omni.heat[0, 2]))
        omni.held_s = 0.1
    warm = int(np.argmax(np.array(forces) < 3.29)) * 0.1
    assert warm == pytest.approx(-60.0 * math.log(1.0 - 0.9 / (3.3 / 0.88) ** 2), abs=0.21)
    t = np.arange(30) * 0.1
    assert heats[:30] == pytest.approx((3.3 / 0.88) ** 2 * (1.0 - np.exp(-t / 60.0)))
    assert max(heats) <= 1.0 + 1e-9
    assert forces[-1] == pytest.approx(0.88, rel=0.01)
    assert omni.trouble[0] & OmniFlag.HOT
    assert np.abs(np.diff(forces)).max() < 0.6  # comes down over seconds


def test_compensated_gravity_holds_the_arm_without_friction() -> None:
    """As exactly as the encoders tell the posture: within 30 µm after a tenth of a second; without it, it falls."""
    fallen = []
    for compensated in (True, False):
        omni = Omni(friction_N=0.0, gravity_compensated=compensated).record(ORIGIN)
        no_hand = hand()
        for _ in range(100):
            hold_omni(omni[0], 0.0, 0.0, 0.0)
            advance_omni(omni[0], no_hand[0], 1e-3)
        fallen.append(float(np.linalg.norm(tip_omni(omni[0]))))
    assert fallen[0] < 3e-5
    assert fallen[1] > 5e-3


def test_nan_force_counts_as_zero() -> None:
    omni = EXACT.record(ORIGIN)
    hold_omni(omni[0], 0.0, math.nan, 0.0)
    assert omni.trouble[0] == OmniFlag.FORCE_NOT_FINITE
    assert np.array_equal(omni.torque_Nm[0], np.zeros(3))
    hold_omni(omni[0], 0.0, 0.0, 1.0)
    assert omni.trouble[0] == 0


@pytest.mark.parametrize(("push_N", "flagged"), [(90.0, False), (150.0, True)])
def test_hand_force_above_the_limit_is_flagged(push_N: float, flagged: bool) -> None:
    omni = EXACT.record(ORIGIN)
    advance_omni(omni[0], hand(push_N=(push_N, 0.0, 0.0))[0], 1e-3)
    assert bool(omni.trouble[0] & OmniFlag.HAND_LIMITED) is flagged


def test_singular_posture_is_flagged() -> None:
    omni = EXACT.record(ORIGIN)
    omni.q = (0.0, 1.75, 3.0)
    hold_omni(omni[0], 1.0, 0.0, 0.0)
    assert omni.trouble[0] & OmniFlag.SINGULAR


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"tool_kg": 0.0}, "tool_kg"),
        ({"friction_N": -0.1}, "friction_N"),
        ({"friction_N": math.nan}, "friction_N"),
        ({"stiffness_N_m": (1.0, 2.0)}, "stiffness_N_m"),
        ({"continuous_N": 5.0}, "continuous_N"),
    ],
)
def test_a_value_out_of_range_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(HapsceneError, match=message):
        Omni(**fields)


def test_a_start_out_of_reach_is_refused_with_the_workspace() -> None:
    with pytest.raises(HapsceneError, match=r"\(1\.000, 0\.000, 0\.000\).*\(0\.000, 0\.101, 0\.187\)"):
        Omni().record((1.0, 0.0, 0.0), np.eye(4))


@pytest.mark.parametrize("X_WD", [np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0]), np.full((4, 4), np.nan), 2.0 * np.eye(4)])
def test_an_invalid_pose_is_refused(X_WD: Any) -> None:
    with pytest.raises(HapsceneError, match="X_WD: "):
        Omni().record(ORIGIN, X_WD)
