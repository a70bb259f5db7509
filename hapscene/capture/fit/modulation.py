"""A fit of its own: the random slow gain of a texture, from how a recording's level scatters about the texture's own.

The level (the logarithm of the power, `ACCELERATION_BAND_HZ`, in windows of `WINDOW_S`) is a sum of three: what force
and speed explain, which is the texture's; the chance of a short window, known from the texture's spectrum; and the
logarithm of the gain. What force and speed explain is taken out of each block of the recording, and of what is
expected of it. What remains, in coordinates that are nearly frequencies, is held against the processes' covariance
by Whittle's likelihood, each coordinate with its exact expectation (Sykulski, Olhede, Guillaumin, Lilly & Early 2019,
"The debiased Whittle likelihood", Biometrika 106(2)), so that a second of recording is not too short.
"""

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

__all__ = ["fit_life"]

WINDOW_S: Final = 0.01
"""Length of the windows that levels are taken in [s]: the shortest in which 20 Hz to 1 kHz have a level."""

FORGETS_S: Final = (0.015, 0.04, 0.1, 0.25)
"""Times in which the processes forget [s]; those by distance forget in the distance travelled meanwhile, at the mean
speed. On held-out halves and thirds three, four and five such times did alike; of three, farther apart, spreads of
surfaces that forget in between came out 14 % too large."""

BLOCK_S: Final = 2.0
"""Length of the blocks that are taken by themselves [s]: six times the slowest process."""

BLOCKS_MAX: Final = 20
"""Most blocks used, from all over the recording [count]: 40 s tell the whole spread to some percent."""

SHORTEST_S: Final = 0.4
"""Shortest stretch that a spread is fitted to [s]."""

SLIDING: Final = 0.1
"""Share of the largest force and speed from which levels are used [1]: below it the sensor's noise is heard."""

SUPPORT: Final = 8.0
"""Twice the log-likelihood that life must gain [1]: steady noise gains as much once in a hundred recordings."""

SPREAD_LEAST: Final = 0.06
"""Least spread of the gain's logarithm that is kept [1]: half a decibel, which no one feels."""

MARGIN: Final = 2.0
"""Log-likelihood on held-out blocks by which distance must be ahead of time, or both of either [1]: odds of 7."""

SHARE_LEAST: Final = 0.15
"""Least share of the whole spread that a process is kept for [1]: one of less is 2 % of its square."""

DRAWS: Final = 100
"""Repetitions that the intervals are taken from [count]."""

FLAT: Final = 0.01
"""Share of its mean over which a force or speed must change for the level to depend on it [1]."""

BETWEEN: Final = 0.1
"""How far the whole spread may be off where a surface forgets in times between `FORGETS_S` [1]: on simulated ones."""

FLOOR: Final = 1e-6
"""Power, as a share of the mean, below which a window counts as having that [1]: a gap in a recording is no life."""


_COUNT: Final = len(FORGETS_S)
_KINDS: Final = {"time": slice(0, _COUNT), "distance": slice(_COUNT, 2 * _COUNT), "both": slice(0, 2 * _COUNT)}


class LifeFit(NamedTuple):
    """What was found.

    Attributes:
        life: the gain, or None.
        intervals: 95 % of each spread, in the order of `life.spread`, and last of all together.
        reason: why there is none, or "".
        ahead: held-out log-likelihood of distance, and of both, over that of time [1]; NaN where it was not asked.
    """

    life: GainModulation | None
    intervals: tuple[tuple[float, float], ...] = ()
    reason: str = ""
    ahead: tuple[float, float] = (np.nan, np.nan)


_Block = tuple[Array, Array, Array]  # levels (2, n), recorded and the texture's, forces (n,), speeds (n,)


class _Expected(NamedTuple):
    """What is expected of the squares of the coordinates, and what they are."""

    square: Array  # (m,)
    noise: Array  # (m,) by chance
    kernels: Array  # (2 `_COUNT`, m) of each process at power 1

    def fitted(self, kind: str) -> tuple[Array, Array]:
        return _fitted(self.square, self.noise, self.kernels[_KINDS[kind]])


