from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete, lfilter

from hapscene.handle import Plant
from hapscene.handle.handle_dynamics import amplify, move, sense
from hapscene.handle.handle_loop import vibrate
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import ACCELEROMETER_NOISE_M_S2_RTHZ

RATE_HZ = 10_000.0


def at_rest(plant: Plant, rate_Hz: float = RATE_HZ) -> Any:
    return new_handle(plant, plant, "none", rate_Hz)[0]


@settings(max_examples=30, deadline=None)
@given(
    st.floats(0.005, 0.05),
    st.floats(50.0, 5000.0),
    st.floats(0.02, 0.5),
    st.floats(0.0, 5000.0),
    st.sampled_from([2500.0, 10_000.0, 48_000.0]),
)
def test_step_equals_the_matrix_exponential_of_scipy(
    m_c: float, k_s: float, m_h: float, k_u: float, rate_Hz: float
) -> None:
    plant = Plant(m_c_kg=m_c, k_s_N_m=k_s, m_h_kg=m_h, k_u_N_m=k_u)
    a, b, *_ = cont2discrete(plant.state_space(), 1.0 / rate_Hz)
    step = at_rest(plant, rate_Hz).step
    assert step[:4, :4] == pytest.approx(a, rel=1e-9, abs=1e-13)
    assert step[:4, 4:] == pytest.approx(b, rel=1e-9, abs=1e-13)
    assert step[4] == pytest.approx([0.0, 0.0, 0.0, 0.0, 1.0])


def test_acceleration_force_and_travel_are_the_plants() -> None:
    """The acceleration is that of SciPy's discretised plant for the force that is reported."""
    from scipy.signal import dlsim

    plant = Plant(travel_limit_m=0.05)
    handle = new_handle(plant, plant, "naive", RATE_HZ)[0]
    desired = np.random.default_rng(0).standard_normal(1000)
    played = np.array([vibrate(handle, a) for a in desired])
    _, y, _ = dlsim(cont2discrete(plant.state_space(), 1.0 / RATE_HZ), played[:, 2:])
    assert handle.hits == 0
    assert played[:, 0] == pytest.approx(y[:, 0], abs=1e-9)
    assert played[:-1, 1] == pytest.approx(y[1:, 2], abs=1e-12)  # displacement at the end of the sample


def test_amplifier_is_one_pole_averaged_over_a_sample() -> None:
    handle = at_rest(Plant(amplifier_Hz=2000.0))
    got = np.array([amplify(handle, 1.0) for _ in range(20)])
    t = np.arange(20 * 1000 + 1) / (1000 * RATE_HZ)
    force = 1.0 - np.exp(-2.0 * np.pi * 2000.0 * t)
    mean = [np.trapezoid(force[k * 1000 : (k + 1) * 1000 + 1], dx=1e-3) for k in range(20)]
    assert got == pytest.approx(mean, rel=1e-6)


def test_coil_stays_at_its_stop_and_momentum_is_conserved() -> None:
    plant = replace(Plant(), k_u_N_m=1e-6, b_u_Ns_m=0.0, travel_limit_m=0.002)
    handle = at_rest(plant)
    dt, momentum, centre, speeds = 1.0 / RATE_HZ, [], [], []
    velocity = 0.0
    for _ in range(400):
        velocity += dt * move(handle, 3.0)
        x = handle.x
        assert abs(x[2]) <= plant.travel_limit_m
        momentum.append((plant.m_h_kg + plant.m_c_kg) * x[1] + plant.m_c_kg * x[3])
        centre.append((plant.m_h_kg + plant.m_c_kg) * x[0] + plant.m_c_kg * x[2])
        speeds.append((velocity, x[1]))
    assert handle.hits >= 1 and handle.x[2] == -plant.travel_limit_m
    assert (
        np.abs(momentum).max() < 1e-6 and np.abs(centre).max() < 1e-8
    )  # no force from outside but a grip of almost nothing
    reported, true = np.transpose(speeds)
    assert np.abs(reported - true).max() < 0.02 * np.abs(true).max()  # the knock, too, is in the acceleration


def test_the_accelerometer_has_its_noise_and_its_pole() -> None:
    handle = at_rest(Plant())
    read = np.array([sense(handle, 0.0) for _ in range(10_000)])
    pole = handle.sensor_pole
    white = lfilter([1.0 / (1.0 - pole), -pole / (1.0 - pole)], [1.0], read)
    assert white.std() == pytest.approx(ACCELEROMETER_NOISE_M_S2_RTHZ * np.sqrt(0.5 * RATE_HZ), rel=0.03)
    for _ in range(1000):
        read[0] = sense(handle, 5.0)
    assert read[0] == pytest.approx(5.0, abs=0.5)
