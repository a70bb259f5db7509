"""Named devices and the walls they hold: against the reference, and against the closed loop."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapscene.device.limit import Limits
from hapscene.device.model import (
    BORDER_COUNT,
    DEVICES,
    Device,
    damping_for,
    damping_max,
    device_named,
    limits_of,
    stability_border,
    wall_limit,
)
from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.stability.rig import Rig
from hapscene.twin.intent import Intent

REAL = ("omni", "phantom-1.0", "premium-1.5")


def held_N_m(m: float, b: float, T: float, d: int, B: float, count: int = BORDER_COUNT) -> float:
    K, damping = stability_border(m, b, T, d, count)
    return float(np.interp(B, damping, K))


def test_border_meets_the_reference(shared):
    tried = 0
    for case in json.loads((shared / "reference" / "wall_cases.json").read_text()):
        at = case["setup"]
        if case["id"][:2] in ("W1", "W2", "W5") and "critical K" in case["what"] and not at.get("c"):
            got = held_N_m(at["m"], at["b"], at["T"], at["delay"], at["B"])
            assert got == pytest.approx(case["expected"], rel=5e-6), case["id"]
            tried += 1
    assert tried >= 20


@pytest.mark.parametrize(("d", "apex"), [(0, 4 * (math.sqrt(2) - 1) ** 2), (1, 0.1445), (2, 0.0624), (3, 0.0348)])
def test_stiffest_wall_of_virtual_damping(d, apex):
    K, B = stability_border(1.0, 0.0, 1.0, d)
    assert K.max() == pytest.approx(apex, rel=1e-3 if d else 1e-6)
    assert damping_max(1.0, 1.0, d) == pytest.approx((2.0, 0.8284, 0.5359, 0.3978)[d], rel=1e-4)
    assert B[-1] == pytest.approx(damping_max(1.0, 1.0, d), rel=2e-3)


def spectral_radius(m: float, b: float, T: float, d: int, K: float, B: float) -> float:
    """Of one tick of the loop: mass, its speed, the last position, and the forces on their way."""
    delta = b * T / m
    e = -math.expm1(-delta)
    A = np.zeros((3 + d, 3 + d))
    move, push = (e * m / b, (delta - e) * m / b**2) if delta > 1e-9 else (T, T * T / (2 * m))
    speed = e / b if delta > 1e-9 else T / m
    A[0, :2], A[1, 1], A[2, 0] = (1.0, move), math.exp(-delta), 1.0
    force = np.zeros(3 + d)
    force[0], force[2] = -(K + B / T), B / T
    sent = force if d == 0 else np.eye(3 + d)[3]
    A[0] += push * sent
    A[1] += speed * sent
    for i in range(d):
        A[3 + i] = force if i == d - 1 else np.eye(3 + d)[4 + i]
    return float(np.abs(np.linalg.eigvals(A)).max())


@given(
    m=st.floats(0.02, 0.3),
    b=st.floats(1e-3, 2.0),
    T=st.sampled_from((1e-3, 2e-4, 1e-4)),
    d=st.integers(0, 3),
    share=st.floats(0.0, 0.9),
)
def test_border_is_where_the_loop_is_just_stable(m, b, T, d, share):
    B = share * stability_border(m, b, T, d)[1][-1]
    K = held_N_m(m, b, T, d, B)
    if K * T**2 / m < 1e-3:  # eigenvalues so near 1 that rounding hides which side they are on
        return
    assert spectral_radius(m, b, T, d, 0.999 * K, B) < 1.0 < spectral_radius(m, b, T, d, 1.001 * K, B)


@given(
    name=st.sampled_from(REAL), T=st.sampled_from((2e-3, 1e-3, 5e-4, 1e-4)), d=st.integers(0, 8), damped=st.booleans()
)
def test_limits_are_sane(name, T, d, damped):
    device = DEVICES[name]
    K, B = wall_limit(name, T, d, damped)
    assert 0.0 < K <= device.limits.stiffness_N_m and 0.0 <= B <= device.limits.damping_Ns_m
    with_damper, _ = wall_limit(name, T, d)
    sooner, _ = wall_limit(name, T, max(0, d - 1), damped)
    assert with_damper >= K - 1e-9  # a damper never makes it softer
    assert sooner >= K - 1e-9  # nor delay stiffer
    limits = limits_of(name, T, d)
    needed = damping_for(device, limits.stiffness_N_m, T, d)
    assert needed <= limits.damping_Ns_m * (1 + 1e-3) + 1e-9
    assert limits.damping_time_s * (limits.stiffness_N_m - limits.undamped_N_m) == pytest.approx(needed, abs=1e-9)
    assert (limits.stiffness_N_m + limits.damping_Ns_m / T) * device.point.quantum_m <= device.point.c_N * (1 + 1e-9)


def test_published_caps():
    """At 1 kHz the closed form allows what CHAI3D does for the Omni, and two thirds of it or more for the others."""
    assert limits_of("omni", 1e-3).stiffness_N_m == 700.0
    for name, cap in (("phantom-1.0", 1000.0), ("premium-1.5", 800.0)):
        assert 0.6 * cap < limits_of(name, 1e-3).stiffness_N_m <= cap


def test_ideal_and_unknown_devices():
    assert replace(limits_of("ideal", 1e-3), device="device") == Limits()
    with pytest.raises(HapsceneError, match=r"there are: ideal, omni, phantom-1\.0, premium-1\.5"):
        device_named("onmi")


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("damped", [True, False])
def test_walls_at_the_limit_rest_after_a_brisk_tap(name, delay, damped):
    """At a light grip, 0.5 m/s into the wall, without the passivity controller."""
    device, T = DEVICES[name], 1e-3
    K, _ = wall_limit(name, T, delay, damped)
    B = damping_for(device, K, T, delay) if damped else 0.0
    felt = tap(device.point, K, B, delay)
    assert np.abs(felt.v_W_m_s[-400:]).max() < 5e-3
    assert np.cumsum(felt.work_J).max() < 2e-3


def test_a_wall_far_beyond_the_limit_does_not_rest():
    """Else the cases above would prove nothing."""
    point = PointMass(0.045, 0.1)
    bare = Device("bare", point, Limits())
    K = wall_limit(bare, 1e-3, 0, damped=False)[0]
    assert np.abs(tap(point, K, 0.0, 0).v_W_m_s[-400:]).max() < 5e-3
    assert np.abs(tap(point, 20.0 * K, 0.0, 0).v_W_m_s[-400:]).max() > 5e-2
    assert np.abs(tap(DEVICES["omni"].point, 5000.0, 0.0, 2).v_W_m_s[-400:]).max() > 5e-2


def tap(point: PointMass, K: float, B: float, delay: int):
    twin = Rig(point, 1e-3, delay, stiffness_N_m=K, damping_Ns_m=B).twin
    twin.reset((0.031, -0.017, 0.0005), (0.0, 0.0, -0.5))
    return twin.run(Intent.hold((0.031, -0.017, -0.003), 3000, "light"))


@pytest.mark.parametrize(("tick_s", "delay"), [(0.0, 0), (math.nan, 0), (1e-3, -1), (1e-3, 64), (1e-3, math.nan)])
def test_a_loop_that_is_none(tick_s: float, delay: float) -> None:
    with pytest.raises(HapsceneError, match=r"limits: (tick_s|delay_ticks)"):
        limits_of("omni", tick_s, delay)  # type: ignore[arg-type]
