"""A tick of each end, and the tool at its tip: acceleration, what of it is heard, how vibration moves it."""

import math

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.sim.point import PointMass
from hapscene.handle.handle_dynamics import grip_handle
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.loop.hand_intent import Intent
from hapscene.records import records
from hapscene.render.renderer import Renderer
from hapscene.teleoperation.bilateral_loop import TICK_RECORD, Line, operate, receive, step_follower, step_leader
from hapscene.teleoperation.datagram import MESSAGE
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.leader_follower import (
    ACCELEROMETER_CORNER_HZ,
    VIBRATION_CORNER_HZ,
    Follower,
    Leader,
    tip_acceleration,
    high_pass,
    set_hand,
    new_follower,
    new_leader,
    new_tool,
    move_by_vibration,
)
from hapscene.teleoperation.link import Impairment, Link, new_link
from hapscene.teleoperation.operation import UP, follower_renderer
from hapscene.teleoperation.plate import plate

DEVICE = PointMass(0.05, 0.1, 0.1, 55e-6)
H_S = 1.0 / ACCELERATION_RATE_HZ


def test_acceleration_is_the_second_difference_along_the_handle() -> None:
    """Exact for what falls freely; what moves across the handle is not seen."""
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


def test_the_accelerometer_is_heard_through_a_butterworth_of_second_order() -> None:
    tool, rng = new_tool((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), np.random.default_rng(0)
    a_m_s2 = rng.normal(size=2000)
    heard = [high_pass(tool[0], a, H_S) for a in a_m_s2]
    b, a = butter(2, ACCELEROMETER_CORNER_HZ, "high", fs=ACCELERATION_RATE_HZ)
    np.testing.assert_allclose(heard, lfilter(b, a, a_m_s2), rtol=1e-6, atol=1e-9)


def test_vibration_moves_the_tool_as_its_double_integral_above_the_corner() -> None:
    """A sine at f moves it by a/(2πf)²; a constant acceleration ends up nowhere far: a/(2πf_c)²."""
    tool, f_Hz = new_tool((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))[0], 200.0
    way = []
    for k in range(int(0.5 / H_S)):
        move_by_vibration(tool, math.sin(2.0 * math.pi * f_Hz * k * H_S), H_S)
        way.append(tool.vibration_m)
    assert np.ptp(way[-1000:]) / 2 == pytest.approx(1.0 / (2.0 * math.pi * f_Hz) ** 2, rel=0.02)
    tool = new_tool((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))[0]
    for _ in range(int(1.0 / H_S)):
        move_by_vibration(tool, 1.0, H_S)
    assert tool.vibration_m == pytest.approx(1.0 / (2.0 * math.pi * VIBRATION_CORNER_HZ) ** 2, rel=1e-6)


def make_leader() -> Leader:
    handle = new_handle(Plant(), Plant(), "inverse", ACCELERATION_RATE_HZ)
    return new_leader(DEVICE, handle, Coupling(), (0.0, 0.0, 0.0), UP)


def test_the_hand_moves_on_straight_between_ticks_and_is_still_after_the_last() -> None:
    leader = make_leader()
    path = np.array([[0.0, 0.0, 0.0], [1e-3, -2e-3, 3e-3], [1e-3, -2e-3, 4e-3]])
    grip = np.array([[100.0, 1.0, 0.01], [200.0, 2.0, 0.02], [300.0, 3.0, 0.03]])
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


# Two ends of their own, as two processes have them, live through what they live through in one loop.


def make_ends() -> tuple[Leader, Follower, Link, Link, Renderer]:
    """Both, and lines that lose; the renderer must live as long."""
    leader, renderer = make_leader(), follower_renderer(plate("wood"))
    follower = new_follower(renderer, DEVICE, Coupling(), (0.0, 0.0, 1e-5), UP)
    return leader, follower, *(new_link(Impairment(loss=0.2), TICK_S, 3, name) for name in ("forth", "back")), renderer


def test_apart_both_ends_do_what_they_do_in_one_loop() -> None:
    count, first = 30, 5
    intent = Intent.hold((0.002, 0.0, -0.02), count, "medium", push_W_N=(0.0, 0.0, -0.5))
    hand = (intent.target_W_m, intent.grip, intent.push_W_N)
    leader, follower, forth, back, _renderer = make_ends()
    rows = records(count, TICK_RECORD)
    operate(leader, follower, Line(forth, back, records(1, MESSAGE)), first, hand, rows)
    samples = rows.a_follower_m_s2, rows.a_tip_m_s2, rows.a_handle_m_s2
    assert rows.touching.any() and np.abs(rows.f_leader_W_N).max() > 0.01
    assert all(part.any() for part in samples) and forth.line[0].lost > 0 and back.line[0].lost > 0

    leader, follower, forth, back, _another = make_ends()
    message = records(1, MESSAGE)
    for k in range(count):
        assert rows.leader_W_m[k].tolist() == leader.arm.point[0].x_m.tolist()
        assert rows.follower_W_m[k].tolist() == follower.arm.point[0].x_m.tolist()
        for end, link in ((leader.end, back), (follower.end, forth)):
            receive(end, link, first + k, message)
        step_leader(leader, hand, k, forth, first + k)
        step_follower(follower, back, first + k)
        assert rows.f_leader_W_N[k].tolist() == leader.arm.point[0].f_N.tolist()
        assert rows.f_follower_W_N[k].tolist() == follower.arm.point[0].f_N.tolist()
        assert rows.f_contact_W_N[k].tolist() == follower.row[0].f_W_N.tolist()
        ends = (follower.read_m_s2, leader.tip_m_s2, leader.handle_m_s2)
        assert [part[k].tolist() for part in samples] == [part.tolist() for part in ends]
