"""A fit of its own: the random slow gain of a texture, from how a recording's level scatters about the texture's own.

The level (the logarithm of the power, `ACCELERATION_BAND_HZ`, in windows of `WINDOW_S`) is a sum of three: what force
and speed explain, which is the texture's; the chance of a short window, known from the texture's spectrum; and the
logarithm of the gain. What force and speed explain is taken out of each block of the recording, and of what is
expected of it. What remains, in coordinates that are nearly frequencies, is held against the processes' covariance
by Whittle's likelihood, each coordinate with its exact expectation (Sykulski, Olhede, Guillaumin, Lilly & Early 2019,
"The debiased Whittle likelihood", Biometrika 106(2)), so that a second of recording is not too short.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from hapscene.capture.segment import runs
from hapscene.capture.streams import Array, Streams, filtered
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.surface.life import SPREAD_MAX, Life
from hapscene.surface.texture import Texture

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

_SUB: Final = 3  # points of a window that its covariance is the mean over


class LifeFit(NamedTuple):
    """What was found.

    Attributes:
        life: the gain, or None.
        intervals: 95 % of each spread, in the order of `life.spread`, and last of all together.
        reason: why there is none, or "".
        ahead: held-out log-likelihood of distance, and of both, over that of time [1]; NaN where it was not asked.
    """

    life: Life | None
    intervals: tuple[tuple[float, float], ...] = ()
    reason: str = ""
    ahead: tuple[float, float] = (np.nan, np.nan)


class _Block(NamedTuple):
    """A stretch of recording in coordinates in which force and speed explain nothing: m of them."""

    level: Array  # (m,)
    noise: Array  # (m, m) covariance of the chance of short windows
    kernels: Array  # (2 `_COUNT`, m, m) of each process at spread 1: by time, then by distance


_COUNT: Final = len(FORGETS_S)
_KINDS: Final = {"time": slice(0, _COUNT), "distance": slice(_COUNT, 2 * _COUNT), "both": slice(0, 2 * _COUNT)}


def fit_life(texture: Texture, stretches: Sequence[Streams]) -> LifeFit:
    """The slow gain of a texture in stretches of sliding at the texture's rate, or the reason why it has none."""
    found = list(_windows(texture, stretches))
    if not found:
        return LifeFit(None, reason=f"no stretch of sliding is {SHORTEST_S:g} s long")
    speed = float(np.mean([v.mean() for *_, v in found]))
    noise = _noise(texture, found)
    blocks = [_block(*one, noise, speed) for one in found[:: -(-len(found) // BLOCKS_MAX)]]
    kind, ahead = _kind(blocks)
    expected = _diagonals(blocks, kind)
    square = np.concatenate([block.level**2 for block in blocks])
    power, gain = _fitted(square, *expected)
    spread = 0.5 * np.sqrt(power)
    whole = float(np.sqrt(np.sum(spread**2)))
    if 2.0 * gain < SUPPORT or whole < SPREAD_LEAST:
        return LifeFit(None, reason="the level is as steady as that of noise of its spectrum", ahead=ahead)
    rng = np.random.default_rng(0)
    levels = [rng.standard_normal((DRAWS, len(b.level))) @ _root(b, power, kind).T for b in blocks]
    drawn = 0.5 * np.sqrt(_fitted(np.hstack(levels) ** 2, *expected, np.maximum(power, 1e-3), 40)[0])
    kept = spread > SHARE_LEAST * whole
    low, high = np.quantile(drawn[:, kept], (0.025, 0.975), axis=0)
    chance = float(np.std(0.5 * np.log(np.sum(drawn**2, axis=1))))
    factor = float(np.exp(1.96 * np.hypot(chance, BETWEEN)))
    low, high = np.append(low, whole / factor), np.append(high, whole * factor)
    rate_1_s, none = 1.0 / np.array(FORGETS_S), np.zeros(_COUNT)
    decay_1_s, decay_1_m = np.hstack([rate_1_s, none]), np.hstack([none, rate_1_s / speed])
    kinds = _KINDS[kind]
    spread = spread * (min(whole, SPREAD_MAX) / float(np.sqrt(np.sum(spread[kept] ** 2))))
    life = Life(spread[kept], decay_1_s[kinds][kept], decay_1_m[kinds][kept])
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


def _windows(texture: Texture, stretches: Sequence[Streams]) -> Iterator[tuple[Array, Array, Array]]:
    """Logarithms of the power (2, n), recorded and the texture's, force and speed (n, `_SUB`), in about `BLOCK_S`."""
    for i, start, windows, length in moving_runs(stretches, WINDOW_S, SHORTEST_S):
        stretch = stretches[i]
        run = slice(start, start + windows * length)
        signal, force, speed = stretch.acceleration_m_s2[run], stretch.force_N[run], stretch.speed_m_s[run]
        if stretch.rate_Hz > 2.2 * ACCELERATION_BAND_HZ[1]:
            signal = filtered(signal, stretch.rate_Hz, ACCELERATION_BAND_HZ[1], "lowpass")
        power, force, speed = (x.reshape(windows, length) for x in (signal, force, speed))
        model = texture.power(force.mean(axis=1), speed.mean(axis=1))
        power = np.mean(power**2, axis=1)
        level = np.log([np.maximum(one, FLOOR * one.mean() + np.finfo(np.float64).tiny) for one in (power, model)])
        at = (np.arange(_SUB) * length + length // 2) // _SUB
        for part in np.array_split(np.arange(windows), max(1, round(windows * WINDOW_S / BLOCK_S))):
            yield level[:, part], force[part][:, at], speed[part][:, at]


def _noise(texture: Texture, found: Sequence[tuple[Array, Array, Array]]) -> Array:
    """Covariance (lags,) of the logarithms of the powers of windows of the texture's noise, neither alive.

    Of the mean of N samples of ρ: cov_j = 2/N² Σ_k (N − |k|) ρ²(jN + k). As a share of the squared mean it is 2/ν,
    for a χ² of ν degrees, whose logarithm has the variance ψ'(ν/2).
    """
    from scipy.special import polygamma

    size, length = 1 << 14, round(WINDOW_S * texture.rate_Hz)
    force, speed = (np.concatenate([one[i][:, 0] for one in found]) for i in (1, 2))
    step = -(-len(force) // 64)
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
    return np.asarray(share * float(polygamma(1, 1.0 / share[0])) / share[0])


def _block(level: Array, force: Array, speed: Array, noise: Array, mean_m_s: float) -> _Block:
    """A stretch of n windows, without what the texture's level and those of force and speed explain."""
    from scipy.fft import idct
    from scipy.linalg import toeplitz

    level, model = level
    count = len(level)
    known = [np.ones(count)]
    if max(np.ptp(x) / x.mean() for x in (force, speed)) > FLAT:
        known += [model, *(np.log(x.mean(axis=1)) for x in (force, speed) if np.ptp(x) > FLAT * x.mean())]
    # the explained part first, then cosines: what QR makes of the rest are nearly those, and exactly without that part
    cosines = idct(np.eye(count), axis=0, norm="ortho")[:, 1:]
    basis = np.linalg.qr(np.hstack([np.stack(known, axis=1), cosines]))[0][:, len(known) : count]
    lags = np.zeros(count)
    lags[: len(noise)] = noise[:count]
    elapsed_s = WINDOW_S / _SUB * np.arange(count * _SUB)
    travelled_s = np.cumsum(speed.ravel()) * WINDOW_S / (_SUB * mean_m_s)  # in seconds of mean speed
    kernels = []
    for along in (elapsed_s, travelled_s):
        away = np.abs(along[:, None] - along)
        for forgets_s in FORGETS_S:
            fine = np.exp(-away / forgets_s).reshape(count, _SUB, count, _SUB).mean(axis=(1, 3))
            kernels.append(basis.T @ fine @ basis)
    return _Block(basis.T @ level, basis.T @ toeplitz(lags) @ basis, np.array(kernels))


def _diagonals(blocks: Sequence[_Block], kind: str) -> tuple[Array, Array]:
    """What is expected of the square of each coordinate: of chance (m,), and of each process (k, m) at power 1."""
    kernels = [np.diagonal(block.kernels[_KINDS[kind]], axis1=1, axis2=2) for block in blocks]
    return np.concatenate([np.diag(block.noise) for block in blocks]), np.concatenate(kernels, axis=1)


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


def _kind(blocks: Sequence[_Block]) -> tuple[str, tuple[float, float]]:
    """Whether the gain forgets by time, by distance or by both, as the other half of the blocks has it.

    Time is what is kept where the data do not say: then the gain goes on at any speed as it was recorded.
    """
    if len(blocks) < 2:
        return "time", (np.nan, np.nan)
    score = dict.fromkeys(_KINDS, 0.0)
    for own, other in ((blocks[::2], blocks[1::2]), (blocks[1::2], blocks[::2])):
        square = np.concatenate([block.level**2 for block in own])
        for kind in _KINDS:
            power, _ = _fitted(square, *_diagonals(own, kind))
            score[kind] += sum(_log_likelihood(block, power, kind) for block in other)
    ahead = score["distance"] - score["time"], score["both"] - score["time"]
    if ahead[1] > max(ahead[0], 0.0) + MARGIN:
        return "both", ahead
    return ("distance" if ahead[0] > MARGIN else "time"), ahead


def _log_likelihood(block: _Block, power: Array, kind: str) -> float:
    """Gaussian log-likelihood of a block, but for a constant."""
    from scipy.linalg import solve_triangular

    root = _root(block, power, kind)
    white = solve_triangular(root, block.level, lower=True)
    return float(-0.5 * white @ white - np.sum(np.log(np.diag(root))))


def _root(block: _Block, power: Array, kind: str) -> Array:
    """Lower root (m, m) of the covariance that a block has with processes of these powers."""
    return np.asarray(np.linalg.cholesky(block.noise + np.tensordot(power, block.kernels[_KINDS[kind]], 1)))
