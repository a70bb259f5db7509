"""The least AR model over white noise that explains a recording, where there is one.

Scoring finds only what is near, so each order is started from several places: the model of the order before with one
more resonance where it misses most, and linear prediction on the spectrum less the noise, with guesses of how the
surface's spectrum goes on below the noise. Of the best starts the likeliest end is taken.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.whittle import Density, NoisyModel, density, judged, refined
from hapscene.surface.lsf import power_gain

Array = NDArray[np.float64]

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
    from scipy.special import polygamma

    count = int(np.count_nonzero(part))
    if count < 3:
        return True
    away = _DB * np.log(density.power / model.parts(density)[2])[part]
    chance = _DB**2 * float(np.mean(polygamma(1, density.ordinates[part])))
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
    from scipy.linalg import solve_toeplitz

    r = np.fft.irfft(even + 1e-13 * even.mean())[: order + 1]
    a = np.concatenate([[1.0], np.asarray(solve_toeplitz(r[:-1], -r[1:]))])
    pole = np.roots(a)
    pole = pole * np.minimum(1.0, (1.0 - 1e-5) / np.maximum(np.abs(pole), 1e-9))
    pair, real = pole[pole.imag > 1e-9], np.sort(pole[np.abs(pole.imag) <= 1e-9].real)
    if 2 * len(pair) + len(real) == order:
        section = [(-2.0 * p.real, abs(p) ** 2) for p in pair]
        section += [(-(p + q), p * q) for p, q in zip(real[::2], real[1::2], strict=True)]
        yield NoisyModel(np.array(section), float(np.log(max(float(a @ r), 1e-300))), log_noise)
