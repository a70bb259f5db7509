"""The simulated handle against SciPy's own simulation, and against eq. 8."""

import numpy as np
import pytest
from scipy.signal import lsim

from hapscene.errors import HandleError
from hapscene.handle.fit import sampled_response
from hapscene.handle.force_source import SimulatedSource
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


def test_noise_and_tremor_have_their_densities() -> None:
    """Noise of the accelerometer, through its pole; tremor, as recorded."""
    still = np.zeros(400_000)
    noise = SimulatedSource(Plant(), RATE_HZ, 0.02, tremor_N=0.0).advance(still)[0]
    assert noise.std() == pytest.approx(np.sqrt(2.0 * RATE_HZ * np.tanh(np.pi * 1600.0 / RATE_HZ)) * 0.01, rel=0.02)
    free = SimulatedSource(Plant(k_u_N_m=0.0), RATE_HZ, 0.0, tremor_N=0.1).advance(still)[0]
    assert free.std() == pytest.approx(0.6165648, rel=1e-6)


def test_forces_beyond_the_limits_are_refused() -> None:
    with pytest.raises(HandleError, match=r"7 N.*6\.6 N"):
        quiet(Plant()).play(np.full(10, 7.0))
    plant, rise = Plant(), 0.5 - 0.5 * np.cos(np.pi * np.arange(10_000) / 10_000)  # slow: the spring carries the force
    most_N = plant.k_s_N_m * plant.travel_limit_m
    quiet(plant).play(0.97 * most_N * rise)
    with pytest.raises(HandleError, match="travel"):
        quiet(plant).play(1.03 * most_N * rise)
