"""Choice of the model order on signals of known order."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from hapscene.capture.fit.order import (
    DOMAIN_JND,
    PERCEPTUAL_JND,
    search_domain,
    search_order,
)
from hapscene.dsp.linear_prediction import autocorrelation, solve, tapered

from ..signals import played, resonant

RATE_HZ = 2000.0


@pytest.mark.parametrize("frequency_Hz", [(300,), (200, 600), (150, 450, 800)])
def test_the_order_of_an_ar_process_is_enough(frequency_Hz):
    """Sharp resonances need their order; what is left beyond it cannot be felt."""
    truth = resonant(frequency_Hz, 0.97, RATE_HZ)
    found = search_order(played(truth, 40_000), RATE_HZ)
    assert len(truth) - 2 <= found.chosen <= len(truth) + 1
    assert np.all(found.difference_jnd[found.orders >= found.chosen] <= PERCEPTUAL_JND)


def test_the_perceptual_order_omits_imperceptible_resonances() -> None:
    """A single resonance needs a low order; a second, perceptible one needs a higher order."""
    rng, rate_Hz = np.random.default_rng(15), 5000.0
    poles = 0.97 * np.exp(2j * np.pi * 150.0 / rate_Hz)
    loud = lfilter([1.0], [1.0, -2.0 * poles.real, abs(poles) ** 2], rng.standard_normal(60_000))
    assert search_order(loud, rate_Hz).plain <= 6  # the resonance and estimation noise
    poles = 0.97 * np.exp(2j * np.pi * 600.0 / rate_Hz)
    second = lfilter([1.0], [1.0, -2.0 * poles.real, abs(poles) ** 2], rng.standard_normal(60_000))
    both = loud + second
    order = search_order(both, rate_Hz).plain
    a = solve(autocorrelation(tapered(both, rate_Hz), order))
    assert 4 <= order <= 16 and np.abs(np.roots(a)).max() > 0.9  # both are perceptible


def test_a_short_recording_limits_the_order():
    found = search_order(played(resonant([300], 0.9, RATE_HZ), 1000), RATE_HZ)
    assert found.orders[-1] == 124 and found.chosen <= 124 and (found.band_jnd > 0.0).all()


def falling(count, seed=0):
    """Noise at 10 kHz with a steep high-pass at 60 Hz and a low-pass at 300 Hz, plus sensor noise."""
    rng = np.random.default_rng(seed)
    noise = sosfilt(butter(4, 60.0, "highpass", fs=1e4, output="sos"), rng.standard_normal(count + 5000))
    signal = sosfilt(butter(2, 300.0, fs=1e4, output="sos"), noise)[5000:]
    return signal + 1e-3 * signal.std() * rng.standard_normal(count)


def test_the_frequency_axis_depends_on_the_spectrum():
    """Two wide resonances need a plain model of order 4; a spectrum that falls towards 20 Hz a warped one."""
    a = np.ones(1)
    for f in (150.0, 600.0):
        a = np.convolve(a, [1.0, -1.95 * np.cos(2 * np.pi * f / 1e4), 0.950625])
    plain = search_domain(lfilter([1.0], a, np.random.default_rng(1).standard_normal(60_000)), 1e4)
    assert plain.warp == 0.0 and plain.chosen <= 6
    signal = falling(60_000)
    found = [search_domain(signal, 1e4, domain) for domain in ("plain", "warped", "auto")]
    assert [search.warp > 0.0 for search in found] == [False, True, True]
    assert found[2].chosen < 0.5 * found[0].chosen
    at = [float(search.band_jnd[search.orders == search.chosen][0]) for search in found]
    assert at[2] <= at[0] + DOMAIN_JND
    assert search_domain(signal[::5], 2000.0, "warped").warp == 0.0  # the sample rate is too low for warping
