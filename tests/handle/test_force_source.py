"""The simulated handle against SciPy's own simulation, and against eq. 8."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, welch

from hapscene.errors import HandleError
from hapscene.handle.fit import sampled_response
from hapscene.handle.force_source import FIRM, LIGHT, SimulatedSource, grip_names, simulated_grips
from hapscene.handle.plant import Plant

RATE_HZ = 10_000.0


def quiet(plant: Plant, **more: float) -> SimulatedSource:
    return SimulatedSource(plant, RATE_HZ, **{"noise_m_s2_rtHz": 0.0, "tremor_N": 0.0, **more})


def test_without_noise_it_is_the_three_systems_in_a_row() -> None:
    """Amplifier, plant and accelerometer one after another in SciPy, at ten times the rate."""
    plant = Plant()
    force = np.random.default_rng(0).standard_normal(400) * 0.1
    _, got = quiet(plant).play(force)
    fine = np.repeat(force, 10)
    t_s = np.arange(len(fine)) / (10 * RATE_HZ)
    a, b, c, d = plant.state_space()
    amplifier, sensor = 2 * np.pi * plant.amplifier_Hz, 2 * np.pi * 1600.0
    _, through, _ = lsim(([[-amplifier]], [[amplifier]], [[1.0]], [[0.0]]), fine, t_s, interp=False)
    _, moved, _ = lsim((a, b, c[:1], d[:1]), through, t_s)
    _, read, _ = lsim(([[-sensor]], [[sensor]], [[1.0]], [[0.0]]), moved, t_s)
    np.testing.assert_allclose(got, read[::10], atol=3e-3 * np.abs(read).max())


@pytest.mark.parametrize(("rate_Hz", "tolerance"), [(10_000.0, 4e-5), (5000.0, 4e-4), (3000.0, 2.5e-3)])
def test_its_response_is_that_of_the_model(rate_Hz: float, tolerance: float) -> None:
    """The transform of the impulse response equals `sampled_response` within its stated error."""
    plant = Plant(k_u_N_m=2000.0, b_u_Ns_m=10.0)
    source = SimulatedSource(plant, rate_Hz, 0.0, tremor_N=0.0)
    impulse = np.zeros(round(4 * rate_Hz))
    impulse[0] = 0.01
    _, acceleration = source.play(impulse)
    frequency = np.fft.rfftfreq(len(impulse), 1.0 / rate_Hz)
    within = (frequency >= 10.0) & (frequency <= 1000.0)
    measured = np.fft.rfft(acceleration)[within] / 0.01
    poles = 0.5 / np.pi / np.array([plant.amplifier_Hz, 1600.0])
    model = sampled_response(plant, frequency[within], rate_Hz, *poles, 0.0)
    assert np.abs(model / measured - 1.0).max() < tolerance


def test_high_rate_without_lag_equals_eq_8() -> None:
    plant, frequency = Plant(), np.geomspace(10.0, 1000.0, 50)
    np.testing.assert_allclose(
        sampled_response(plant, frequency, 1e7, 0.0, 0.0, 0.0), plant.response(frequency), rtol=1e-3
    )


def test_noise_has_the_density_that_is_asked_for() -> None:
    source = SimulatedSource(Plant(), RATE_HZ, noise_m_s2_rtHz=0.01, tremor_N=0.0)
    _, reading = source.play(np.zeros(200_000))
    frequency, density = welch(reading, RATE_HZ, nperseg=4096)
    low = (frequency > 50.0) & (frequency < 400.0)
    assert np.sqrt(density[low].mean()) == pytest.approx(0.01, rel=0.03)


def test_unrest_is_a_force_on_the_handle() -> None:
    """Held by a stiff hand, the handle's position is the force of unrest over that hand's stiffness."""
    plant = Plant(k_u_N_m=1e6, b_u_Ns_m=800.0)
    source = SimulatedSource(plant, RATE_HZ, noise_m_s2_rtHz=0.0, tremor_N=0.05)
    positions = []
    for _ in range(3000):
        source.advance(np.zeros(100))
        positions.append(source._state[0, 0])
    assert np.std(positions) * plant.k_u_N_m == pytest.approx(0.05, rel=0.1)


def test_forces_beyond_the_limits_are_refused() -> None:
    with pytest.raises(HandleError, match=r"7 N.*6\.6 N"):
        quiet(Plant()).play(np.full(10, 7.0))
    with pytest.raises(HandleError, match="travel"):
        quiet(Plant()).play(np.full(5000, 3.0))


def test_grips_go_from_light_to_firm() -> None:
    grips = simulated_grips(5, seed=1)
    assert [name for name, _, _ in grips] == grip_names(5)
    stiffness = [k for _, k, _ in grips]
    assert stiffness == sorted(stiffness)
    assert stiffness[0] == pytest.approx(LIGHT[0], rel=0.4) and stiffness[-1] == pytest.approx(FIRM[0], rel=0.4)
    assert replace(Plant(), k_u_N_m=simulated_grips(1)[0][1]).k_u_N_m == pytest.approx(548.0, rel=0.4)
