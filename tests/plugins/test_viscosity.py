"""Viscosity: force, region, passivity and stability."""

import numpy as np
import pytest

from hapscene.errors import EffectError
from hapscene_plugins.effects.viscosity import EFFECT

T_S = 1e-3
BALL = {"center_m": (0.0, 0.0, 0.0), "radius_m": 0.02}
BOX = {"box_m": [(0.01, -0.01, -0.01), (-0.01, 0.01, 0.03)]}


def along_x(x_m, speed_m_s=0.1, **fields):
    """Rows of ticks at a steady speed that end at `x_m`."""
    p = np.zeros((200, 3))
    p[:, 0] = x_m + speed_m_s * T_S * np.arange(-199, 1)
    return dict(p_WT_m=p, touching=0, **fields)


def test_force_at_constant_speed(bench, ticks):
    f = bench(EFFECT, settings={"damping_Ns_m": 3.0}).run(ticks(200, **along_x(0.0)))["f_W_N"]
    low_passed = 1.0 - np.exp(-2.0 * np.pi * 50.0 * T_S * np.arange(200))
    np.testing.assert_allclose(f, np.outer(low_passed, (-0.3, 0.0, 0.0)), atol=1e-12)


@pytest.mark.parametrize(
    ("region", "x_m", "share"),
    [
        (BALL, 0.0201, 0.0), (BALL, 0.0, 1.0), (BALL, -0.0175, 0.25),
        (BOX, -0.0101, 0.0), (BOX, 0.0, 1.0), (BOX, 0.0075, 0.25),
    ],
)  # fmt: skip
def test_force_inside_and_at_the_border_of_the_region(bench, ticks, region, x_m, share):
    """At half of the margin g = 1/2, and the force is proportional to g²."""
    f = bench(EFFECT, settings=region).run(ticks(200, **along_x(x_m, 1e-5)))["f_W_N"]
    np.testing.assert_allclose(f[-1], (-2.0 * 1e-5 * share, 0.0, 0.0), rtol=1e-3)


LONG = {"box_m": [(0.01, -0.02, 0.05), (-0.03, 0.04, 0.01)]}
SMALL = {"center_m": (0.01, 0.02, 0.03), "radius_m": 0.0145}


@pytest.mark.parametrize(
    ("region", "at_m", "share"),
    [
        (LONG, (0.0095, 0.0, 0.03), 0.01),
        (LONG, (-0.0275, 0.0, 0.03), 0.25),
        (LONG, (0.0, 0.0375, 0.03), 0.25),
        (LONG, (0.0, -0.0175, 0.03), 0.25),
        (LONG, (0.0, 0.0, 0.0125), 0.25),
        (LONG, (0.0, 0.0, 0.051), 0.0),
        (SMALL, (0.016, 0.014, 0.037), 0.49),  # 11 mm from the centre
        (SMALL, (0.01, 0.02, 0.03), 1.0),
        (SMALL, (0.01, 0.02, 0.045), 0.0),
    ],
)
def test_borders_along_each_axis(bench, ticks, region, at_m, share):
    v = np.array([1e-5, -2e-5, 3e-5])
    p = np.array(at_m) + T_S * np.arange(-199, 1)[:, None] * v
    f = bench(EFFECT, settings=region).run(ticks(200, p_WT_m=p, touching=0))["f_W_N"]
    np.testing.assert_allclose(f[-1], -2.0 * share * v, rtol=0.02, atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_a_teleported_tool_is_not_damped(bench, ticks, axis):
    for speed_m_s, damped in ((9.99, True), (-9.99, True), (10.01, False)):
        p = np.zeros((2, 3))
        p[1, axis] = speed_m_s * T_S
        f = bench(EFFECT).run(ticks(2, p_WT_m=p))["f_W_N"][1]
        expected = -2.0 * speed_m_s * -np.expm1(-2.0 * np.pi * 50.0 * T_S) if damped else 0.0
        assert f[axis] == pytest.approx(expected) and np.count_nonzero(f) == damped


def test_the_region_moves_with_its_body(bench, ticks):
    """No force on a tool that moves with the body; a resting tool in a moving body is dragged."""
    one = bench(EFFECT, settings=BALL)
    still = bench(EFFECT, settings=BALL)
    rows = ticks(300, **along_x(0.0) | {"p_WT_m": np.column_stack((1e-4 * np.arange(300), np.zeros((300, 2))))})
    for k in range(300):
        one.table[9] = still.table[9] = 1e-4 * k
        f = one.run(rows[k : k + 1])["f_W_N"][0]
        g = still.run(ticks(1, p_WT_m=(0.015, 0.0, 0.0)))["f_W_N"][0]
        assert np.abs(f).max() < 1e-12
        if k == 150:
            np.testing.assert_allclose(g, (0.2, 0.0, 0.0), rtol=1e-6)
    one.table[9] = 0.0  # it is put back: no kick
    assert not one.run(rows[-1:])["f_W_N"].any()


def test_passivity_across_the_border(bench, ticks):
    """On random paths across the border, the work on the hand never exceeds 0."""
    t_s = 1e-5 * np.arange(60_000)
    rng = np.random.default_rng(0)
    p = sum(a * np.sin(2 * np.pi * f * t_s[:, None] + rng.uniform(0, 6, 3)) for a, f in ((0.02, 7), (0.004, 61)))
    f = bench(EFFECT, settings=BALL | {"margin_m": 0.002}).run(ticks(len(p), p_WT_m=p, tick_s=1e-5))["f_W_N"]
    work_J = np.cumsum((0.5 * (f[1:] + f[:-1]) * np.diff(p, axis=0)).sum(axis=1))
    assert work_J.max() < 1e-6 and work_J[-1] < -1e-3


@pytest.mark.parametrize(("share", "stable"), [(0.97, True), (1.03, False)])
@pytest.mark.parametrize("cutoff_Hz", [10.0, 1000.0])
def test_a_free_mass_is_stable_below_2_m_over_T(bench, ticks, share, stable, cutoff_Hz):
    mass_kg = 0.02
    one = bench(EFFECT, settings={"damping_Ns_m": share * 2.0 * mass_kg / T_S, "cutoff_Hz": cutoff_Hz})
    x, v, speeds = 0.0, 1e-3, []
    for _ in range(2000):
        f_N = one.run(ticks(1, p_WT_m=(x, 0.0, 0.0)))["f_W_N"][0, 0]
        x, v = x + T_S * v + 0.5 * T_S**2 * f_N / mass_kg, v + T_S * f_N / mass_kg
        speeds.append(abs(v))
        if abs(v) > 0.1:
            break
    assert (max(speeds[-100:]) < 0.5 * max(speeds[:100])) == stable


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        (BALL | BOX, "box_m and center_m"),
        ({"box_m": [(0, 0, 0)]}, "box_m"),
        ({"center_m": [(0, 0, 0)] * 2}, "center_m"),
        ({"center_m": (0, 0)}, r"needs center_m, a ball's centre"),
        ({"box_m": "here"}, "needs box_m"),
    ],
)
def test_invalid_regions_are_refused(bench, setting, says):
    with pytest.raises(EffectError, match=says):
        bench(EFFECT, settings=setting)
