"""What a handle's memory is filled with: the lead against the amplifier, the prior against its parameters."""

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene.handle import COMPENSATORS, Plant, Sensor
from hapscene.handle.handle_dynamics import amplify
from hapscene.handle.handle_loop import _lead
from hapscene.handle.handle_record import RATE_MAX_HZ, RATE_MIN_HZ, new_handle

RATE_HZ = 10_000.0
LEADING = ("inverse", "flat", "adaptive")


def through(compensator: str, amplifier_Hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Random commands, and the mean force of each sample after lead filter and amplifier."""
    plant = Plant(amplifier_Hz=amplifier_Hz)
    h = new_handle(plant, plant, compensator, RATE_HZ)[0]
    command = np.random.default_rng(0).standard_normal(200)
    return command, np.array([amplify(h, _lead(h, a)) for a in command])


@pytest.mark.parametrize("compensator", sorted(COMPENSATORS))
def test_optional_lead_compensates_the_amplifier(compensator: str) -> None:
    command, force = through(compensator, 5000.0)
    assert (np.abs(force - command).max() < 1e-12) == (compensator in LEADING)


@pytest.mark.parametrize("compensator", LEADING)
def test_the_lead_of_a_slow_amplifier_is_bounded(compensator: str) -> None:
    """Up to 1 kHz it is undone to a tenth; what lies beyond is not amplified without end."""
    command, force = through(compensator, 1000.0)
    ratio = np.abs(np.fft.rfft(force, 4096) / np.fft.rfft(command, 4096))
    frequency = np.fft.rfftfreq(4096, 1.0 / RATE_HZ)
    assert ratio[frequency < 1000.0] == pytest.approx(1.0, abs=0.1) and ratio.max() < 3.0


def test_the_lower_limit_of_plant_and_nominal_plant_applies() -> None:
    strong, weak = Plant(force_limit_N=8.0, travel_limit_m=0.006), Plant(force_limit_N=2.0, travel_limit_m=0.002)
    for plant, nominal in ((strong, weak), (weak, strong)):
        h = new_handle(plant, nominal, "adaptive", RATE_HZ)[0]
        assert h.force_limit_N == 2.0 and h.room_m < 0.002 and h.travel_limit_m == plant.travel_limit_m
        assert h.m_h_kg == plant.m_h_kg and h.impact_N == 0.25 * nominal.force_limit_N


def test_neither_sensor_may_be_later_than_the_memory_is_long() -> None:
    for sensors in ((Sensor(9e-3), Sensor()), (Sensor(), Sensor(9e-3))):
        with pytest.raises(HandleError, match="delay_s must be at most"):
            new_handle(Plant(), Plant(), "adaptive", 100_000.0, 0, *sensors)


@pytest.mark.parametrize("rate_Hz", [0.99 * RATE_MIN_HZ, 1.01 * RATE_MAX_HZ, np.nan])
def test_rates_that_no_handle_has_are_refused(rate_Hz: float) -> None:
    with pytest.raises(HandleError, match="rate_Hz of a handle must be"):
        new_handle(Plant(), Plant(), "adaptive", rate_Hz)
