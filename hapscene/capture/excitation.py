"""The noise that drives a texture: Gaussian, as in the papers, or with the distribution of the measured residual.

Real residuals have bursts: excess kurtosis of 1.3 to 12.7 on the project's recordings, 0 for Gaussian noise. Which
noise is nearer is decided by what comes out, on pieces that the noise was not fitted to: the Wasserstein distance of
the amplitudes of the synthesised and of the recorded acceleration, each over its model's level.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hapscene.capture.metric import excess_kurtosis
from hapscene.capture.streams import Array
from hapscene.capture.texture_pieces import Pieces
from hapscene.constants import EXCITATION_KNOTS, EXCITATION_SPAN
from hapscene.dsp.lattice import run_lattice
from hapscene.dsp.noise import seeded_state
from hapscene.surface.texture import Texture, excitation_moments

GAIN: Final = 0.97
"""A measured noise is taken when its distance is below this share of the Gaussian noise's [1]: for less it is not
worth its numbers in the file."""

PLAYED_S: Final = 10.0
"""Length of what is synthesised to see the amplitudes that a noise gives [s]."""


@dataclass(frozen=True)
class ExcitationChoice:
    """Which noise is nearer, and by how much. Distances are Wasserstein's of order 1, in standard deviations.

    Attributes:
        kurtosis: excess kurtosis of the residual, 0 for Gaussian noise.
        gaussian: distance of the output's amplitudes on held-out pieces, driven by Gaussian noise.
        empirical: the same, driven by the distribution of the residual of the other pieces.
        residual_gaussian: distance of the held-out residual itself and Gaussian noise.
        residual_empirical: distance of the held-out residual and the residual of the other pieces.
        knots: what `Texture.excitation` is to be: () for Gaussian noise.
    """

    kurtosis: float
    gaussian: float
    empirical: float
    residual_gaussian: float
    residual_empirical: float
    knots: Array


def fit_excitation(texture: Texture, pieces: Pieces) -> Texture:
    """The texture with the noise that is nearer to the pieces it was fitted to."""
    return replace(texture, excitation=choose_excitation(texture, pieces).knots)


def choose_excitation(texture: Texture, pieces: Pieces) -> ExcitationChoice:
    """Fit the noise to each half of the pieces and judge it by the other; take it of all of them where it is nearer."""
    middle = len(pieces) // 2
    residual, output = normalised(texture, pieces)
    if middle == 0:
        return ExcitationChoice(excess_kurtosis(residual), 0.0, 0.0, 0.0, 0.0, np.empty(0))
    halves = (slice(0, middle), slice(middle, None))
    distance = np.zeros(4)
    played, drawn = _played(texture, np.empty(0)), _drawn(np.empty(0))
    for own, other in (halves, halves[::-1]):
        knots = quantile_knots(residual[own].ravel())
        heard, left = _unit(output[other].ravel()), _unit(residual[other].ravel())
        pairs = (heard, played), (heard, _played(texture, knots)), (left, drawn), (left, _drawn(knots))
        distance += [0.5 * wasserstein(one, two) for one, two in pairs]
    knots = quantile_knots(residual.ravel()) if distance[1] < GAIN * distance[0] else np.empty(0)
    heard_1, heard_2, left_1, left_2 = distance.tolist()
    return ExcitationChoice(excess_kurtosis(residual), heard_1, heard_2, left_1, left_2, knots)


def quantile_knots(residual: Array) -> Array:
    """The knots of `Texture.excitation` (`EXCITATION_KNOTS`,) for a residual (n,).

    Quantiles at the levels of even Gaussian deviates. Beyond the levels that n samples can tell, 1/(2n) from either
    end, the last slope goes on; then mean 0, variance 1.
    """
    from scipy.special import ndtr, ndtri

    z = np.linspace(-EXCITATION_SPAN, EXCITATION_SPAN, EXCITATION_KNOTS)
    known = -float(ndtri(2.0 / len(residual)))  # with the two outermost samples at either end a slope is known
    at = np.clip(z, -known, known)
    knots = np.quantile(residual, ndtr(at))
    slope = np.diff(np.quantile(residual, ndtr([-known, 1.0 - known, known - 1.0, known])))[[0, 2]]
    knots += np.minimum(z + known, 0.0) * slope[0] + np.maximum(z - known, 0.0) * slope[1]
    mean, variance = excitation_moments(knots)
    return np.asarray((knots - mean) / np.sqrt(variance))


def wasserstein(first: Array, second: Array) -> float:
    """Mean distance between the quantiles of two samples, of any sizes: Wasserstein's of order 1."""
    level = (np.arange(2000) + 0.5) / 2000
    return float(np.mean(np.abs(np.quantile(first, level) - np.quantile(second, level))))


def normalised(texture: Texture, pieces: Pieces) -> tuple[Array, Array]:
    """Residual and output of the pieces (k, n−p), each over its model's level."""
    from scipy.signal import lfilter

    a, variance = texture.models(pieces.force_N, pieces.speed_m_s)
    power = texture.power(pieces.force_N, pieces.speed_m_s)
    signal = pieces.acceleration_m_s2
    sounding = power > 0.0  # a model that finds a piece silent says nothing of its noise
    a, variance, power, signal = a[sounding], variance[sounding], power[sounding], signal[sounding]
    residual = np.stack([lfilter(filter_a, [1.0], row) for filter_a, row in zip(a, signal, strict=True)])
    part = slice(min(texture.order, signal.shape[1] // 2), None)
    return residual[:, part] / np.sqrt(variance)[:, None], signal[:, part] / np.sqrt(power)[:, None]


def _played(texture: Texture, knots: Array) -> Array:
    """Amplitudes of the texture's loudest model, driven by a noise: its output at variance 1."""
    k, _ = texture.lattice([texture.force_max_N], [texture.speed_max_m_s])
    state, rng = np.zeros((3, texture.order + 1)), seeded_state(0, "excitation")
    out = np.empty(round(PLAYED_S * texture.rate_Hz))
    run_lattice(k, np.ones(1), 1.0, len(out), knots, rng, state, out)
    return _unit(out)


def _drawn(knots: Array) -> Array:
    """Quantiles of a noise: dense, without chance."""
    from scipy.special import ndtri

    z = np.asarray(ndtri((np.arange(20_000) + 0.5) / 20_000))
    return z if len(knots) == 0 else np.interp(z, np.linspace(-EXCITATION_SPAN, EXCITATION_SPAN, len(knots)), knots)


def _unit(signal: Array) -> Array:
    return np.asarray((signal - signal.mean()) / signal.std())
