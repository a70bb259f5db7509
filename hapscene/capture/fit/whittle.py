"""AR models with white sensor noise, fitted by the Whittle likelihood.

An AR model of order p plus white noise is an ARMA(p, p) process. If the spectrum of the surface falls below the noise,
plain linear prediction needs an order of 26 and more for a surface of order 4. Here the noise is part of the model: the
spectrum is S(f) = σ²/|A(f)|² + ν. The fit minimises the negative Whittle log-likelihood of the periodogram P,
Σ n (ln S + P/S) with n ordinates per bin (Whittle 1953, "Estimation and information in stationary time series", Ark.
Mat. 2). A is a product of second-order sections 1 + b₁z⁻¹ + b₂z⁻², each within the stability triangle; this is well
conditioned for poles at low frequencies, where all perceptible resonances are at 10 kHz. The sections are fitted by
damped Fisher scoring (Levenberg–Marquardt) from several initial values.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.io.streams import Array
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import WHITE, autocorrelation, tapered

__all__ = ["NoisyModel", "density", "over_noise", "refined"]

Complex = NDArray[np.complex128]

LOW_HZ: Final = 1.5 * ACCELERATION_BAND_HZ[0]
"""Lowest frequency of the fit [Hz]; the high-pass distorts the spectrum below it."""

ORDINATES: Final = 20
"""Fewest ordinates of the periodogram per bin, so that the logarithm of a bin is nearly Gaussian."""

BIN_HZ: Final = 5.0
"""Smallest width of a bin [Hz]; resonances of 20 Hz are then resolved."""

NOISE_SHARE: Final = 0.1
"""Fraction of the bins over which a moving average is taken; its minimum is the upper limit of the noise [1]."""

STEPS: Final = 40
"""Largest number of scoring steps; 5 to 15 are usual."""

GAIN_LEAST: Final = 0.1
"""Gain of log-likelihood per step at which the fit ends."""

LONG: Final = 1 << 18
"""Longest signal whose periodogram is computed at once [samples]; its resolution is much finer than `BIN_HZ`."""

LINES: Final = 1024
"""Number of intervals of the evenly spaced spectrum."""

_EDGE: Final = 1e-7  # smallest distance of a section from the edge of the stability triangle


@dataclass(frozen=True)
class Density:
    """Periodogram of a signal in bins.

    Attributes:
        rate_Hz: sample rate.
        frequency_Hz: (k,) centre of each bin.
        power: (k,) mean of the periodogram, scaled so that white noise of variance 1 has power 1.
        ordinates: (k,) number of independent ordinates per bin.
        even: (`LINES`+1,) slightly smoothed spectrum at evenly spaced frequencies from 0 to half the sample rate.
    """

    rate_Hz: float
    frequency_Hz: Array
    power: Array
    ordinates: Array
    even: Array

    @cached_property
    def noise_max(self) -> float:
        """Upper limit of the variance of white noise."""
        count = max(1, round(NOISE_SHARE * len(self.power)))
        return float(np.convolve(self.power, np.full(count, 1.0 / count), "valid").min())

    @cached_property
    def circle(self) -> Complex:
        """z⁻¹ (k,) at the centres of the bins."""
        return np.asarray(np.exp(-2j * np.pi * self.frequency_Hz / self.rate_Hz))

    @property
    def in_band(self) -> NDArray[np.bool_]:
        """(k,) True for bins in the perceptible band."""
        return np.asarray(self.frequency_Hz < ACCELERATION_BAND_HZ[1])


@dataclass(frozen=True)
class NoisyModel:
    """AR model with noise: sections (m, 2) of A, log-variances of excitation and noise, negative log-likelihood."""

    section: Array
    log_variance: float
    log_noise: float
    loss: float = np.inf

    @property
    def order(self) -> int:
        return 2 * len(self.section)

    @property
    def a(self) -> Array:
        """Filter (p+1,) as the product of the sections."""
        a = np.ones(1)
        for b_1, b_2 in self.section:
            a = np.convolve(a, [1.0, b_1, b_2])
        return a

    def parts(self, density: Density) -> tuple[Complex, Array, Array]:
        """Response of each section (m, k), and spectrum without and with noise (k,), at the centres of the bins."""
        z = density.circle
        response = 1.0 + self.section[:, :1] * z + self.section[:, 1:] * z**2
        clear = np.exp(self.log_variance - 2.0 * np.log(np.abs(response)).sum(axis=0))
        return response, clear, clear + np.exp(self.log_noise)


def density(signals: Sequence[Array], rate_Hz: float) -> Density:
    """Binned periodogram of several parts (n_i,) of a signal."""
    signals = [signal[i : i + LONG] for signal in signals for i in range(0, len(signal), LONG)]
    count = sum(len(signal) for signal in signals)
    size = 1 << (max(len(signal) for signal in signals) - 1).bit_length()
    size = max(size, 2 * LINES)
    periodogram = np.zeros(size // 2 + 1)
    for signal in signals:
        periodogram += np.abs(np.fft.rfft(tapered(signal, rate_Hz), size)) ** 2 / count
    periodogram += WHITE * periodogram.mean()
    per_Hz = count / rate_Hz
    edge = np.arange(LOW_HZ, 0.5 * rate_Hz, max(BIN_HZ, ORDINATES / per_Hz))
    line = np.unique(np.round(edge * size / rate_Hz).astype(np.intp))
    running = np.concatenate([[0.0], np.cumsum(periodogram)])
    step = np.diff(line)
    power = np.diff(running[line]) / step
    middle = 0.5 * (line[1:] + line[:-1] - 1) * rate_Hz / size
    r = np.sum([autocorrelation(tapered(signal, rate_Hz), LINES) for signal in signals], axis=0) / count
    r = r * np.exp(-0.5 * (2.0 * np.pi * BIN_HZ / rate_Hz * np.arange(LINES + 1)) ** 2)
    even = np.fft.rfft(np.concatenate([r, r[-2:0:-1]])).real
    ordinates = step * (rate_Hz / size) * per_Hz
    return Density(rate_Hz, middle, power, ordinates, np.maximum(even, 1e-12 * r[0]))


def refined(model: NoisyModel, density: Density) -> NoisyModel:
    """Refines a model by damped Fisher scoring."""
    model, damping = judged(model, density), 1e-2
    highest = float(np.log(density.noise_max))
    for _ in range(STEPS):
        gradient, information = _derivatives(model, density, highest)
        scale = np.diag(information) + 1e-12 * np.trace(information)
        for _ in range(6):
            step = np.asarray(-np.linalg.solve(information + np.diag(damping * scale), gradient))
            new = _stepped(model, step, density, highest)
            if new.loss < model.loss:
                break
            damping *= 6.0
        else:
            return model
        gain, model, damping = model.loss - new.loss, new, max(damping / 6.0, 1e-9)
        if gain < GAIN_LEAST:
            break
    return model


def _derivatives(model: NoisyModel, density: Density, highest: float) -> tuple[Array, Array]:
    """Gradient (2m+2,) and Fisher information (2m+2, 2m+2) with respect to b₁, b₂ of each section, ln σ² and ln ν."""
    z, weight = density.circle, density.ordinates
    response, clear, whole = model.parts(density)
    share, last = clear / whole, 2 * len(response)
    by = np.empty((last + 2, len(z)))
    by[0:last:2] = -2.0 * share * (z / response).real
    by[1:last:2] = -2.0 * share * (z**2 / response).real
    by[last], by[last + 1] = share, 1.0 - share
    gradient = by @ (weight * (1.0 - density.power / whole))
    information = (by * weight) @ by.T
    if model.log_noise >= highest and gradient[-1] < 0.0:  # the noise is at its upper limit
        gradient[-1], information[-1], information[:, -1] = 0.0, 0.0, 0.0
        information[-1, -1] = 1.0
    return gradient, information


def _stepped(model: NoisyModel, step: Array, density: Density, highest: float) -> NoisyModel:
    """Model after one step; the step is shortened if the model would become unstable."""
    way, part = step[:-2].reshape(-1, 2), 1.0
    while part > 1e-3:
        section = model.section + part * way
        if np.all((np.abs(section[:, 1]) < 1.0 - _EDGE) & (np.abs(section[:, 0]) < 1.0 + section[:, 1])):
            break
        part *= 0.5
    else:
        return model
    variance = model.log_variance + float(np.clip(part * step[-2], -3.0, 3.0))
    noise = model.log_noise + float(np.clip(part * step[-1], -2.0, 2.0))
    return judged(NoisyModel(section, variance, min(noise, highest)), density)


def judged(model: NoisyModel, density: Density) -> NoisyModel:
    """Computes the loss of a model."""
    whole = model.parts(density)[2]
    loss = float(np.sum(density.ordinates * (np.log(whole) + density.power / whole)))
    return NoisyModel(model.section, model.log_variance, model.log_noise, loss)


# Search for the lowest order of an AR model with noise that fits a recording.
#
# Scoring converges to a local minimum, so each order starts from several initial values: the model of the previous
# order with another resonance at the largest misfit, and linear prediction on the spectrum minus the noise, with
# several assumptions about the spectrum of the surface below the noise. The result with the highest likelihood is used.


MISFIT_DB: Final = 0.5
"""Largest misfit of a spectrum [dB rms]: a third of the JND (1.65 dB, Israr et al. 2006)."""

ORDER_MOST: Final = 24
"""Highest order of a model with noise. The computing time is proportional to the cube of the order, and a surface that
needs a higher order has no few resonances that could be separated from the noise."""

GAIN_MOST: Final = 1e9
"""Largest power gain of a filter [1]: a tenth of the limit of a texture. Ten poles below 1 kHz have a gain of 1e12 at
10 kHz, which exceeds the precision of a swatch file."""

STARTS: Final = 3
"""Number of initial values that are refined."""

_DB: Final = 10.0 / np.log(10.0)


def over_noise(signal: Array, rate_Hz: float, order_end: int) -> NoisyModel | None:
    """Model of the lowest order below `order_end` that fits both halves of a signal, or None.

    The model of the whole signal fits if its distance from the spectrum of each half is at most `MISFIT_DB` rms beyond
    estimation noise, in the perceptible band and above it. The test on the halves rejects nonstationary signals, for
    which the likelihood is not valid."""
    whole, middle = density([signal], rate_Hz), len(signal) // 2
    halves = [density([half], rate_Hz) for half in (signal[:middle], signal[middle:])]
    for model in models(whole, range(2, min(order_end - 1, ORDER_MOST) + 1, 2)):
        if not all(_fits(model, half, part) for half in halves for part in (half.in_band, ~half.in_band)):
            continue
        clear = model.parts(whole)[1]
        usable = power_gain(model.a) < GAIN_MOST and clear.mean() > np.exp(model.log_noise)
        return model if usable else None
    return None


def models(density: Density, orders: range) -> Iterator[NoisyModel]:
    """Yields the best model of each even order."""
    last = NoisyModel(np.zeros((0, 2)), 0.0, float(np.log(0.99 * density.noise_max)))
    for order in orders:
        starts = [judged(model, density) for model in (*_grown(last, density), *_predicted(density, order))]
        starts.sort(key=lambda model: model.loss)
        last = min((refined(model, density) for model in starts[:STARTS]), key=lambda model: model.loss)
        yield last


def _fits(model: NoisyModel, density: Density, part: NDArray[np.bool_]) -> bool:
    """Whether the misfit of a model in a set of bins is at most `MISFIT_DB`, without level and estimation noise.

    The logarithm of a mean of n ordinates has the variance ψ′(n), which k bins determine to a fraction of √(2/k).
    """
    count = int(np.count_nonzero(part))
    if count < 3:
        return True
    away = _DB * np.log(density.power / model.parts(density)[2])[part]
    chance = _DB**2 * float(np.mean(scipy.special.polygamma(1, density.ordinates[part])))
    return bool(away.var() <= MISFIT_DB**2 + chance * (1.0 + 2.0 * np.sqrt(2.0 / count)))


def _grown(model: NoisyModel, density: Density) -> Iterator[NoisyModel]:
    """Initial values from the previous order: one more section at the largest misfit, narrow, wide, or neutral."""
    whole = model.parts(density)[2] if model.order else np.full(len(density.power), density.power.mean())
    ratio = np.convolve(density.power / whole, np.full(5, 0.2), "same")
    missed = density.ordinates * (ratio - 1.0 - np.log(np.maximum(ratio, 1e-9))) * (ratio > 1.0)
    frequency = density.frequency_Hz[np.argmax(missed)]
    for width_Hz in (30.0, 120.0):
        radius = np.exp(-np.pi * width_Hz / density.rate_Hz)
        angle = 2.0 * np.pi * frequency / density.rate_Hz
        section = np.vstack([model.section, [-2.0 * radius * np.cos(angle), radius**2]])
        yield from _levelled(section, model.log_noise, density)
    yield from _levelled(np.vstack([model.section, [0.0, 0.0]]), model.log_noise, density)


def _levelled(section: Array, log_noise: float, density: Density) -> Iterator[NoisyModel]:
    """Models with the level from the mean power, and from the mean logarithm of the power."""
    ratio = density.power / NoisyModel(section, 0.0, -700.0).parts(density)[2]
    for level in (np.log(np.average(ratio, weights=density.ordinates)), np.average(np.log(ratio))):
        yield NoisyModel(section, float(level), log_noise)


def _predicted(density: Density, order: int) -> Iterator[NoisyModel]:
    """Initial values by linear prediction on the spectrum minus the noise.

    Below the noise, the spectrum of the surface is assumed to be a lower constant, or to fall off as that of 0, 1, …
    real poles from the highest frequency above the noise on."""
    even, noise = density.even, density.noise_max
    beneath = np.maximum(1.0 - noise / even, 0.0) ** 2 * even
    guesses = [beneath + part * noise for part in (1e-1, 1e-2, 1e-4)]
    above = np.flatnonzero(even > 2.0 * noise)
    last = int(above[-1]) if len(above) else 0
    if 5 < last < len(even) - 8:
        sine = np.sin(0.5 * np.pi * np.arange(last, len(even)) / (len(even) - 1))
        for poles in sorted({order // 4, order // 2, 3 * order // 4, order}):
            guess = np.maximum(even - noise, 1e-3 * noise)
            guess[last:] = guess[last - 5 : last + 1].mean() * (sine / sine[0]) ** (-2.0 * poles)
            guesses.append(guess)
    for guess in guesses:
        yield from _from_spectrum(guess, order, float(np.log(0.99 * noise)))


def _from_spectrum(even: Array, order: int, log_noise: float) -> Iterator[NoisyModel]:
    """Linear prediction of an evenly spaced spectrum; yields nothing if the number of real poles is odd."""
    r = np.fft.irfft(even + 1e-13 * even.mean())[: order + 1]
    a = np.concatenate([[1.0], np.asarray(scipy.linalg.solve_toeplitz(r[:-1], -r[1:]))])
    pole = np.roots(a)
    pole = pole * np.minimum(1.0, (1.0 - 1e-5) / np.maximum(np.abs(pole), 1e-9))
    pair, real = pole[pole.imag > 1e-9], np.sort(pole[np.abs(pole.imag) <= 1e-9].real)
    if 2 * len(pair) + len(real) == order:
        section = [(-2.0 * p.real, abs(p) ** 2) for p in pair]
        section += [(-(p + q), p * q) for p, q in zip(real[::2], real[1::2], strict=True)]
        yield NoisyModel(np.array(section), float(np.log(max(float(a @ r), 1e-300))), log_noise)
