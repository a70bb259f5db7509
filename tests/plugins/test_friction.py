"""Friction: hysteresis loop, drift, stick–slip and passivity."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.surface.effect import load_effect

FRICTION = load_effect("friction")
K_N_M = 500.0


def along_x(bench, ticks, x_m, press_N=1.0, static=0.3, dynamic=0.3, over=(), **fields):
    """Forces (n, 3) on a proxy moved to `x_m` (n,) over a plane, contact beginning at the first."""
    slip = np.zeros((len(x_m), 3))
    slip[1:, 0] = np.diff(x_m)
    rows = ticks(len(x_m), slip_W_m=slip, normal_force_N=press_N, **fields)
    rows["began"][0] = 1
    params = dict(friction_static=static, friction_dynamic=dynamic, tangential_stiffness_N_m=K_N_M)
    return bench(FRICTION, params=params | dict(over)).run(rows)["f_W_N"]


def test_area_of_the_loop(bench, ticks):
    """F1: a slider on a spring with amplitude A dissipates 4 F_c (A − F_c/k) per cycle."""
    amplitude_m, limit_N = 5e-3, 0.3
    turns = np.linspace(0.0, 2.0, 40_001)
    x = amplitude_m * np.sin(2.0 * np.pi * turns)
    f = along_x(bench, ticks, x)[:, 0]
    second = slice(20_000, None)
    area_J = -np.trapezoid(f[second], x[second])
    assert area_J == pytest.approx(4.0 * limit_N * (amplitude_m - limit_N / K_N_M), rel=1e-3)


def test_no_drift_under_vibration(bench, ticks):
    """F3: at 0.5 F_c with a vibration of 0.2 F_c for 50 s, the drift is 0."""
    hold_m = 0.5 * 0.3 / K_N_M
    t_s = np.arange(50_000) * 1e-3
    x = hold_m + 0.4 * hold_m * np.sin(2.0 * np.pi * 37.0 * t_s)
    x[0] = 0.0
    f = along_x(bench, ticks, x)[:, 0]
    creep_m = x + f / K_N_M  # where the point of adhesion is
    assert np.abs(creep_m).max() < 1e-15


def test_breaks_away_then_slips(bench, ticks):
    """Sticks up to µ_s F_n, slips at µ_d F_n, and sticks up to µ_s F_n again after a reversal."""
    way = np.concatenate([np.linspace(0, 3e-3, 301), np.linspace(3e-3, -1e-3, 401)])
    f = -along_x(bench, ticks, way, static=0.5, dynamic=0.3)[:, 0]
    broke = int(np.argmax(way > 0.5 / K_N_M + 1e-12))
    np.testing.assert_allclose(f[1:broke], K_N_M * way[1:broke], rtol=1e-12)
    np.testing.assert_allclose(f[broke:301], 0.3, rtol=1e-12)
    back = f[301:]
    assert back.min() == pytest.approx(-0.5, rel=2e-2)
    assert back[-1] == pytest.approx(-0.3)


def test_a_pause_while_slipping_does_not_cause_sticking(bench, ticks):
    """Encoder steps cause pauses of the proxy, which must not lead to new breakaways."""
    x = np.repeat(np.arange(200) * 55e-6, 7)
    f = along_x(bench, ticks, x, static=0.5, dynamic=0.3)[:, 0]
    np.testing.assert_allclose(f[x > 2e-3], -0.3, rtol=1e-12)


def test_stick_slip_of_a_dragged_mass(bench, ticks):
    """F2: period 2ΔF/(kV) + (2/ω)(π − atan(ΔFω/(kV))), ΔF = F_s − F_d.

    The closed form is of rigid friction: the spring of adhesion is 100 times as stiff as the one dragged by,
    and what rings on it while it sticks is damped, as by a hand.
    """
    mass_kg, k_N_m, drag_m_s, dt_s, press_N = 0.05, 100.0, 0.02, 2e-5, 2.0
    gap_N, omega = (0.5 - 0.3) * press_N, np.sqrt(k_N_m / mass_kg)
    want_s = 2 * gap_N / (k_N_m * drag_m_s) + 2 / omega * (np.pi - np.arctan(gap_N * omega / (k_N_m * drag_m_s)))
    effect = bench(FRICTION, params=dict(friction_static=0.5, friction_dynamic=0.3, tangential_stiffness_N_m=1e4))
    rows = ticks(1, normal_force_N=press_N)
    x = v = f = 0.0
    starts_s, slipping = [], True
    for i in range(80_000):
        damper_Ns_m = 0.0 if slipping else 5.0
        v += dt_s * (k_N_m * (drag_m_s * i * dt_s - x) + f - damper_Ns_m * v) / mass_kg
        x += dt_s * v
        rows["began"], rows["slip_W_m"] = i == 0, (dt_s * v, 0.0, 0.0)
        f = effect.run(rows)["f_W_N"][0, 0]
        was, slipping = slipping, bool(effect.s["slipping"][0])
        if slipping and not was:
            starts_s.append(i * dt_s)
    assert starts_s[-1] - starts_s[-2] == pytest.approx(want_s, rel=0.02)


def test_damping_applies_while_sticking_and_within_the_limit(bench, ticks):
    """f = −(k z + b Δx/T) while sticking; the damping does not increase the sliding friction."""
    x = np.concatenate([np.linspace(0.0, 3e-4, 31), np.linspace(3e-4, 3e-2, 31)])
    slip = np.zeros((len(x), 3))
    slip[1:, 0] = np.diff(x)
    rows = ticks(len(x), slip_W_m=slip, normal_force_N=1.0)
    rows["began"][0] = 1
    params = dict(friction_static=0.5, friction_dynamic=0.3, tangential_stiffness_N_m=K_N_M)
    f = bench(FRICTION, params=params | dict(tangential_damping_Ns_m=2.0)).run(rows)["f_W_N"][:, 0]
    np.testing.assert_allclose(f[1:31], -(K_N_M * x[1:31] + 2.0 * 1e-5 / 1e-3), rtol=1e-12)
    np.testing.assert_allclose(f[-29:], -0.3, rtol=1e-12)


def test_lifting_ends_friction(bench, ticks):
    x = np.linspace(0, 1e-2, 100)
    f = along_x(bench, ticks, x, touching=np.arange(100) < 50)
    assert f[49, 0] == pytest.approx(-0.3) and not f[50:].any()


def test_a_new_contact_starts_without_force_and_sticks(bench, ticks):
    x = 1e-4 * np.arange(90)
    rows = {"touching": (np.arange(90) < 40) | (np.arange(90) >= 60), "ended": np.arange(90) == 40}
    rows["began"] = np.isin(np.arange(90), (0, 60))
    slip = np.zeros((90, 3))
    slip[1:, 0] = np.diff(x)
    params = dict(friction_static=0.5, friction_dynamic=0.3, tangential_stiffness_N_m=K_N_M)
    f = -bench(FRICTION, params=params).run(ticks(90, slip_W_m=slip, normal_force_N=1.0, **rows))["f_W_N"][:, 0]
    once = np.where(np.arange(30) <= 10, K_N_M * x[:30], 0.3)
    np.testing.assert_allclose(f[:30], once, rtol=1e-12)
    np.testing.assert_allclose(f[60:], once, rtol=1e-12)
    assert not f[40:60].any()


@pytest.mark.parametrize(
    ("to", "held"), [((1.0, 0.0, 0.0), (0.0, -1e-4, -3e-4)), ((0.0, 0.0, -1.0), (3e-4, -1e-4, 0.0))]
)
def test_the_spring_turns_at_an_edge_and_stays_on_the_other_side_of_a_sheet(bench, ticks, to, held):
    """What slips into the surface at the edge does not count."""
    rows = ticks(3, normal_force_N=1.0, nhat_W=[(0.0, 0.0, 1.0), (0.0, 0.0, 1.0), to], began=[1, 0, 0])
    rows["slip_W_m"][1:] = (2e-4, -1e-4, 0.0), (1e-4, 0.0, -1e-4)
    params = dict(friction_static=9.0, friction_dynamic=9.0, tangential_stiffness_N_m=K_N_M)
    f = bench(FRICTION, params=params).run(rows)["f_W_N"]
    np.testing.assert_allclose(f[1], (-0.1, 0.05, 0.0), atol=1e-12)
    np.testing.assert_allclose(f[2], -K_N_M * np.array(held), atol=1e-12)


def test_the_spring_follows_a_curved_surface(bench, ticks):
    """On a helix around a cylinder the force is tangential and opposed to the motion; slip into it does not count."""
    turn = np.linspace(0.0, np.pi / 2, 400)
    nhat = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    about = np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=1)
    slip = 1e-4 * (0.6 * about + 0.8 * np.array([0.0, 1.0, 0.0]))
    rows = ticks(400, slip_W_m=slip - 0.5e-4 * nhat, nhat_W=nhat, normal_force_N=1.0)
    rows["began"][0] = 1
    f = bench(FRICTION, params=dict(friction_static=0.3, friction_dynamic=0.3)).run(rows)["f_W_N"]
    np.testing.assert_allclose(np.einsum("ni,ni->n", f, nhat), 0.0, atol=1e-12)
    np.testing.assert_allclose(f[50:], -0.3 * slip[50:] / 1e-4, atol=1e-9)


@st.composite
def slides(draw):
    """Random walks over a plane with random coefficients and constant force."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    step = 10.0 ** draw(st.floats(-6, -2))
    dynamic = draw(st.floats(0, 2))
    path = rng.normal(0, step, (200, 2)) + rng.choice([0.0, step], 2)
    return path, draw(st.floats(0, 20)), dynamic + draw(st.floats(0, 1)), dynamic


