"""The critical stiffness from simulation against closed forms."""

import math

import numpy as np
import pytest

from hapscene.device.model import stability_border
from hapscene.errors import HapsceneError
from hapscene.stability import critical_stiffness
from hapscene.stability.critical import growth
from tests.stability.closed_form import (
    limit_of_passivity,
    limit_of_rest,
    limit_of_small_motion,
    limit_with_one_delay,
    limit_with_wall_damping,
    limit_without_delay,
)


def test_device_damping_alone() -> None:
    for damping in (0.005, 0.1, 10.0):
        assert critical_stiffness(0.05, damping, 1e-3) == pytest.approx(
            limit_without_delay(0.05, damping, 1e-3), rel=1e-7
        )


def test_delay_of_one_tick() -> None:
    assert critical_stiffness(0.05, 0.1, 2e-4, delay_ticks=1) == pytest.approx(
        limit_with_one_delay(0.05, 0.1, 2e-4), rel=1e-7
    )


def test_wall_damping_alone() -> None:
    for beta in (0.05, 1.0, 1.95):
        assert critical_stiffness(1.0, 0.0, 1.0, delay_ticks=0, wall_damping_Ns_m=beta) == pytest.approx(
            limit_with_wall_damping(1.0, beta, 1.0), rel=1e-6
        )


def test_scaling_with_units() -> None:
    """Masses and dampings times s: K times s. T times s and dampings over s: K over s²."""
    base = critical_stiffness(0.1, 0.2, 1e-3, delay_ticks=2, wall_damping_Ns_m=0.5)
    assert critical_stiffness(0.3, 0.6, 1e-3, delay_ticks=2, wall_damping_Ns_m=1.5) == pytest.approx(
        3.0 * base, rel=1e-7
    )
    assert critical_stiffness(0.1, 0.1, 2e-3, delay_ticks=2, wall_damping_Ns_m=0.25) == pytest.approx(
        base / 4.0, rel=1e-7
    )


def test_any_delay_and_damping() -> None:
    rng = np.random.default_rng(7)
    for _ in range(6):
        mass, tick, delay = 10.0 ** rng.uniform(-2, 0), 10.0 ** rng.uniform(-4, -2.5), int(rng.integers(0, 5))
        damping, wall = mass / tick * 10.0 ** rng.uniform(-4, 1), mass / tick * rng.uniform(0.0, 0.4) / (1 + delay)
        expected = limit_of_small_motion(mass, damping, tick, delay, wall)
        assert critical_stiffness(mass, damping, tick, delay_ticks=delay, wall_damping_Ns_m=wall) == pytest.approx(
            expected, rel=1e-6
        )


def test_without_dissipation() -> None:
    assert critical_stiffness(1.0, 0.0, 1.0) == 0.0
    assert critical_stiffness(0.05, 0.0, 1e-3, delay_ticks=2) == 0.0


def test_wall_damping_beyond_the_largest() -> None:
    assert critical_stiffness(1.0, 0.0, 1.0, delay_ticks=0, wall_damping_Ns_m=2.05) == 0.0
    assert critical_stiffness(1.0, 0.0, 1.0, delay_ticks=1, wall_damping_Ns_m=0.85) == 0.0


def test_near_the_largest_wall_damping() -> None:
    """A mode that alternates from tick to tick decays as slowly as those of the spring."""
    for delay, damping, share in (
        (0, 1e-3, 0.999),
        (0, 0.0, 0.9997),
        (0, 0.1, 0.9999),
        (1, 1e-3, 0.9999),
        (4, 0.0, 0.9999),
    ):
        wall = share * stability_border(1.0, damping, 1.0, delay)[1][-1]
        expected = limit_of_small_motion(1.0, damping, 1.0, delay, wall)
        assert critical_stiffness(1.0, damping, 1.0, delay_ticks=delay, wall_damping_Ns_m=wall) == pytest.approx(
            expected, rel=2e-6
        )


