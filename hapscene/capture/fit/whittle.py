"""AR models over a floor of white noise, by Whittle's likelihood: the surface told from the sensor.

An AR model of order p seen through white noise is no AR model any more, but ARMA(p, p): plain linear prediction then
needs an order of 26 and more for one of 4, where the surface's own spectrum falls below the noise. Here the noise is a
part of the model: the spectrum is S(f) = σ²/|A(f)|² + ν, and what is made least is Whittle's −log likelihood of the
periodogram P, Σ n (ln S + P/S) with n its ordinates (Whittle 1953, "Estimation and information in stationary time
series", Ark. Mat. 2). A is a product of sections 1 + b₁z⁻¹ + b₂z⁻², each kept within the triangle of stability, so
that poles that crowd at the low end, as at 10 kHz all do that are felt, do not upset each other; Fisher's scoring with
damping (Levenberg & Marquardt) finds them, from a start nearby (`hapscene.capture.fit.whittle`).
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

__all__ = ["LOW_HZ", "NoisyModel", "density", "judged", "over_noise", "refined"]

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

LONG: Final = 1 << 18
"""Longest stretch whose periodogram is taken at once [samples]: its lines are much closer than `BIN_HZ`."""

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


# The least AR model over white noise that explains a recording, where there is one.
#
# Scoring finds only what is near, so each order is started from several places: the model of the order before with one
# more resonance where it misses most, and linear prediction on the spectrum less the noise, with guesses of how the
# surface's spectrum goes on below the noise. Of the best starts the likeliest end is taken.


MISFIT_DB: Final = 0.5
"""What a model may miss of a spectrum [dB rms]: a third of what is felt (1.65 dB, Israr et al. 2006)."""

ORDER_MOST: Final = 24
"""Highest order that is tried over noise [count]: the search's time grows with its cube, and a surface that needs more
is none whose few resonances could be told from noise."""

GAIN_MOST: Final = 1e9
"""Largest power gain of a filter that is used [1]: a tenth of what a texture may have. Ten poles below 1 kHz have 1e12
at 10 kHz, beyond what the swatch's precision holds."""

STARTS: Final = 3
"""Best starts that are followed [count]."""

_DB: Final = 10.0 / np.log(10.0)


def over_noise(signal: Array, rate_Hz: float, order_end: int) -> NoisyModel | None:
    """The model of least order below `order_end` that misses nothing of either half of a signal, or None.

    A model of the whole misses nothing where, chance taken out, it is off by at most `MISFIT_DB` rms from the spectrum
    of each half, in the felt band and above it. That is asked of the halves for the likelihood's own sake: it holds
    where they differ by chance alone, as those of a known model do, and those of a hand hardly ever.
    """
    whole, middle = density([signal], rate_Hz), len(signal) // 2
    halves = [density([half], rate_Hz) for half in (signal[:middle], signal[middle:])]
    for model in models(whole, range(2, min(order_end - 1, ORDER_MOST) + 1, 2)):
        if not all(_fits(model, half, part) for half in halves for part in (half.felt, ~half.felt)):
            continue
        clear = model.parts(whole)[1]
        usable = power_gain(model.a) < GAIN_MOST and clear.mean() > np.exp(model.log_noise)
        return model if usable else None
    return None


def models(density: Density, orders: range) -> Iterator[NoisyModel]:
    """The model of each even order, from 2 on in steps of 2, the next from the last and from new starts."""
    last = NoisyModel(np.zeros((0, 2)), 0.0, float(np.log(0.99 * density.noise_max)))
    for order in orders:
        starts = [judged(model, density) for model in (*_grown(last, density), *_predicted(density, order))]
        starts.sort(key=lambda model: model.loss)
        last = min((refined(model, density) for model in starts[:STARTS]), key=lambda model: model.loss)
        yield last


def _fits(model: NoisyModel, density: Density, part: NDArray[np.bool_]) -> bool:
    """Whether a model misses at most `MISFIT_DB` of a periodogram in some bins, level aside and chance taken out.

    The logarithm of a mean of n ordinates scatters with variance ψ′(n); over k bins that is known to √(2/k) of it.
    """
    count = int(np.count_nonzero(part))
    if count < 3:
        return True
    away = _DB * np.log(density.power / model.parts(density)[2])[part]
    chance = _DB**2 * float(np.mean(scipy.special.polygamma(1, density.ordinates[part])))
    return bool(away.var() <= MISFIT_DB**2 + chance * (1.0 + 2.0 * np.sqrt(2.0 / count)))


def _grown(model: NoisyModel, density: Density) -> Iterator[NoisyModel]:
    """The model with one more section: where it misses most, narrow or wide, and one that does nothing yet."""
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
    """Sections with the two levels that one may give them: by the mean of powers, and of their logarithms."""
    ratio = density.power / NoisyModel(section, 0.0, -700.0).parts(density)[2]
    for level in (np.log(np.average(ratio, weights=density.ordinates)), np.average(np.log(ratio))):
        yield NoisyModel(section, float(level), log_noise)


def _predicted(density: Density, order: int) -> Iterator[NoisyModel]:
    """Linear prediction on the spectrum less the noise, for guesses of what lies below the noise.

    Either a lower floor, or from the last frequency on that is above the noise a fall as of 0, 1, … poles near 1.
    """
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
    """Linear prediction of a spectrum at even frequencies; nothing where a real pole is left over."""
    r = np.fft.irfft(even + 1e-13 * even.mean())[: order + 1]
    a = np.concatenate([[1.0], np.asarray(scipy.linalg.solve_toeplitz(r[:-1], -r[1:]))])
    pole = np.roots(a)
    pole = pole * np.minimum(1.0, (1.0 - 1e-5) / np.maximum(np.abs(pole), 1e-9))
    pair, real = pole[pole.imag > 1e-9], np.sort(pole[np.abs(pole.imag) <= 1e-9].real)
    if 2 * len(pair) + len(real) == order:
        section = [(-2.0 * p.real, abs(p) ** 2) for p in pair]
        section += [(-(p + q), p * q) for p, q in zip(real[::2], real[1::2], strict=True)]
        yield NoisyModel(np.array(section), float(np.log(max(float(a @ r), 1e-300))), log_noise)