CURVE = dict(static=0.5, dynamic=0.3, over=dict(friction_stribeck_m_s=0.02, friction_viscous_s_m=0.4))


@pytest.mark.parametrize("speed_m_s", [0.002, 0.02, 0.05, 0.3])
def test_friction_over_speed(bench, ticks, speed_m_s):
    """µ_d + (µ_s − µ_d) exp(−(v/v_s)²) + µ_v v, also with encoder steps."""
    expected = 0.3 + 0.2 * np.exp(-((speed_m_s / 0.02) ** 2)) + 0.4 * speed_m_s
    f = along_x(bench, ticks, speed_m_s * 1e-3 * np.arange(3000), slip_m_s=speed_m_s, **CURVE)
    np.testing.assert_allclose(f[-500:, 0], -expected, rtol=1e-9)
    if speed_m_s > 0.01:  # below, rests between two counts are longer than what its low-pass bridges
        counts = 55e-6 * np.floor(speed_m_s * 1e-3 / 55e-6 * np.arange(3000))
        f = along_x(bench, ticks, counts, slip_m_s=speed_m_s, **CURVE)
        np.testing.assert_allclose(f[-500:, 0], -expected, rtol=1e-9)


def test_a_resting_tool_must_overcome_static_friction_again(bench, ticks):
    x = np.concatenate([1e-4 * np.arange(100), np.full(300, 9.9e-3), 9.9e-3 + 1e-5 * np.arange(100)])
    v = np.concatenate([np.full(100, 0.1), 0.1 * np.exp(-np.arange(300) / 8.0), np.zeros(100)])
    f = -along_x(bench, ticks, x, slip_m_s=v, **CURVE)[:, 0]
    assert f[99] == pytest.approx(0.34, rel=1e-3) and 0.3 < f[399] < 0.34
    assert f.max() == f[400:].max() == pytest.approx(0.5)