@pytest.mark.parametrize(
    ("delay", "damping", "share"), [(30, 1e-3, 0.9), (200, 0.1, 0.0), (255, 1e-3, 0.3), (200, 1.0, 0.5)]
)
def test_long_delays(delay: int, damping: float, share: float) -> None:
    wall = share * stability_border(1.0, damping, 1.0, delay)[1][-1]
    expected = limit_of_small_motion(1.0, damping, 1.0, delay, wall)
    assert critical_stiffness(1.0, damping, 1.0, delay_ticks=delay, wall_damping_Ns_m=wall) == pytest.approx(
        expected, rel=1e-6
    )


def test_rest_between_encoder_steps() -> None:
    """Depends on friction and encoder step only, not on b, T and d."""
    for damping, tick, delay in ((0.005, 1e-3, 0), (1.0, 1e-4, 0), (0.1, 1e-3, 2)):
        found = critical_stiffness(0.05, damping, tick, delay_ticks=delay, coulomb_N=0.2, quantum_m=4e-5)
        assert found == pytest.approx(limit_of_rest(0.2, 4e-5), rel=1e-4)


def test_rest_above_the_limit_of_passivity() -> None:
    """Friction holds the tool at walls that are not passive."""
    found = critical_stiffness(0.072, 0.005, 1e-3, coulomb_N=0.038, quantum_m=3e-5)
    assert found > 100.0 * limit_of_passivity(0.005, 0.0, 1e-3)


def test_wall_damping_reduces_the_limit_at_an_encoder_step() -> None:
    """The backward difference gives a force impulse BΔ/T at an encoder step."""
    free = critical_stiffness(0.045, 0.1, 1e-3, delay_ticks=1, wall_damping_Ns_m=0.0, coulomb_N=0.26, quantum_m=5.5e-5)
    assert (
        critical_stiffness(0.045, 0.1, 1e-3, delay_ticks=1, wall_damping_Ns_m=2.0, coulomb_N=0.26, quantum_m=5.5e-5)
        < 0.9 * free
    )


def test_friction_or_encoder_steps_alone() -> None:
    assert critical_stiffness(0.05, 0.1, 1e-3, coulomb_N=0.1) == math.inf
    assert critical_stiffness(0.05, 0.1, 1e-3, quantum_m=1e-5) == 0.0


@pytest.mark.parametrize(
    ("numbers", "name"),
    [
        ({"mass_kg": 0.0}, "mass_kg"),
        ({"tick_s": math.nan}, "tick_s"),
        ({"damping_Ns_m": -1.0}, "damping_Ns_m"),
        ({"wall_damping_Ns_m": math.inf}, "wall_damping_Ns_m"),
        ({"coulomb_N": -0.1}, "coulomb_N"),
        ({"quantum_m": -1e-5}, "quantum_m"),
        ({"delay_ticks": 256}, "delay_ticks"),
        ({"delay_ticks": 0.5}, "delay_ticks"),
        ({"delay_ticks": math.nan}, "delay_ticks"),
        ({"mass_kg": 1e-300}, "check the units"),
        ({"damping_Ns_m": 1e300}, "check the units"),
        ({"damping_Ns_m": 1e-300}, "check the units"),
        ({"tick_s": 1e-300}, "check the units"),
    ],
)
def test_numbers_out_of_range(numbers: dict[str, float], name: str) -> None:
    defaults = {"mass_kg": 0.05, "damping_Ns_m": 0.1, "tick_s": 1e-3}
    with pytest.raises(HapsceneError, match=name):
        critical_stiffness(**(defaults | numbers))  # type: ignore[arg-type]


def test_growth_of_known_modes() -> None:
    k = np.arange(60)
    for largest in (0.9, 1.0, 1.01, 1.3):
        y = largest**k * np.cos(0.7 * k + 0.3) + 0.5 * (-0.6) ** k + 0.2 * 0.3**k
        assert growth(y, 4) == pytest.approx(math.log(largest), abs=1e-9)
