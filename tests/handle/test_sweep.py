"""The swept sine: its band, and the limits of coil travel and force."""

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene.handle.force_source import FIRM, LIGHT, SimulatedSource
from hapscene.handle.measure import REST_S, TRAVEL_SHARE, Sweep
from hapscene.handle.plant import Plant

RATE_HZ = 10_000.0


def test_sweep_covers_its_band_and_starts_and_ends_in_silence() -> None:
    force = Sweep(sweep_s=4.0).force(RATE_HZ, Plant())
    rest = round(REST_S * RATE_HZ)
    assert len(force) == 4 * RATE_HZ + rest and force[0] == 0.0 and not force[-rest:].any()
    power = np.abs(np.fft.rfft(force)) ** 2
    frequency = np.fft.rfftfreq(len(force), 1.0 / RATE_HZ)
    within = (frequency >= 10.0) & (frequency <= 1000.0)
    assert power[within].sum() > 0.97 * power.sum()
    bands = np.add.reduceat(power, np.searchsorted(frequency, np.geomspace(10.0, 1000.0, 40)))
    assert bands[:-1].min() > 1e-3 * bands[:-1].max()


@pytest.mark.parametrize("hand", [LIGHT, FIRM])
def test_travel_stays_inside_its_share_for_the_guessed_handle(hand: tuple[float, float]) -> None:
    plant = Plant(k_u_N_m=hand[0], b_u_Ns_m=hand[1])
    force = Sweep(force_N=6.6).force(RATE_HZ, Plant())
    assert 5.0 < np.abs(force).max() <= 6.6
    source = SimulatedSource(plant, RATE_HZ, tremor_N=0.0)
    _, travel_m = source.advance(force)
    assert np.abs(travel_m).max() <= 1.4 * TRAVEL_SHARE * plant.travel_limit_m


@pytest.mark.parametrize(
    ("numbers", "word"),
    [
        ({"low_Hz": 0.0}, "band"),
        ({"low_Hz": 600.0}, "band"),
        ({"sweep_s": 1.0}, "duration"),
        ({"force_N": 0.0}, "force"),
        ({"high_Hz": float("nan")}, "band"),
    ],
)
def test_sweeps_out_of_range_are_refused(numbers: dict[str, float], word: str) -> None:
    with pytest.raises(HandleError, match=word):
        Sweep(**numbers)


def test_the_force_is_the_farina_sweep_within_the_travel() -> None:
    """Its phase in closed form, and the amplitude of the plant's largest travel nearby."""
    sweep, plant = Sweep(20.0, 500.0, 2.0, 2.0), Plant()
    f_Hz = np.array([20.0, 25.0, 60.0, 400.0])
    near = plant.travel_response(f_Hz[:, None] * np.geomspace(1.0 / 1.5, 1.5, 25))
    wanted = np.minimum(2.0, 0.5 * plant.travel_limit_m / np.abs(near).max(axis=1))
    assert sweep.amplitude(f_Hz, plant) == pytest.approx(wanted) and wanted[0] < 1.0 < wanted[3] == 2.0
    assert (sweep.amplitude(f_Hz, Plant(force_limit_N=0.5)) <= 0.5).all()
    force, first, octaves = sweep.force(5000.0, plant), 20.0 / 1.06, np.log(500.0 * 1.06 / 20.0 * 1.06)
    t_s = np.array([3000, 8000, 9990]) / 5000.0
    at_Hz = first * np.exp(octaves * t_s / 2.0)
    fade = np.sin(0.5 * np.pi * np.clip((2.0 - t_s) / (2.0 * np.log(1.06) / octaves), 0.0, 1.0)) ** 2
    wave = np.sin(2.0 * np.pi * 2.0 / octaves * (at_Hz - first))
    assert force[[3000, 8000, 9990]] == pytest.approx(sweep.amplitude(at_Hz, plant) * fade * wave, rel=1e-3)
    assert len(force) == 15_000


def test_a_rate_too_low_for_the_band_is_refused() -> None:
    with pytest.raises(HandleError, match=r"1000 Hz.*800 Hz"):
        Sweep().force(2000.0, Plant())
