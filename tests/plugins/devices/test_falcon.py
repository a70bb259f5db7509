"""The Falcon's driver against a Falcon at the wire, and its geometry against another way to solve it."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from hapscene_plugins.devices.falcon_board import REST, encoder_count, is_packet, pack
from hapscene_plugins.devices.falcon_kinematics import (
    COUNT_RAD,
    LEG,
    MIDDLE_M,
    TURN,
    UNIT_MAX,
    ZERO_RAD,
    forward,
    motor_units,
)

START = (0.0, 0.0, MIDDLE_M)


def angles(p: np.ndarray) -> np.ndarray:
    """(3,) of the legs at a place in F: inverse kinematics, in closed form."""
    a, b, c, links, f, r, s = LEG
    found = []
    for cos, sin in TURN:
        u, v, w = cos * p[0] + sin * p[1] - r + c, -sin * p[0] + cos * p[1] - s + f, p[2]
        rho = links + math.sqrt(b * b - v * v)
        # a knee at (a cos θ, a sin θ), ρ from (u, w): u cos θ + w sin θ = (u² + w² + a² − ρ²)/2a
        size = math.hypot(u, w)
        found.append(math.atan2(w, u) - math.acos((u * u + w * w + a * a - rho * rho) / (2 * a * size)))
    return np.array(found)


def places(count: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.array((0.0, 0.0, 0.12)) + rng.uniform(-0.04, 0.04, (count, 3))


def test_forward_kinematics_are_those_of_the_loops_closing() -> None:
    """All nine unknowns at once: the grip, and of each shin how it is inclined and turned."""
    a, b, c, links, f, r, s = LEG

    def gaps(x: np.ndarray, theta: np.ndarray) -> np.ndarray:
        out = []
        for (cos, sin), angle, incline, skew in zip(TURN, theta, x[3:6], x[6:9], strict=True):
            reach = links + b * math.sin(skew)
            out += [
                cos * x[0] + sin * x[1] - r - (a * math.cos(angle) - c + reach * math.cos(incline)),
                -sin * x[0] + cos * x[1] - s - (b * math.cos(skew) - f),
                x[2] - (a * math.sin(angle) + reach * math.sin(incline)),
            ]
        return np.array(out)

    for p in places(20):
        theta = angles(p)
        solved = least_squares(
            gaps, (0, 0, 0.11, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5), args=(theta,), xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        found = forward(tuple(theta.tolist()), START)
        assert np.abs(solved.fun).max() < 1e-9
        np.testing.assert_allclose(found, solved.x[:3], atol=1e-7)


def test_inverse_then_forward_is_where_it_was() -> None:
    for p in places(300):
        np.testing.assert_allclose(forward(tuple(angles(p).tolist()), START), p, atol=1e-7)


@pytest.mark.parametrize(("count", "z_m", "units"), [(-1463, 0.075, 135), (-516, 0.11, 242), (872, 0.17, 158)])
def test_published_counts_and_units(count: int, z_m: float, units: int) -> None:
    theta = (count * COUNT_RAD + ZERO_RAD,) * 3
    p = forward(theta, START)
    np.testing.assert_allclose(p, (0, 0, z_m), atol=3e-5)
    assert motor_units((0.0, 0.0, 1.0), p, theta) == (-units,) * 3


def test_force_and_motors_do_the_same_work() -> None:
    for p in places(20):
        theta, f, step = angles(p), np.array((1.0, -2.0, 0.5)), np.array((1e-6, 2e-6, -1e-6))
        turned = angles(p + step) - theta
        units = motor_units(tuple(f), tuple(p), tuple(theta.tolist()))
        assert np.dot(units, turned) * -1e-4 == pytest.approx(f @ step, rel=2e-2, abs=1e-9)


def test_motors_saturate_before_the_wire_does() -> None:
    p = (0.0, 0.0, 0.125)
    theta = tuple(angles(np.array(p)).tolist())
    small, large = (np.array(motor_units((f, 0.0, f), p, theta)) for f in (1.0, 1000.0))
    assert np.abs(large).max() == UNIT_MAX
    np.testing.assert_allclose(large / UNIT_MAX, small / np.abs(small).max(), atol=5e-3)


def test_bytes_as_published() -> None:
    message = np.zeros(16, np.uint8)
    pack(message, (0, 0, 0), 0)
    assert message.tobytes() == b"<AAAAAAAAAAAAAA>"
    assert REST == b"<AAAAAAAAAAAAJA>"
    pack(message, (-1447, 0, 0), 0)
    assert message[1:5].tobytes() == b"JFKP"
    packet = np.frombuffer(b"<JFKPAAAAPPPP" + bytes([0x41 + 0x74]) + b"A>", np.uint8).copy()
    assert is_packet(packet) and [encoder_count(packet, i) for i in range(3)] == [-1447, 0, -1]
    packet[12] = ord("Q")
    assert not is_packet(packet)
