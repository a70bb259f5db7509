"""Walls with known limits, found by simulation with the real haptic tick."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from hapscene.device.model import DEVICES
from hapscene.device.sim.point import PointMass
from hapscene.stability.rig import Rig
from tests.stability import closed_form
from tests.stability.critical import comes_to_rest, critical_stiffness
from tests.stability.wall_cases import bounce, found, largest_beta, passivity_limit, peak_speed

LARGEST_BETA = (2.0, 0.8284, 0.5359, 0.3978)
"""Largest BT/m of a stable wall for delays of 0 to 3 ticks and b = 0: reference table, W5."""

KINDS = {"damping": 1e-6, "delay": 1e-6, "wall damping": 1e-6, "encoder": 1e-4, "speed": 0.05}
"""Kinds of random limits, by the dissipation, with the largest relative error."""


@pytest.mark.nightly
def test_reference_cases(shared: Path) -> None:
    cases = json.loads((shared / "reference" / "wall_cases.json").read_text())
    assert len(cases) == 45
    for case in cases:
        expected = case["expected"]
        expected = (expected["alpha"], expected["beta"]) if isinstance(expected, dict) else (expected,)
        tolerance = 1e-6 if case["id"].startswith("W3") else case["rel_tol"]
        assert found(case) == pytest.approx(expected, rel=tolerance), case["id"]


@pytest.mark.nightly
def test_limit_of_rest_of_each_device() -> None:
    for device in (named.point for named in DEVICES.values() if named.point is not None):
        limit_N_m = closed_form.limit_of_rest(device.c_N, device.quantum_m)
        friction = {"coulomb_N": device.c_N, "quantum_m": device.quantum_m}
        assert critical_stiffness(device.mass_kg, device.b_Ns_m, 1e-3, **friction) == pytest.approx(limit_N_m, rel=1e-2)
        rig = Rig(device, 1e-3)
        assert [comes_to_rest(rig, share * limit_N_m, 0.0) for share in (0.99, 1.01)] == [True, False]
        below, above = (closed_form.comes_to_rest(device.c_N, s * limit_N_m, device.quantum_m) for s in (0.99, 1.01))
        assert below and not above


@pytest.mark.nightly
def test_largest_wall_damping() -> None:
    assert [largest_beta(delay) for delay in range(4)] == pytest.approx(LARGEST_BETA, rel=2e-4)


@pytest.mark.parametrize("wall_share", [0.0, 0.4])
@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("ratio", [1e-3, 0.3, 5.0])
def test_limit_of_small_motion_against_roots(ratio: float, delay: int, wall_share: float) -> None:
    """Against the plant sampled by SciPy and the roots of the polynomial; at a ratio bT/m of 5, a root leaves at -1."""
    mass, tick = 0.05, 1e-3
    damping, wall = ratio * mass / tick, wall_share * mass / tick * (1.0 if delay == 0 else 0.5)
    held, poles, _ = signal.cont2discrete(([1.0], [mass, damping, 0.0]), tick)
    free = np.polymul(poles, [1.0] + [0.0] * (delay + 1))

    def largest_root(stiffness: float) -> float:
        wall_law = [stiffness + wall / tick, -wall / tick]
        return float(np.abs(np.roots(np.polyadd(free, np.polymul(held[0], wall_law)))).max())

    limit = closed_form.limit_of_small_motion(mass, damping, tick, delay, wall)
    assert limit > 0.0
    assert [largest_root(share * limit) < 1.0 for share in (0.01, 0.5, 0.999, 1.001)] == [True, True, True, False]


@pytest.mark.nightly
@pytest.mark.parametrize(("count", "seed"), [(1, 5), pytest.param(48, 4, marks=pytest.mark.soak)])
@pytest.mark.parametrize("kind", KINDS)
def test_random_limits(kind: str, count: int, seed: int) -> None:
    rng = np.random.default_rng([seed, *kind.encode()])
    predicted, simulated = np.array([random_limit(kind, rng) for _ in range(count)]).T
    errors = np.abs(simulated / predicted - 1.0)
    print(f"{kind}: median {np.median(errors):.1e}, largest {errors.max():.1e}")
    assert errors.max() < KINDS[kind]


def random_limit(kind: str, rng: np.random.Generator) -> tuple[float, float]:
    """A limit as predicted and as simulated.

    Masses are of 20 to 500 g, ticks of 0.1 to 2 ms, dampings such that bT/m is 1e-4 to 0.3, delays up to 4 ticks, wall
    dampings up to nine tenths of the largest at which any wall rests, friction of 20 to 500 mN, encoder steps of 5 to
    100 µm; stiffnesses are such that ωT is 0.05 to 0.25, where the prediction of the speed holds.
    """

    def drawn(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    mass, tick = drawn(0.02, 0.5), drawn(1e-4, 2e-3)
    damping = drawn(1e-4, 0.3) * mass / tick
    delay = 0 if kind == "damping" else int(rng.integers(0, 5))
    coulomb, quantum = drawn(0.02, 0.5), drawn(5e-6, 1e-4)
    most = mass / tick * (2.0 if delay == 0 else 0.75 / delay)  # slightly below the largest stable one of each delay
    wall = drawn(0.02, 0.9) * most if kind == "wall damping" else 0.0
    if kind in ("damping", "delay", "wall damping"):
        predicted = closed_form.limit_of_small_motion(mass, damping, tick, delay, wall)
        simulated = critical_stiffness(mass, damping, tick, delay_ticks=delay, wall_damping_Ns_m=wall)
    elif kind == "encoder":
        predicted = closed_form.limit_of_rest(coulomb, quantum)
        simulated = critical_stiffness(mass, damping, tick, delay_ticks=delay, coulomb_N=coulomb, quantum_m=quantum)
    else:
        stiffness = mass * (drawn(0.05, 0.25) / tick) ** 2
        damping = drawn(1e-3, 0.9) * 0.5 * stiffness * tick  # less than the energy that the wall adds
        predicted = closed_form.peak_speed(coulomb, stiffness, tick, damping)
        simulated = peak_speed({"m": mass, "b": damping, "c": coulomb, "T": tick, "K": stiffness})
    return predicted, simulated


def test_passivity_with_wall_damping() -> None:
    """Colgate & Schenkel: wall damping reduces the passive stiffness."""
    setup = {"m": 0.05, "b": 0.5, "T": 1e-3, "B": 0.2}
    assert passivity_limit(setup) == pytest.approx(closed_form.limit_of_passivity(0.5, 0.2, 1e-3), rel=1e-6)


def test_speed_with_delay_and_wall_damping() -> None:
    setup = {"m": 0.1, "b": 0.05, "c": 0.1, "T": 5e-4, "K": 800.0, "B": 0.1, "delay": 1}
    assert peak_speed(setup) == pytest.approx(closed_form.peak_speed(0.1, 800.0, 5e-4, 0.05, 0.1, 1), rel=0.05)


def test_bounce_with_damping() -> None:
    setup = {"m": 0.1, "b": 0.2, "T": 2e-4, "K": 1000.0, "B": 0.5, "delay": 0}
    assert bounce(setup) == pytest.approx(closed_form.restitution(0.1, 1000.0, 2e-4, 0, 0.2, 0.5), rel=0.02)


def test_friction_stops_small_motion_at_any_wall() -> None:
    """The reason why the critical stiffness is infinite with friction and without encoder steps."""
    rig = Rig(PointMass(0.05, 0.0, 0.1), 1e-3, 1)
    for stiffness in (1e3, 1e4, 1e5):
        rig.tune(stiffness)
        felt = rig.release(1e-2, 1e-6, stiffness * 1e-2, 500)
        assert (felt.v_W_m_s[-100:, 2] == 0.0).all()


def test_release_depth_and_speed() -> None:
    rig = Rig(PointMass(0.05, 0.3), 1e-3)
    rig.tune(500.0)
    felt = rig.release(0.02, 0.4, 10.0, 4)
    assert -felt.p_W_m[0, 2] == pytest.approx(0.0204, rel=1e-3)  # one tick later
    assert -felt.v_W_m_s[0, 2] == pytest.approx(0.4, rel=2e-2)
    np.testing.assert_array_equal(felt.f_hand_W_N[:, 2], -10.0)
