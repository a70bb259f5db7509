"""Walls with known limits, found by simulation with the real haptic tick."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from hapscene.device.model import DEVICES
from hapscene.device.sim.point import PointMass
from hapscene.stability.closed_form import limit_of_small_motion
from tests.stability import closed_form
from tests.stability.critical import comes_to_rest, critical_stiffness
from tests.stability.free_rig import FreeRig
from tests.stability.wall_cases import bounce, found, largest_beta, passivity_limit, peak_speed

LARGEST_BETA = (2.0, 0.8284, 0.5359, 0.3978)
"""Largest BT/m of a stable wall for delays of 0 to 3 ticks and b = 0: reference table, W5."""


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
        rig = FreeRig(device, 1e-3)
        assert [comes_to_rest(rig, share * limit_N_m, 0.0) for share in (0.99, 1.01)] == [True, False]
        below, above = (closed_form.comes_to_rest(device.c_N, s * limit_N_m, device.quantum_m) for s in (0.99, 1.01))
        assert below and not above


@pytest.mark.nightly
def test_largest_wall_damping() -> None:
    assert [largest_beta(delay) for delay in range(4)] == pytest.approx(LARGEST_BETA, rel=2e-4)


@pytest.mark.parametrize(
    ("ratio", "delay", "wall_share"), [*product((1e-3, 0.3, 5.0), (0, 2), (0.0, 0.4)), (3.6, 0, 2.5), (0.0, 0, 1.9)]
)
def test_limit_of_small_motion_against_roots(ratio: float, delay: int, wall_share: float) -> None:
    """Against the plant sampled by SciPy and the roots of the polynomial; at a ratio bT/m of 5, a root leaves at -1."""
    mass, tick = 0.05, 1e-3
    damping, wall = ratio * mass / tick, wall_share * mass / tick * (1.0 if delay == 0 else 0.5)
    held, poles, _ = signal.cont2discrete(([1.0], [mass, damping, 0.0]), tick)
    free = np.polymul(poles, [1.0] + [0.0] * (delay + 1))

    def largest_root(stiffness: float) -> float:
        wall_law = [stiffness + wall / tick, -wall / tick]
        return float(np.abs(np.roots(np.polyadd(free, np.polymul(held[0], wall_law)))).max())

    limit = limit_of_small_motion(mass, damping, tick, delay, wall)
    assert limit > 0.0
    assert [largest_root(share * limit) < 1.0 for share in (0.01, 0.5, 0.999, 1.001)] == [True, True, True, False]


@pytest.mark.parametrize(("delay", "wall"), [(0, 0.0), (0, 2.05), (1, 0.0), (1, 0.85), (2, 3.0)])
def test_no_stiffness_is_stable_without_dissipation_or_with_too_much_wall_damping(delay: int, wall: float) -> None:
    assert limit_of_small_motion(1.0, 0.0, 1.0, delay, wall) == 0.0


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
    rig = FreeRig(PointMass(0.05, 0.0, 0.1), 1e-3, 1)
    for stiffness in (1e3, 1e4, 1e5):
        rig.tune(stiffness)
        felt = rig.release(1e-2, 1e-6, stiffness * 1e-2, 500)
        assert (felt.v_W_m_s[-100:, 2] == 0.0).all()
