"""AR models with sensor noise: order and filter of known surfaces are recovered."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.order import search_order
from hapscene.capture.fit.whittle import NoisyModel, _derivatives, density, judged, over_noise, refined
from hapscene.capture.io.streams import clean
from hapscene.dsp.ar_filter import power_gain

from ..signals import fit

RATE = 10_000.0


def resonant(frequency_Hz, width_Hz, rate_Hz=RATE):
    """Filter with resonances of given frequencies and widths (−3 dB)."""
    a = np.array([1.0])
    for f, w in zip(frequency_Hz, width_Hz, strict=True):
        radius = np.exp(-np.pi * w / rate_Hz)
        a = np.convolve(a, [1.0, -2.0 * radius * np.cos(2 * np.pi * f / rate_Hz), radius**2])
    return a


def noisy(a, count, snr_dB, seed=0):
    """Noise through 1/A with variance 1, plus white noise."""
    rng = np.random.default_rng(seed)
    y = lfilter([1.0], a, rng.standard_normal(count + 5000))[5000:]
    y /= y.std()
    return y + 10 ** (-snr_dB / 20) * rng.standard_normal(count)


LOW = [
    ([220], [60]),
    ([150, 500], [40, 60]),
    ([120, 380, 800], [50, 60, 90]),
    ([200, 450, 700, 950], [50, 50, 70, 70]),
]


@pytest.mark.parametrize("snr_dB", [20.0, np.inf])
@pytest.mark.parametrize(("frequency_Hz", "width_Hz"), LOW)
def test_all_resonances_below_1_kHz(frequency_Hz, width_Hz, snr_dB):
    """At 10 kHz and 20 dB SNR, plain linear prediction would need orders of 5 to 50 instead of 2 to 8."""
    truth = resonant(frequency_Hz, width_Hz)
    texture = fit(noisy(truth, 60_000, snr_dB, seed=len(frequency_Hz)), RATE).texture
    assert abs(texture.order - 2 * len(frequency_Hz)) <= 2
    a, variance = texture.model(10.0, 10.0)
    frequency = np.arange(30.0, 1000.0, 5.0)
    model = spectral.model_spectrum(a, variance, RATE, frequency)
    should = spectral.model_spectrum(truth, 1.0 / power_gain(truth), RATE, frequency)
    above = should > 2.0 * 10 ** (-snr_dB / 10) / RATE  # below the noise the spectrum is unknown
    assert spectral.log_spectral_distance(model[above], should[above], frequency[above]) < 0.7


def test_noise_and_surface_are_separated():
    truth = resonant([150, 500], [40, 60])
    model = over_noise(clean(noisy(truth, 60_000, 20.0), RATE).acceleration_m_s2, RATE, 30)
    assert model.order == 4
    assert np.exp(model.log_noise) == pytest.approx(0.01, rel=0.05)
    np.testing.assert_allclose(np.sort(np.abs(np.angle(np.roots(model.a)))), np.sort(np.abs(np.angle(np.roots(truth)))),
                               atol=2 * np.pi * 5 / RATE)  # fmt: skip


def test_other_signals_get_no_model_with_noise(shared):
    rng = np.random.default_rng(0)
    assert over_noise(clean(rng.standard_normal(20_000), RATE).acceleration_m_s2, RATE, 20) is None  # noise alone
    changed = np.concatenate([noisy(resonant([f, 600], [40, 60]), 20_000, 20.0) for f in (150, 350)])
    assert over_noise(clean(changed, RATE).acceleration_m_s2, RATE, 20) is None  # its halves differ
    accel = np.loadtxt(shared / "data" / "recordings" / "cdp_leather.csv", delimiter=",", skiprows=1)[:, 2]
    assert search_order(clean(accel, RATE).acceleration_m_s2, RATE).noise is None


def test_scoring_improves_and_stays_stable():
    """Random stable initial values and spectra of random models."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        truth = resonant(rng.uniform(60, 900, 3), rng.uniform(30, 150, 3))
        spectrum = density([noisy(truth, 10_000, 20.0, int(rng.integers(1 << 30)))], RATE)
        radius, angle = rng.uniform(0.1, 0.99, 4), rng.uniform(0.05, 3.0, 4)
        start = NoisyModel(np.stack([-2 * radius * np.cos(angle), radius**2], axis=1), 0.0, np.log(spectrum.noise_max))
        end = refined(start, spectrum)
        whole = start.parts(spectrum)[2]
        assert end.loss <= np.sum(spectrum.ordinates * (np.log(whole) + spectrum.power / whole)) + 1e-6
        assert np.all(np.abs(np.roots(end.a)) < 1.0)
        assert np.exp(end.log_noise) <= spectrum.noise_max * (1 + 1e-9)


def some_model(spectrum, seed=0):
    rng = np.random.default_rng(seed)
    radius, angle = rng.uniform(0.6, 0.95, 3), rng.uniform(0.1, 2.8, 3)
    section = np.stack([-2 * radius * np.cos(angle), radius**2], axis=1)
    return NoisyModel(section, 0.3, np.log(0.5 * spectrum.noise_max))


def test_spectrum_and_loss_of_a_model():
    spectrum = density([noisy(resonant([300, 700], [60, 60]), 20_000, 20.0)], RATE)
    model = judged(some_model(spectrum), spectrum)
    _, response = freqz([1.0], model.a, worN=spectrum.frequency_Hz, fs=RATE)
    _, clear, whole = model.parts(spectrum)
    exact = np.exp(0.3) * np.abs(response) ** 2
    np.testing.assert_allclose(clear, exact)
    np.testing.assert_allclose(whole, exact + 0.5 * spectrum.noise_max)
    assert model.loss == pytest.approx(np.sum(spectrum.ordinates * (np.log(whole) + spectrum.power / whole)))


def test_gradient_and_information_by_differences():
    spectrum = density([noisy(resonant([300, 700], [60, 60]), 20_000, 20.0)], RATE)
    model = some_model(spectrum)

    def loss(x, power):
        moved = NoisyModel(x[:-2].reshape(-1, 2), x[-2], x[-1])
        whole = moved.parts(spectrum)[2]
        return np.sum(spectrum.ordinates * (np.log(whole) + power / whole))

    x, step = np.append(model.section.ravel(), [model.log_variance, model.log_noise]), 1e-4 * np.eye(8)
    gradient, information = _derivatives(model, spectrum, np.inf)
    slope = [(loss(x + h, spectrum.power) - loss(x - h, spectrum.power)) / 2e-4 for h in step]
    np.testing.assert_allclose(gradient, slope, rtol=1e-4, atol=1e-4 * np.abs(slope).max())
    true = model.parts(spectrum)[2]  # at the model's own spectrum the curvature is the information
    curved = [[(loss(x + g + h, true) - loss(x + g - h, true) - loss(x - g + h, true) + loss(x - g - h, true)) / 4e-8
               for h in step] for g in step]  # fmt: skip
    np.testing.assert_allclose(information, curved, rtol=1e-2, atol=1e-3 * np.abs(information).max())
