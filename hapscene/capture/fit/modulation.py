"""Fits the amplitude modulation of a texture: a slow random gain.

The level (logarithm of the power in `ACCELERATION_BAND_HZ`, in windows of `WINDOW_S`) is the sum of three components:
the level of the texture, which depends on force and speed; random scatter due to the short windows, whose covariance
follows from the spectrum of the texture; and the logarithm of the gain. The dependence on force and speed is projected
out of each block of the recording and of the covariances. The coordinates of the remainder are nearly frequencies.
Their squares are fitted by the Whittle likelihood with exact expectations (Sykulski, Olhede, Guillaumin, Lilly & Early
2019, "The debiased Whittle likelihood", Biometrika 106(2)), which is accurate even for a second of recording."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import scipy

from hapscene.capture.fit.segment import runs
from hapscene.capture.io.streams import Array, Streams, filtered, part_of
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.surface.gain_modulation import SPREAD_MAX, GainModulation
from hapscene.surface.texture import Texture

__all__ = ["fit_modulation"]

WINDOW_S: Final = 0.01
"""Length of the windows of the level [s]: the shortest in which vibration from 20 Hz to 1 kHz has a level."""

CORRELATION_S: Final = (0.015, 0.04, 0.1, 0.25)
"""Correlation times of the processes [s]. Processes over distance have the corresponding correlation lengths at the
mean speed. In held-out tests three, four and five times performed equally; with three, spaced wider, the spread of
surfaces with correlation times in between was 14 % too large."""

BLOCK_S: Final = 2.0
"""Length of the blocks that are evaluated separately [s]: eight times the longest correlation time."""

BLOCKS_MAX: Final = 20
"""Largest number of blocks, evenly selected: 40 s determine the total spread to a few percent."""

SHORTEST_S: Final = 0.4
"""Shortest run of sliding that is used [s]."""

SLIDING: Final = 0.1
"""Smallest force and speed that are used, relative to the largest [1]; below, sensor noise dominates."""

SUPPORT: Final = 8.0
"""Smallest gain of twice the log-likelihood [1]; unmodulated noise gains this in one of a hundred recordings."""

SPREAD_LEAST: Final = 0.06
"""Smallest spread of the logarithm of the gain [1]: half a decibel, which is imperceptible."""

MARGIN: Final = 2.0
"""Held-out log-likelihood by which processes over distance, or both, must exceed those over time [1]: odds of 7."""

SHARE_LEAST: Final = 0.15
"""Smallest spread of a process, relative to the total [1]; a smaller one contributes 2 % of the variance."""

DRAWS: Final = 100
"""Number of simulations for the intervals."""

FLAT: Final = 0.01
"""Smallest relative range of force or speed at which a dependence of the level is projected out [1]."""

BETWEEN: Final = 0.1
"""Error of the total spread for correlation times between `CORRELATION_S`, from simulations [1]."""

FLOOR: Final = 1e-6
"""Smallest power of a window, relative to the mean [1], so that gaps in a recording do not count as modulation."""


_COUNT: Final = len(CORRELATION_S)
_KINDS: Final = {"time": slice(0, _COUNT), "distance": slice(_COUNT, 2 * _COUNT), "both": slice(0, 2 * _COUNT)}


class ModulationFit(NamedTuple):
    """Result of the fit.

    Attributes:
        modulation: parameters of the gain, or None.
        intervals: 95 % intervals of each spread and, last, of the total spread.
        reason: why `modulation` is None.
    """

    modulation: GainModulation | None
    intervals: tuple[tuple[float, float], ...] = ()
    reason: str = ""


_Block = tuple[Array, Array, Array]  # levels (2, n) of recording and texture, forces (n,), speeds (n,)


class _Expected(NamedTuple):
    """Squares of the coordinates, and their expectations."""

    square: Array  # (m,)
    noise: Array  # (m,) expectation without modulation
    kernels: Array  # (2 `_COUNT`, m) expectation for each process of variance 1

    def fitted(self, kind: str) -> tuple[Array, Array]:
        return _fitted(self.square, self.noise, self.kernels[_KINDS[kind]])


def _together(parts: Sequence[_Expected]) -> _Expected:
    square, noise, kernels = zip(*parts, strict=True)
    return _Expected(np.concatenate(square), np.concatenate(noise), np.concatenate(kernels, axis=1))


def fit_modulation(texture: Texture, stretches: Sequence[Streams]) -> ModulationFit:
    """Fits the amplitude modulation of a texture to runs of sliding at the sample rate of the texture."""
    found = list(_windows(texture, stretches))
    if not found:
        return ModulationFit(None, reason=f"no run of sliding is {SHORTEST_S:g} s long")
    speed = float(np.mean([v.mean() for *_, v in found]))
    noise = _noise(texture, found)
    blocks = found[:: -(-len(found) // BLOCKS_MAX)]
    parts = []
    for block in blocks:
        basis = _basis(block)
        expected = np.array([np.sum(basis * (one @ basis), axis=0) for one in _covariances(block[2], noise, speed)])
        parts.append(_Expected((basis.T @ block[0][0]) ** 2, expected[0], expected[1:]))
    kind = _kind(blocks, parts, noise, speed)
    seen = _together(parts)
    power, gain = seen.fitted(kind)
    spread = 0.5 * np.sqrt(power)
    whole = float(np.sqrt(np.sum(spread**2)))
    if 2.0 * gain < SUPPORT or whole < SPREAD_LEAST:
        return ModulationFit(None, reason="the level varies no more than the level of stationary noise")
    rng = np.random.default_rng(0)
    chance, kernels = seen.noise, seen.kernels[_KINDS[kind]]
    square = (chance + power @ kernels) * rng.chisquare(1.0, (DRAWS, len(chance)))
    drawn = 0.5 * np.sqrt(_fitted(square, chance, kernels, np.maximum(power, 1e-3), 40)[0])
    kept = spread > SHARE_LEAST * whole
    low, high = np.quantile(drawn[:, kept], (0.025, 0.975), axis=0)
    error = float(np.std(0.5 * np.log(np.sum(drawn**2, axis=1))))
    factor = float(np.exp(1.96 * np.hypot(error, BETWEEN)))
    low, high = np.append(low, whole / factor), np.append(high, whole * factor)
    rate_1_s, none = 1.0 / np.array(CORRELATION_S), np.zeros(_COUNT)
    decay_1_s, decay_1_m = np.hstack([rate_1_s, none]), np.hstack([none, rate_1_s / speed])
    kinds = _KINDS[kind]
    spread = spread * (min(whole, SPREAD_MAX) / float(np.sqrt(np.sum(spread[kept] ** 2))))
    modulation = GainModulation(spread[kept], decay_1_s[kinds][kept], decay_1_m[kinds][kept])
    return ModulationFit(modulation, tuple(zip(low.tolist(), high.tolist(), strict=True)))


def moving_runs(
    stretches: Sequence[Streams], window_s: float, shortest_s: float
) -> Iterator[tuple[int, int, int, int]]:
    """Runs in which the tool moves: index of the stretch, first sample, number of windows, samples per window."""
    most_N, most_m_s = (max(getattr(s, name).max() for s in stretches) for name in ("force_N", "speed_m_s"))
    for i, stretch in enumerate(stretches):
        length = round(window_s * stretch.rate_Hz)
        moving = (stretch.force_N > SLIDING * most_N) & (stretch.speed_m_s > SLIDING * most_m_s)
        for start, end in runs(moving):
            if end - start >= shortest_s * stretch.rate_Hz:
                yield i, start, (end - start) // length, length


def _windows(texture: Texture, stretches: Sequence[Streams]) -> Iterator[_Block]:
    """Blocks of about `BLOCK_S`: logarithms of the power (2, n) of recording and texture, force and speed (n,)."""
    for i, start, windows, length in moving_runs(stretches, WINDOW_S, SHORTEST_S):
        rate_Hz = stretches[i].rate_Hz
        edges = np.linspace(0, windows, max(1, round(windows * WINDOW_S / BLOCK_S)) + 1).astype(int)
        for first, last in pairwise(start + length * edges):
            part = part_of(stretches[i], slice(first, last))
            signal = part.acceleration_m_s2
            if rate_Hz > 2.2 * ACCELERATION_BAND_HZ[1]:
                signal = filtered(signal, rate_Hz, ACCELERATION_BAND_HZ[1], "lowpass")
            power, force, speed = (
                x.reshape(-1, length).mean(axis=1) for x in (signal**2, part.force_N, part.speed_m_s)
            )
            levels = power, texture.power(force, speed)
            floors = [FLOOR * one.mean() + np.finfo(np.float64).tiny for one in levels]
            yield np.log([np.maximum(one, floor) for one, floor in zip(levels, floors, strict=True)]), force, speed


def _noise(texture: Texture, found: Sequence[_Block]) -> Array:
    """Covariance (lags,) of the logarithms of the window powers of the texture without modulation.

    For windows of N samples with autocorrelation ρ: cov_j = 2/N² Σ_k (N − |k|) ρ²(jN + k). The relative variance is
    2/ν for a χ² distribution with ν degrees of freedom, whose logarithm has the variance ψ'(ν/2).
    """
    size, length = 1 << 13, round(WINDOW_S * texture.rate_Hz)
    force, speed = (np.concatenate([one[i] for one in found]) for i in (1, 2))
    step = -(-len(force) // 8)
    frequency = np.fft.rfftfreq(size, 1.0 / texture.rate_Hz)
    density = np.mean(texture.density(force[::step], speed[::step], frequency_Hz=frequency), axis=0)
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    density[(frequency < low_Hz) | (frequency > high_Hz)] = 0.0
    rho = np.fft.irfft(density)
    rho /= rho[0]
    k = np.arange(1 - length, length)
    lags = min(16, size // (2 * length) - 1)
    share = np.array([np.sum((length - np.abs(k)) * rho[np.abs(j * length + k)] ** 2) for j in range(lags)])
    share *= 2.0 / length**2
    return np.asarray(share * float(scipy.special.polygamma(1, 1.0 / share[0])) / share[0])


def _basis(block: _Block) -> Array:
    """Orthonormal basis (n, m) of a block, orthogonal to the texture level, the force and the speed."""
    (_, model), force, speed = block
    known = [np.ones(len(model))]
    if max(np.ptp(x) / x.mean() for x in (force, speed)) > FLAT:
        known += [model, *(np.log(x) for x in (force, speed) if np.ptp(x) > FLAT * x.mean())]
    # QR of the explained part followed by cosines: the remaining columns are nearly cosines
    cosines = scipy.fft.idct(np.eye(len(model)), axis=0, norm="ortho")[:, 1:]
    whole = np.linalg.qr(np.hstack([np.stack(known, axis=1), cosines]))[0]
    return np.asarray(whole[:, len(known) : len(model)])


def _covariances(speed: Array, chance: Array, mean_m_s: float) -> Iterator[Array]:
    """Yields covariances (n, n): without modulation, then of each process of variance 1 over time, then over distance.

    Between windows of widths w and w' at a distance u, in units of the correlation time, the covariance is
    exp(−u) sinh(w/2)/(w/2) sinh(w'/2)/(w'/2); within a window it is 2 (w − 1 + exp(−w))/w². These are exact means over
    the windows.
    """
    count = len(speed)
    lags = np.zeros(count)
    lags[: len(chance)] = chance[:count]
    yield np.asarray(scipy.linalg.toeplitz(lags))
    for width in (np.full(count, WINDOW_S), speed * WINDOW_S / mean_m_s):
        place = np.cumsum(width) - 0.5 * width
        for w, u in ((width / correlation_s, place / correlation_s) for correlation_s in CORRELATION_S):
            within = np.sinh(0.5 * w) / (0.5 * w)
            kernel = np.exp(-np.abs(u[:, None] - u)) * (within[:, None] * within)
            np.fill_diagonal(kernel, 2.0 * (w - 1.0 + np.exp(-w)) / w**2)
            yield kernel


def _fitted(
    square: Array, noise: Array, kernels: Array, start: Array | float = 0.1, steps: int = 200
) -> tuple[Array, Array]:
    """Maximum-likelihood variances (..., k) of the processes for squares (..., m), and the gain of log-likelihood.

    Each multiplicative update uses the root of the ratio of the two parts of the gradient. The variances remain
    nonnegative and the likelihood never decreases (Févotte & Idier 2011, "Algorithms for nonnegative matrix
    factorization with the β-divergence", Neural Computation 23(9))."""
    power = np.full((*square.shape[:-1], len(kernels)), start)
    for _ in range(steps):
        model = noise + power @ kernels
        power *= np.sqrt(((square / model**2) @ kernels.T) / ((1.0 / model) @ kernels.T))
    model = noise + power @ kernels
    return power, -0.5 * np.sum(np.log(model / noise) + square / model - square / noise, axis=-1)


def _kind(blocks: Sequence[_Block], parts: Sequence[_Expected], noise: Array, mean_m_s: float) -> str:
    """Chooses processes over time, distance or both by cross-validation between the halves of the blocks.

    Without a significant difference, time is chosen; the modulation is then the same at all speeds.
    """
    if len(blocks) < 2:
        return "time"
    halves = [_together(parts[i::2]) for i in (0, 1)]
    powers = {(i, kind): halves[i].fitted(kind)[0] for i in (0, 1) for kind in _KINDS}
    score = dict.fromkeys(_KINDS, 0.0)
    for number, block in enumerate(blocks):
        basis = _basis(block)  # computed again, because all bases together need too much memory
        found = _covariances(block[2], noise, mean_m_s)
        whole = dict.fromkeys(_KINDS, next(found))
        for i, kernel in enumerate(found):
            for kind, chosen in _KINDS.items():
                if chosen.start <= i < chosen.stop:
                    whole[kind] = whole[kind] + powers[1 - number % 2, kind][i - chosen.start] * kernel
        for kind in _KINDS:
            root = np.linalg.cholesky(basis.T @ whole[kind] @ basis)
            white = scipy.linalg.solve_triangular(root, basis.T @ block[0][0], lower=True)
            score[kind] -= float(0.5 * white @ white + np.sum(np.log(np.diag(root))))
    if score["both"] > max(score["distance"], score["time"]) + MARGIN:
        return "both"
    return "distance" if score["distance"] > score["time"] + MARGIN else "time"
