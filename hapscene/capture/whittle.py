"""AR models over a floor of white noise, by Whittle's likelihood: the surface told from the sensor.

An AR model of order p seen through white noise is no AR model any more, but ARMA(p, p): plain linear prediction then
needs an order of 26 and more for one of 4, where the surface's own spectrum falls below the noise. Here the noise is a
part of the model: the spectrum is S(f) = σ²/|A(f)|² + ν, and what is made least is Whittle's −log likelihood of the
periodogram P, Σ n (ln S + P/S) with n its ordinates (Whittle 1953, "Estimation and information in stationary time
series", Ark. Mat. 2). A is a product of sections 1 + b₁z⁻¹ + b₂z⁻², each kept within the triangle of stability, so
that poles that crowd at the low end, as at 10 kHz all do that are felt, do not upset each other; Fisher's scoring with
damping (Levenberg & Marquardt) finds them, from a start nearby (`hapscene.capture.whittle_search`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.linear_prediction import WHITE, autocorrelation, tapered
from hapscene.constants import ACCELERATION_BAND_HZ

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LOW_HZ: Final = 1.5 * ACCELERATION_BAND_HZ[0]
"""Lowest frequency that counts [Hz]: below, the high-pass has bent the spectrum."""

ORDINATES: Final = 20
"""Fewest ordinates of the periodogram in a bin [count], so that its logarithm is nearly Gaussian."""

BIN_HZ: Final = 5.0
"""Least width of a bin [Hz]: resonances of 20 Hz are not blurred."""

NOISE_SHARE: Final = 0.1
"""Share of all bins, neighbours, whose mean, where it is least, is the most that the noise can be [1]."""

STEPS: Final = 40
"""Most steps of the search [count]; 5 to 15 are usual."""

GAIN_LEAST: Final = 0.1
"""Gain of the log likelihood at which the search ends: a twentieth of what one useless number brings by chance."""

LINES: Final = 1024
"""Lines of a density's even spectrum, less one [count]."""

_EDGE: Final = 1e-7  # how near a section may come to the edge of stability


@dataclass(frozen=True)
class Density:
    """A periodogram in bins.

    Attributes:
        rate_Hz: of the signal.
        frequency_Hz: (k,) middle of each bin.
        power: (k,) mean of the periodogram, scaled so that white noise of variance 1 has 1.
        ordinates: (k,) independent ordinates in each.
        even: (`LINES`+1,) the same, slightly smoothed, at even frequencies from 0 to half the rate.
    """

    rate_Hz: float
    frequency_Hz: Array
    power: Array
    ordinates: Array
    even: Array

    @cached_property
    def noise_max(self) -> float:
        """The most that white noise can be beneath it."""
        count = max(1, round(NOISE_SHARE * len(self.power)))
        return float(np.convolve(self.power, np.full(count, 1.0 / count), "valid").min())

    @cached_property
    def circle(self) -> Complex:
        """z⁻¹ (k,) at the bins."""
        return np.asarray(np.exp(-2j * np.pi * self.frequency_Hz / self.rate_Hz))

    @property
    def felt(self) -> NDArray[np.bool_]:
        """(k,) which bins lie in the felt band."""
        return np.asarray(self.frequency_Hz < ACCELERATION_BAND_HZ[1])


@dataclass(frozen=True)
class NoisyModel:
    """Sections (m, 2) of A, logarithms of the excitation's and of the noise's variance, and −log likelihood."""

    section: Array
    log_variance: float
    log_noise: float
    loss: float = np.inf

    @property
    def order(self) -> int:
        return 2 * len(self.section)

    @property
    def a(self) -> Array:
        """The filter (p+1,)."""
        a = np.ones(1)
        for b_1, b_2 in self.section:
            a = np.convolve(a, [1.0, b_1, b_2])
        return a

    def parts(self, density: Density) -> tuple[Complex, Array, Array]:
        """Each section's response (m, k), the spectrum without (k,) and with noise (k,) at the bins."""
        z = density.circle
        response = 1.0 + self.section[:, :1] * z + self.section[:, 1:] * z**2
        clear = np.exp(self.log_variance - 2.0 * np.log(np.abs(response)).sum(axis=0))
        return response, clear, clear + np.exp(self.log_noise)


def density(signals: Sequence[Array], rate_Hz: float) -> Density:
    """The binned periodogram of stretches of one signal, each (n_i,)."""
    count = sum(len(signal) for signal in signals)
    size = 1 << (max(len(signal) for signal in signals) - 1).bit_length()
    size = max(size, 2 * LINES)
    lines = [np.abs(np.fft.rfft(tapered(signal, rate_Hz), size)) ** 2 for signal in signals]
    periodogram = np.sum(lines, axis=0) / count
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
    """The likeliest model near this one."""
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
    """Gradient (2m+2,) of the loss and Fisher's information (2m+2, 2m+2): by b₁, b₂ of each section, ln σ², ln ν."""
    z, weight = density.circle, density.ordinates
    response, clear, whole = model.parts(density)
    share, last = clear / whole, 2 * len(response)
    by = np.empty((last + 2, len(z)))
    by[0:last:2] = -2.0 * share * (z / response).real
    by[1:last:2] = -2.0 * share * (z**2 / response).real
    by[last], by[last + 1] = share, 1.0 - share
    gradient = by @ (weight * (1.0 - density.power / whole))
    information = (by * weight) @ by.T
    if model.log_noise >= highest and gradient[-1] < 0.0:  # it would grow, but may not
        gradient[-1], information[-1], information[:, -1] = 0.0, 0.0, 0.0
        information[-1, -1] = 1.0
    return gradient, information


def _stepped(model: NoisyModel, step: Array, density: Density, highest: float) -> NoisyModel:
    """The model one step on, or as much of it as keeps it stable."""
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
    """The model with its loss."""
    whole = model.parts(density)[2]
    loss = float(np.sum(density.ordinates * (np.log(whole) + density.power / whole)))
    return NoisyModel(model.section, model.log_variance, model.log_noise, loss)
