"""One tick of leader and follower: acceleration of the tip, filters, motion by vibration."""

import math

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.device.sim.point import PointMass
from hapscene.handle.handle_dynamics import grip_handle
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Plant
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.leader_follower import (
    ACCELEROMETER_CORNER_HZ,
    VIBRATION_CORNER_HZ,
    Leader,
    high_pass,
    move_by_vibration,
    new_leader,
    new_tool,
    set_hand,
    tip_acceleration,
)

DEVICE = PointMass(0.05, 0.1, 0.1, 55e-6)
H_S = 1.0 / ACCELERATION_RATE_HZ


def test_acceleration_is_the_second_difference_along_the_handle() -> None:
    """Exact in free fall; motion across the handle has no effect."""
    axis = np.array([2.0, -1.0, 3.0])
    unit, across = axis / np.linalg.norm(axis), np.cross(axis, (1.0, 0.0, 0.0))
    start = np.array([0.1, 0.2, 0.3])
    tool = new_tool(start, axis)
    found = []
    for k in range(1, 20):
        t_s = k * H_S
        p = start + 0.5 * 9.81 * t_s**2 * unit + 3.0 * t_s * across
        found.append(tip_acceleration(tool[0], tuple(p), H_S))
    assert found[1:] == pytest.approx([9.81] * 18, rel=1e-4)


def test_high_pass_is_a_second_order_butterworth_filter() -> None:
    tool, rng = new_tool((0.0, 0.0, 0.0)), np.random.default_rng(0)
    a_m_s2 = rng.normal(size=2000)
    received = [high_pass(tool[0], a, H_S) for a in a_m_s2]
    b, a = butter(2, ACCELEROMETER_CORNER_HZ, "high", fs=ACCELERATION_RATE_HZ)
    np.testing.assert_allclose(received, lfilter(b, a, a_m_s2), rtol=1e-6, atol=1e-9)


def test_displacement_by_vibration() -> None:
    """A sine at f moves the tool by a/(2πf)²; a constant acceleration by a/(2πf_c)²."""
    tool, f_Hz = new_tool((0.0, 0.0, 0.0))[0], 200.0
    way = []
    for k in range(int(0.5 / H_S)):
        move_by_vibration(tool, math.sin(2.0 * math.pi * f_Hz * k * H_S), H_S)
        way.append(tool.vibration_m)
    assert np.ptp(way[-1000:]) / 2 == pytest.approx(1.0 / (2.0 * math.pi * f_Hz) ** 2, rel=0.02)
    tool = new_tool((0.0, 0.0, 0.0))[0]
    for _ in range(int(1.0 / H_S)):
        move_by_vibration(tool, 1.0, H_S)
    assert tool.vibration_m == pytest.approx(1.0 / (2.0 * math.pi * VIBRATION_CORNER_HZ) ** 2, rel=1e-6)


def make_leader() -> Leader:
    handle = new_handle(Plant(), Plant(), "inverse", ACCELERATION_RATE_HZ)
    return new_leader(DEVICE, handle, Coupling(), (0.0, 0.0, 0.0))


def test_hand_moves_linearly_between_rows_and_stops_after_the_last() -> None:
    leader = make_leader()
    path = np.array([[0.0, 0.0, 0.0], [1e-3, -2e-3, 3e-3], [1e-3, -2e-3, 4e-3]])
    grip = np.array([[100.0, 1.0, 0.01], [100.0, 2.0, 0.02], [300.0, 2.0, 0.03]])
    push = np.arange(9.0).reshape(3, 3)
    hand = leader.arm.hand[0]
    for k, speed in enumerate(((1.0, -2.0, 3.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))):
        set_hand(leader, path, grip, push, k)
        assert hand.target_m.tolist() == path[k].tolist() and hand.push_N.tolist() == push[k].tolist()
        assert hand.target_m_s == pytest.approx(speed)
        assert (hand.k_N_m, hand.b_Ns_m, hand.mass_kg) == tuple(grip[k])
        gripped = make_leader().handle
        grip_handle(gripped[0], grip[k, 0], grip[k, 1])
        assert leader.handle.tobytes() == gripped.tobytes()
