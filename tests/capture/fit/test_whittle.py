"""Known surfaces under white noise: their order and filter come back, and what is none is left alone."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.order import search_order
from hapscene.capture.fit.texture import choose_model_count, fit_texture
from hapscene.capture.fit.whittle import LOW_HZ, NoisyModel, _derivatives, density, judged, over_noise, refined
from hapscene.capture.fit.windows import cut
from hapscene.capture.io.streams import clean
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import tapered

from ..signals import fit

RATE = 10_000.0


def resonant(frequency_Hz, width_Hz, rate_Hz=RATE):
    """The filter with a resonance at each frequency, of that width (−3 dB)."""
    a = np.array([1.0])
    for f, w in zip(frequency_Hz, width_Hz, strict=True):
        radius = np.exp(-np.pi * w / rate_Hz)
        a = np.convolve(a, [1.0, -2.0 * radius * np.cos(2 * np.pi * f / rate_Hz), radius**2])
    return a


def noisy(a, count, snr_dB, seed=0):
    """Noise through 1/A, variance 1, and white noise beneath."""
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
    """At 10 kHz: plain linear prediction needs orders of 5 to 50 for 2 to 8 under noise of 20 dB."""
    truth = resonant(frequency_Hz, width_Hz)
    texture = fit(noisy(truth, 60_000, snr_dB, seed=len(frequency_Hz)), RATE).texture
    assert abs(texture.order - 2 * len(frequency_Hz)) <= 2
    a, variance = texture.model(10.0, 10.0)
    frequency = np.arange(30.0, 1000.0, 5.0)
    model = spectral.model_spectrum(a, variance, RATE, frequency)
    should = spectral.model_spectrum(truth, 1.0 / power_gain(truth), RATE, frequency)
    heard = should > 2.0 * 10 ** (-snr_dB / 10) / RATE  # what lies below the noise no one can know
    assert spectral.log_spectral_distance(model[heard], should[heard], frequency[heard]) < 0.7


def test_the_noise_is_told_from_the_surface():
    truth = resonant([150, 500], [40, 60])
    model = over_noise(clean(noisy(truth, 60_000, 20.0), RATE).acceleration_m_s2, RATE, 30)
    assert model.order == 4
    assert np.exp(model.log_noise) == pytest.approx(0.01, rel=0.05)
    np.testing.assert_allclose(np.sort(np.abs(np.angle(np.roots(model.a)))), np.sort(np.abs(np.angle(np.roots(truth)))),
                               atol=2 * np.pi * 5 / RATE)  # fmt: skip


def test_two_filters_under_noise_are_told_apart_by_speed():
    """Each cluster of pieces gets its own filter over the noise that the whole recording has."""
    truths = (resonant([200, 500], [60, 60]), resonant([300, 800], [60, 60]))
    signal = np.concatenate([noisy(truths[i % 2], 15_000, 20.0, seed=i) for i in range(4)])
    speed = np.repeat([0.1, 0.25, 0.1, 0.25], 15_000)
    noise = over_noise(clean(signal[:15_000], RATE).acceleration_m_s2, RATE, 30)
    part = cut(clean(signal, RATE, 1.0, speed))
    texture = fit_texture(part, RATE, noise.order, 2, noise=noise)
    assert choose_model_count(part, RATE, noise.order, noise) >= 2
    frequency = np.arange(100.0, 900.0, 5.0)
    for truth, v in zip(truths, (0.1, 0.25), strict=True):
        model = spectral.model_spectrum(texture.model(1.0, v)[0], 1.0, RATE, frequency)
        should = spectral.model_spectrum(truth, 1.0 / power_gain(truth), RATE, frequency)
        heard = should > 0.02 / RATE
        assert spectral.log_spectral_distance(model[heard], should[heard], frequency[heard]) < 1.0


def test_what_no_small_model_explains_is_left_alone(shared):
    rng = np.random.default_rng(0)
    assert over_noise(clean(rng.standard_normal(20_000), RATE).acceleration_m_s2, RATE, 20) is None  # noise alone
    changed = np.concatenate([noisy(resonant([f, 600], [40, 60]), 20_000, 20.0) for f in (150, 350)])
    assert over_noise(clean(changed, RATE).acceleration_m_s2, RATE, 20) is None  # its halves differ
    accel = np.loadtxt(shared / "data" / "recordings" / "cdp_leather.csv", delimiter=",", skiprows=1)[:, 2]
    assert search_order(clean(accel, RATE).acceleration_m_s2, RATE).noise is None


def test_scoring_never_gets_worse_and_stays_stable():
    """From random stable starts on spectra of random models."""
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


@pytest.mark.parametrize(("count", "rate_Hz"), [(100, 500.0), (150, 2000.0), (4000, 2000.0)])
def test_a_bin_holds_the_periodogram_between_its_borders_however_short_the_signal(count, rate_Hz):
    """Against a Fourier transform a hundred times as fine."""
    signal = np.random.default_rng(count).standard_normal(count)
    found, size = density([signal], rate_Hz), 1 << 19
    fine = np.abs(np.fft.rfft(tapered(signal, rate_Hz), size)) ** 2 / count
    width = max(5.0, 20.0 * rate_Hz / count)
    border = np.arange(LOW_HZ, 0.5 * rate_Hz, width)
    exact = [fine[round(low * size / rate_Hz) : round((low + width) * size / rate_Hz)].mean() for low in border[:-1]]
    np.testing.assert_allclose(found.frequency_Hz, border[:-1] + 0.5 * width, atol=0.05 * width)
    np.testing.assert_allclose(found.ordinates, width * count / rate_Hz, rtol=0.05)
    np.testing.assert_allclose(found.power, exact, rtol=0.01 if count < 1000 else 0.3)


def test_stretches_are_pooled_by_their_length():
    one, two = np.random.default_rng(0).standard_normal((2, 1000))
    apart = [density([x], 2000.0) for x in (one, two)]
    both = density([one, two], 2000.0)
    assert both.ordinates.sum() == pytest.approx(2.0 * apart[0].ordinates.sum(), rel=0.01)
    assert both.even == pytest.approx(0.5 * (apart[0].even + apart[1].even), rel=1e-3)
    assert np.average(both.power, weights=both.ordinates) == pytest.approx(
        np.mean([np.average(x.power, weights=x.ordinates) for x in apart]), rel=0.05
    )


def some_model(spectrum, seed=0):
    rng = np.random.default_rng(seed)
    radius, angle = rng.uniform(0.6, 0.95, 3), rng.uniform(0.1, 2.8, 3)
    section = np.stack([-2 * radius * np.cos(angle), radius**2], axis=1)
    return NoisyModel(section, 0.3, np.log(0.5 * spectrum.noise_max))


def test_a_model_s_spectrum_and_loss_are_those_of_its_filter():
    spectrum = density([noisy(resonant([300, 700], [60, 60]), 20_000, 20.0)], RATE)
    model = judged(some_model(spectrum), spectrum)
    _, response = freqz([1.0], model.a, worN=spectrum.frequency_Hz, fs=RATE)
    _, clear, whole = model.parts(spectrum)
    exact = np.exp(0.3) * np.abs(response) ** 2
    np.testing.assert_allclose(clear, exact)
    np.testing.assert_allclose(whole, exact + 0.5 * spectrum.noise_max)
    assert model.loss == pytest.approx(np.sum(spectrum.ordinates * (np.log(whole) + spectrum.power / whole)))


def test_the_gradient_is_that_of_the_loss_and_the_information_its_expected_curvature():
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


def test_noise_that_would_grow_beyond_its_bound_is_held_there():
    spectrum = density([np.random.default_rng(0).standard_normal(20_000)], RATE)
    highest = np.log(spectrum.noise_max)
    at_bound = NoisyModel(np.array([[0.0, 0.0]]), highest - 3.0, highest)
    gradient, information = _derivatives(at_bound, spectrum, highest)
    assert gradient[-1] == 0.0 and information[-1].tolist() == information[:, -1].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert _derivatives(at_bound, spectrum, highest + 1.0)[0][-1] < 0.0  # as it would


def test_from_the_truth_and_from_afar_the_search_arrives_at_one_place():
    truth = resonant([200, 600], [60, 80])
    spectrum = density([noisy(truth, 60_000, 20.0)], RATE)
    pole = np.roots(truth)
    near = np.stack([[-2.0 * p.real, abs(p) ** 2] for p in pole[pole.imag > 0.0]])
    far = near * [0.98, 0.97]
    ends = [refined(NoisyModel(start, -5.0, np.log(0.5 * spectrum.noise_max)), spectrum) for start in (near, far)]
    assert ends[0].loss == pytest.approx(ends[1].loss, abs=0.5)  # half of what is worth a further step
    np.testing.assert_allclose(ends[0].a, truth, atol=0.03)
