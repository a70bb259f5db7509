"""Fits to recordings of known models, to real recordings, and to invalid input."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import resample_poly

from hapscene.capture import load_recording, synthesize
from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.order import search_domain
from hapscene.capture.fit.swatch import verdict
from hapscene.capture.io.streams import clean, kept_share
from hapscene.dsp.linear_prediction import autocorrelation, solve, tapered
from hapscene.errors import CaptureError
from hapscene.perception import bands_jnd
from hapscene.swatches.library import load_swatch

from ..signals import fit, played, resonant


@pytest.mark.parametrize(
    ("frequency_Hz", "radius", "rate_Hz", "snr_dB"),
    [
        ([150, 500, 900], 0.9, 2000.0, 20.0),
        ([150, 350, 600, 850], 0.9, 2000.0, 20.0),
        ([100, 300, 500, 700, 900], 0.9, 2000.0, 20.0),
        ([150, 600], 0.975, 10_000.0, np.inf),
    ],
)
def test_a_known_order_is_found(frequency_Hz: list[float], radius: float, rate_Hz: float, snr_dB: float) -> None:
    truth = resonant(frequency_Hz, radius, rate_Hz)
    swatch = fit(played(truth, int(10 * rate_Hz), snr_dB=snr_dB), rate_Hz)
    assert swatch.texture is not None
    assert abs(swatch.texture.order - (len(truth) - 1)) <= 2


def test_two_surfaces_in_one_recording_are_separated_by_speed() -> None:
    rate = 2000.0
    slow, fast = resonant([200, 500], 0.9, rate), resonant([300, 800], 0.9, rate)
    parts = [played(a, 1000, seed) * gain for seed in range(12) for a, gain in ((slow, 1.0), (fast, 3.0))]
    speed = np.repeat(np.tile([0.1, 0.25], 12), 1000)
    force = 1.0 + 0.05 * np.sin(np.arange(len(speed)) / 500)
    swatch = fit(np.concatenate(parts), rate, force_N=force, speed_m_s=speed)
    assert swatch.texture is not None
    assert 2 <= np.count_nonzero(swatch.texture.variance_m2_s4) <= 4
    frequency = np.linspace(30.0, 950.0, 200)
    for truth, gain, v in ((slow, 1.0, 0.1), (fast, 3.0, 0.25)):
        a, variance = swatch.texture.model(1.0, v)
        model = spectral.model_spectrum(a, variance, rate, frequency)
        should = spectral.model_spectrum(truth, gain**2, rate, frequency)
        assert np.sqrt(np.mean((10.0 * np.log10(model / should)) ** 2)) < 1.5  # [dB], shape and level


def test_the_power_of_the_recording_is_matched() -> None:
    rate, count = 5000.0, 40_000
    t = np.arange(count) / rate
    force, speed = 1.5 + 0.5 * np.sin(2.1 * t), 0.15 + 0.06 * np.sin(3.3 * t + 1)
    a = resonant([200, 700], 0.95, rate)
    acceleration = played(a, count) * np.sqrt(force * speed)
    swatch = fit(acceleration, rate, force_N=force, speed_m_s=speed, order=6)
    assert swatch.texture is not None
    recorded = clean(acceleration, rate).acceleration_m_s2.var()
    assert abs(10 * np.log10(swatch.texture.power(force, speed).mean() / recorded)) < 0.05
    assert abs(spectral.level_difference_dB(synthesize(swatch, force, speed), acceleration)) < 0.5


NOISE = np.random.default_rng(1).standard_normal(5000)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"acceleration_m_s2": NOISE[:100]}, "100 samples"),
        ({"acceleration_m_s2": np.full(5000, 9.81)}, "acceleration"),
        ({"acceleration_m_s2": np.where(NOISE > 3, np.nan, NOISE)}, "acceleration_m_s2: sample"),
        ({"acceleration_m_s2": NOISE + 1j}, "complex128"),
        ({"acceleration_m_s2": 1e7 * NOISE}, "acceleration_m_s2: sample"),
        ({"rate_Hz": np.nan}, "rate_Hz"),
        ({"force_N": NOISE[:10]}, "force_N"),
        ({"force_N": 0.0}, "force_N"),
        ({"order": 0}, "order"),
        ({"order": "best"}, "order"),
        ({"model_count": 0}, "model_count"),
        ({"domain": "bark"}, "domain"),
        ({"tangential_force_N": 50.0}, "friction"),
    ],
)
def test_invalid_input_is_refused(change: dict[str, object], name: str) -> None:
    arguments = {"acceleration_m_s2": NOISE, "rate_Hz": 1000.0} | change
    with pytest.raises(CaptureError, match=name):
        fit(**arguments)


@pytest.mark.parametrize(
    ("acceleration", "streams", "start"),
    [
        (np.sin(1.4 * np.arange(10_000)), {"force_N": 1.0, "speed_m_s": 0.1}, "record more: 100 %"),
        (NOISE, {}, "usable for texture (at an assumed force and speed); not measured: taps"),
        (NOISE, {"force_N": 1.0, "speed_m_s": 0.1, "tangential_force_N": 0.3}, "usable for texture, friction;"),
    ],
)
def test_the_verdict_states_what_a_fit_can_be_used_for(
    acceleration: np.ndarray, streams: dict[str, float], start: str
) -> None:
    assert verdict(fit(acceleration, 2000.0, **streams)).startswith(start)


RECORDINGS = {
    "leather": "cdp_leather.csv",
    "paper": "cdp_paper.csv",
    "wood": "cdp_wood.csv",
    "epoxy": "lmt108_G1EpoxyRasterPlate_Movement_X_test1.txt",
}
COLUMNS, UNITS = {"acceleration": "accel"}, {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}


def recorded(name: str, shared: Path) -> np.ndarray:
    path = shared / "data" / "recordings" / RECORDINGS[name]
    columns, units = (COLUMNS, UNITS) if path.suffix == ".csv" else (None, {"acceleration": "g"})
    return load_recording(path, 10_000.0, columns=columns, units=units).acceleration_m_s2


def held_out_jnd(a: np.ndarray, signal: np.ndarray, rate_Hz: float, warp: float = 0.0) -> float:
    """Difference of a model from a signal in bands, without level, rms [JND]."""
    frequency, density = spectral.spectrum(signal, rate_Hz)
    model = spectral.model_spectrum(a, 1.0, rate_Hz, frequency, warp) * kept_share(frequency)
    power = [spectral.band_power(one, frequency) for one in (model, density)]
    return float(bands_jnd(*(np.sqrt(one / one.sum() * power[1].sum()) for one in power), spectral.BAND_EDGES_HZ))


@pytest.mark.parametrize("rate_Hz", [10_000.0, 5_000.0])
@pytest.mark.parametrize("name", RECORDINGS)
def test_order_on_real_recordings(name: str, rate_Hz: float, shared: Path) -> None:
    """The model of one half differs from the other half hardly more than one of order 120, that of the paper."""
    signal = recorded(name, shared)
    if rate_Hz < 10_000.0:
        signal = resample_poly(signal, 1, 2)
    halves = np.array_split(signal, 2)
    for train, held_out in (halves, halves[::-1]):
        swatch = fit(train, rate_Hz, model_count=1)
        test = clean(held_out, rate_Hz).acceleration_m_s2
        assert swatch.texture is not None and swatch.texture.order <= 30
        jnd = held_out_jnd(swatch.texture.model(10.0, 10.0)[0], test, rate_Hz, swatch.texture.warp)
        paper = solve(autocorrelation(tapered(clean(train, rate_Hz).acceleration_m_s2, rate_Hz), 120))
        assert jnd <= held_out_jnd(paper, test, rate_Hz) + 0.2


@pytest.mark.parametrize("name", RECORDINGS)
def test_shipped_swatches_are_reproducible(name: str, shared: Path) -> None:
    texture = load_swatch(name).texture
    assert texture is not None
    filtered = clean(recorded(name, shared), 10_000.0).acceleration_m_s2
    search = search_domain(filtered, 10_000.0)
    assert (texture.order, texture.warp) == (search.chosen, search.warp)
    i = texture.order - search.orders[0]
    assert search.distance_dB[i] <= max(search.floor_dB, 1.1 * search.distance_dB.min())
