"""The noise that drives a texture: Gaussian where that is as near, the residual's own where it is nearer."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kurtosis

from hapscene.capture import fit, load_recording, synthesize
from hapscene.capture.excitation import choose_excitation, quantile_knots, wasserstein
from hapscene.capture.streams import clean
from hapscene.capture.texture_fit import fit_texture
from hapscene.capture.texture_pieces import cut
from hapscene.constants import EXCITATION_KNOTS
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture, excitation_moments

RATE_HZ = 5000.0


def drawn(name: str, count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    noise = {
        "normal": rng.standard_normal(count),
        "laplace": rng.laplace(size=count),
        "student": rng.standard_t(5, count),
        "uniform": rng.uniform(-1, 1, count),
        "exponential": rng.exponential(size=count) - 1,
    }[name]
    return np.asarray(noise / noise.std())


@pytest.mark.parametrize("name", ["normal", "laplace", "student", "uniform", "exponential"])
def test_knots_give_back_the_distribution(name: str) -> None:
    noise = drawn(name, 100_000)
    knots = quantile_knots(noise)
    assert knots.shape == (EXCITATION_KNOTS,)
    assert np.all(np.diff(knots) >= 0.0)
    assert excitation_moments(knots) == pytest.approx((0.0, 1.0), abs=1e-9)
    texture = Texture.from_models(RATE_HZ, [1.0], [0.1], [[1.0, 0.0]], [1.0], excitation=knots)
    made = synthesize(Swatch("noise", texture=texture), np.ones(200_000), np.full(200_000, 0.1))
    assert made.var() == pytest.approx(1.0, abs=0.03)
    assert wasserstein(made, noise) < 0.02
    assert kurtosis(made) == pytest.approx(kurtosis(noise), abs=0.3 + 0.2 * abs(kurtosis(noise)))


@pytest.mark.parametrize(
    ("name", "count"), [("normal", 0), ("student", EXCITATION_KNOTS), ("laplace", EXCITATION_KNOTS)]
)
def test_bursts_are_kept_and_gaussian_noise_stays_gaussian(name: str, count: int) -> None:
    """A short filter, so that the distribution of the noise comes through."""
    signal = lfilter([1.0], [1.0, -0.5, 0.3], drawn(name, 60_000))
    texture = fit(signal, RATE_HZ, order=2).texture
    assert texture is not None
    assert len(texture.excitation) == count
    made = synthesize(Swatch("again", texture=texture), np.ones(60_000), np.full(60_000, 0.1))
    assert kurtosis(made) == pytest.approx(kurtosis(signal), abs=0.3 + 0.3 * kurtosis(signal))


def test_a_handful_of_samples_has_knots_too() -> None:
    knots = quantile_knots(np.random.default_rng(0).standard_normal(50))
    assert np.all(np.diff(knots) >= 0.0) and np.abs(knots).max() < 10.0


def test_the_nearer_noise_on_a_real_recording(shared: Path) -> None:
    """Paper's residual has bursts: driven by its own distribution the output is a fifth nearer to unseen paper."""
    path = shared / "data" / "recordings" / "cdp_paper.csv"
    units = {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}
    recording = load_recording(path, 10_000.0, {"acceleration": "accel"}, units)
    pieces = cut(clean(recording.acceleration_m_s2, 10_000.0, recording.force_N, recording.speed_m_s))
    choice = choose_excitation(fit_texture(pieces, 10_000.0, 40, 1), pieces)
    assert choice.kurtosis > 5.0
    assert choice.residual_empirical < 0.3 * choice.residual_gaussian
    assert choice.empirical < 0.9 * choice.gaussian
    assert len(choice.knots) == EXCITATION_KNOTS
