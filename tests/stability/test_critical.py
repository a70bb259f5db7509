"""The critical stiffness from simulation against closed forms."""

import math

import numpy as np
import pytest

from hapscene.device.model import stability_border
from tests.stability.closed_form import limit_of_rest, limit_of_small_motion
from tests.stability.critical import critical_stiffness, growth


def test_any_delay_and_damping() -> None:
    rng = np.random.default_rng(7)
    for _ in range(6):
        mass, tick, delay = 10.0 ** rng.uniform(-2, 0), 10.0 ** rng.uniform(-4, -2.5), int(rng.integers(0, 5))
        damping, wall = mass / tick * 10.0 ** rng.uniform(-4, 1), mass / tick * rng.uniform(0.0, 0.4) / (1 + delay)
        expected = limit_of_small_motion(mass, damping, tick, delay, wall)
        assert critical_stiffness(mass, damping, tick, delay_ticks=delay, wall_damping_Ns_m=wall) == pytest.approx(
            expected, rel=1e-6
        )


def test_without_dissipation_or_with_too_much_wall_damping() -> None:
    assert critical_stiffness(1.0, 0.0, 1.0) == 0.0
    assert critical_stiffness(0.05, 0.0, 1e-3, delay_ticks=2) == 0.0
    assert critical_stiffness(1.0, 0.0, 1.0, delay_ticks=0, wall_damping_Ns_m=2.05) == 0.0
    assert critical_stiffness(1.0, 0.0, 1.0, delay_ticks=1, wall_damping_Ns_m=0.85) == 0.0


def test_near_the_largest_wall_damping() -> None:
    """A mode that alternates from tick to tick decays as slowly as those of the spring."""
    for delay, damping, share in (
        (0, 1e-3, 0.999),
        (0, 0.0, 0.9997),
        (1, 1e-3, 0.9999),
        (4, 0.0, 0.9999),
    ):
        wall = share * stability_border(1.0, damping, 1.0, delay)[1][-1]
        expected = limit_of_small_motion(1.0, damping, 1.0, delay, wall)
        assert critical_stiffness(1.0, damping, 1.0, delay_ticks=delay, wall_damping_Ns_m=wall) == pytest.approx(
            expected, rel=2e-6
        )


def test_rest_between_encoder_steps() -> None:
    """Depends on friction and encoder step only, not on b, T and d."""
    for damping, tick, delay in ((0.005, 1e-3, 0), (1.0, 1e-4, 0), (0.1, 1e-3, 2)):
        found = critical_stiffness(0.05, damping, tick, delay_ticks=delay, coulomb_N=0.2, quantum_m=4e-5)
        assert found == pytest.approx(limit_of_rest(0.2, 4e-5), rel=1e-4)


def test_wall_damping_reduces_the_limit_at_an_encoder_step() -> None:
    """The backward difference gives a force impulse BΔ/T at an encoder step."""
    free = critical_stiffness(0.045, 0.1, 1e-3, delay_ticks=1, wall_damping_Ns_m=0.0, coulomb_N=0.26, quantum_m=5.5e-5)
    assert (
        critical_stiffness(0.045, 0.1, 1e-3, delay_ticks=1, wall_damping_Ns_m=2.0, coulomb_N=0.26, quantum_m=5.5e-5)
        < 0.9 * free
    )


def test_growth_of_known_modes() -> None:
    k = np.arange(60)
    for largest in (0.9, 1.0, 1.01, 1.3):
        y = largest**k * np.cos(0.7 * k + 0.3) + 0.5 * (-0.6) ** k + 0.2 * 0.3**k
        assert growth(y, 4) == pytest.approx(math.log(largest), abs=1e-9)