@settings(max_examples=100, deadline=None)
@given(slides(), st.floats(1e-4, 1.0), st.floats(0.0, 2.0))
def test_friction_over_speed_is_passive(bench, ticks, slide, stribeck_m_s, viscous_s_m):
    step, press_N, static, dynamic = slide
    slip = np.column_stack([step, np.zeros(len(step))])
    v = np.linalg.norm(slip, axis=1) / 1e-3
    rows = ticks(len(slip), slip_W_m=slip, slip_m_s=v, normal_force_N=press_N)
    params = dict(friction_static=static, friction_dynamic=dynamic, tangential_stiffness_N_m=K_N_M)
    over = dict(friction_stribeck_m_s=stribeck_m_s, friction_viscous_s_m=viscous_s_m)
    f = bench(FRICTION, params=params | over).run(rows)["f_W_N"]
    size_N = np.linalg.norm(f, axis=1)
    assert np.all(size_N <= (static + viscous_s_m * v) * press_N * (1 + 1e-12) + 1e-12)
    work_J = np.cumsum(-np.einsum("ni,ni->n", f, slip))
    assert np.all(work_J >= size_N**2 / (2 * K_N_M) - 1e-12)


def test_breakaway_vibration_is_proportional_to_the_released_force(bench, ticks):
    way = np.linspace(0, 3e-3, 301)
    rows = ticks(301, slip_W_m=np.column_stack([np.gradient(way), np.zeros((301, 2))]), normal_force_N=2.0)
    rows["began"][0] = 1
    params = dict(friction_static=0.5, friction_dynamic=0.3, tangential_stiffness_N_m=K_N_M)
    rings = dict(breakaway_1_kg=25.0, breakaway_Hz=150.0, breakaway_decay_1_s=60.0)
    out = bench(FRICTION, params=params | rings).run(rows)
    broke = int(np.argmin(np.diff(out["f_W_N"][:, 0]) < 0.0)) + 1
    y, t_s = out["a_m_s2"][broke + 1 :, :10].ravel(), np.arange((300 - broke) * 10) * 1e-4
    freed_N = K_N_M * (way[broke] - way[0]) - 0.6
    np.testing.assert_allclose(y, 25.0 * freed_N * np.exp(-60 * t_s) * np.sin(2 * np.pi * 150 * t_s), atol=0.1)
    assert freed_N == pytest.approx(0.4, abs=0.01) and not out["a_m_s2"][: broke + 1].any()
    beyond = bench(FRICTION, params=params | rings | {"breakaway_Hz": 6000.0}).run(rows)
    assert not beyond["a_m_s2"].any()  # this rate cannot carry it
    assert not bench(FRICTION, params=params | rings | {"breakaway_decay_1_s": 0.0}).run(rows)["a_m_s2"].any()