def _together(parts: Sequence[_Expected]) -> _Expected:
    square, noise, kernels = zip(*parts, strict=True)
    return _Expected(np.concatenate(square), np.concatenate(noise), np.concatenate(kernels, axis=1))


def fit_life(texture: Texture, stretches: Sequence[Streams]) -> LifeFit:
    """The slow gain of a texture in stretches of sliding at the texture's rate, or the reason why it has none."""
    found = list(_windows(texture, stretches))
    if not found:
        return LifeFit(None, reason=f"no stretch of sliding is {SHORTEST_S:g} s long")
    speed = float(np.mean([v.mean() for *_, v in found]))
    noise = _noise(texture, found)
    blocks = found[:: -(-len(found) // BLOCKS_MAX)]
    parts = []
    for block in blocks:
        basis = _basis(block)
        expected = np.array([np.sum(basis * (one @ basis), axis=0) for one in _covariances(block[2], noise, speed)])
        parts.append(_Expected((basis.T @ block[0][0]) ** 2, expected[0], expected[1:]))
    kind, ahead = _kind(blocks, parts, noise, speed)
    seen = _together(parts)
    power, gain = seen.fitted(kind)
    spread = 0.5 * np.sqrt(power)
    whole = float(np.sqrt(np.sum(spread**2)))
    if 2.0 * gain < SUPPORT or whole < SPREAD_LEAST:
        return LifeFit(None, reason="the level is as steady as that of noise of its spectrum", ahead=ahead)
    rng = np.random.default_rng(0)
    chance, kernels = seen.noise, seen.kernels[_KINDS[kind]]
    square = (chance + power @ kernels) * rng.chisquare(1.0, (DRAWS, len(chance)))
    drawn = 0.5 * np.sqrt(_fitted(square, chance, kernels, np.maximum(power, 1e-3), 40)[0])
    kept = spread > SHARE_LEAST * whole
    low, high = np.quantile(drawn[:, kept], (0.025, 0.975), axis=0)
    error = float(np.std(0.5 * np.log(np.sum(drawn**2, axis=1))))
    factor = float(np.exp(1.96 * np.hypot(error, BETWEEN)))
    low, high = np.append(low, whole / factor), np.append(high, whole * factor)
    rate_1_s, none = 1.0 / np.array(FORGETS_S), np.zeros(_COUNT)
    decay_1_s, decay_1_m = np.hstack([rate_1_s, none]), np.hstack([none, rate_1_s / speed])
    kinds = _KINDS[kind]
    spread = spread * (min(whole, SPREAD_MAX) / float(np.sqrt(np.sum(spread[kept] ** 2))))
    life = GainModulation(spread[kept], decay_1_s[kinds][kept], decay_1_m[kinds][kept])
    return LifeFit(life, tuple(zip(low.tolist(), high.tolist(), strict=True)), "", ahead)


def moving_runs(
    stretches: Sequence[Streams], window_s: float, shortest_s: float
) -> Iterator[tuple[int, int, int, int]]:
    """Runs of windows in which the tool moves: stretch, first sample, windows, samples a window; none is shorter."""
    most_N, most_m_s = (max(getattr(s, name).max() for s in stretches) for name in ("force_N", "speed_m_s"))
    for i, stretch in enumerate(stretches):
        length = round(window_s * stretch.rate_Hz)
        moving = (stretch.force_N > SLIDING * most_N) & (stretch.speed_m_s > SLIDING * most_m_s)
        for start, end in runs(moving):
            if end - start >= shortest_s * stretch.rate_Hz:
                yield i, start, (end - start) // length, length


def _windows(texture: Texture, stretches: Sequence[Streams]) -> Iterator[_Block]:
    """Logarithms of the power (2, n), recorded and the texture's, force and speed (n,), in about `BLOCK_S`."""
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
    """Covariance (lags,) of the logarithms of the powers of windows of the texture's noise, neither alive.

    Of the mean of N samples of ρ: cov_j = 2/N² Σ_k (N − |k|) ρ²(jN + k). As a share of the squared mean it is 2/ν,
    for a χ² of ν degrees, whose logarithm has the variance ψ'(ν/2).
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
    """Coordinates (n, m) of a stretch of n windows in which the texture's level, force and speed explain nothing."""
    (_, model), force, speed = block
    known = [np.ones(len(model))]
    if max(np.ptp(x) / x.mean() for x in (force, speed)) > FLAT:
        known += [model, *(np.log(x) for x in (force, speed) if np.ptp(x) > FLAT * x.mean())]
    # the explained part first, then cosines: what QR makes of the rest are nearly those, and exactly without that part
    cosines = scipy.fft.idct(np.eye(len(model)), axis=0, norm="ortho")[:, 1:]
    whole = np.linalg.qr(np.hstack([np.stack(known, axis=1), cosines]))[0]
    return np.asarray(whole[:, len(known) : len(model)])


def _covariances(speed: Array, chance: Array, mean_m_s: float) -> Iterator[Array]:
    """Covariance (n, n) of chance, and of each process at power 1, by time, then by distance: one after the other.

    Between windows of widths w and w', u apart, it is exp(−u) sinh(w/2)/(w/2) sinh(w'/2)/(w'/2), all in the time in
    which it forgets; within one 2 (w − 1 + exp(−w))/w². Both are exact means over the windows.
    """
    count = len(speed)
    lags = np.zeros(count)
    lags[: len(chance)] = chance[:count]
    yield np.asarray(scipy.linalg.toeplitz(lags))
    for width in (np.full(count, WINDOW_S), speed * WINDOW_S / mean_m_s):
        place = np.cumsum(width) - 0.5 * width
        for w, u in ((width / forgets_s, place / forgets_s) for forgets_s in FORGETS_S):
            within = np.sinh(0.5 * w) / (0.5 * w)
            kernel = np.exp(-np.abs(u[:, None] - u)) * (within[:, None] * within)
            np.fill_diagonal(kernel, 2.0 * (w - 1.0 + np.exp(-w)) / w**2)
            yield kernel


def _fitted(
    square: Array, noise: Array, kernels: Array, start: Array | float = 0.1, steps: int = 200
) -> tuple[Array, Array]:
    """Powers (..., k) of the processes that make the squares (..., m) likeliest, and what they gain over none.

    Each step multiplies by the root of the ratio of the two parts of the gradient: none is ever negative, and the
    likelihood never falls (Févotte & Idier 2011, "Algorithms for nonnegative matrix factorization with the
    β-divergence", Neural Computation 23(9)).
    """
    power = np.full((*square.shape[:-1], len(kernels)), start)
    for _ in range(steps):
        model = noise + power @ kernels
        power *= np.sqrt(((square / model**2) @ kernels.T) / ((1.0 / model) @ kernels.T))
    model = noise + power @ kernels
    return power, -0.5 * np.sum(np.log(model / noise) + square / model - square / noise, axis=-1)


def _kind(
    blocks: Sequence[_Block], parts: Sequence[_Expected], noise: Array, mean_m_s: float
) -> tuple[str, tuple[float, float]]:
    """Whether the gain forgets by time, by distance or by both, as the other half of the blocks has it.

    Time is what is kept where the data do not say: then the gain goes on at any speed as it was recorded.
    """
    if len(blocks) < 2:
        return "time", (np.nan, np.nan)
    halves = [_together(parts[i::2]) for i in (0, 1)]
    powers = {(i, kind): halves[i].fitted(kind)[0] for i in (0, 1) for kind in _KINDS}
    score = dict.fromkeys(_KINDS, 0.0)
    for number, block in enumerate(blocks):
        basis = _basis(block)  # again: all of them would be as large as a minute's streams
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
    ahead = score["distance"] - score["time"], score["both"] - score["time"]
    if ahead[1] > max(ahead[0], 0.0) + MARGIN:
        return "both", ahead
    return ("distance" if ahead[0] > MARGIN else "time"), ahead
