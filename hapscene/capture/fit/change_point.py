"""Where a vibration changes, an algorithm of its own (PELT): sliding cut into pieces by least description length.

A piece is described by one AR model of order `ORDER`; n samples of it cost n/2 ln σ², with σ² the residual power that
the model leaves. Each piece adds (ORDER + 4)/2 ln N: half of ln N for each of its ORDER + 1 numbers and one and a half
for the place where it ends (Davis, Lee & Rodriguez-Yam 2006, "Structural break estimation for nonstationary time
series models", JASA 101; used for textures by Culbertson, Unwin & Kuchenbecker 2014). The sum is made smallest over
all places, exactly, by dynamic programming with pruning (PELT: Killick, Fearnhead & Eckley 2012, JASA 107).

Why this cost: it sees a change of level and of spectrum alike, and its penalty is not tuned to a recording. It takes
the residual for Gaussian. That of real surfaces has bursts, whose power varies more than noise does; the penalty is
raised by as much, 1 + κ/2 with κ the excess kurtosis of the recording's own residual: the variance of a power
estimate is (2 + κ)σ⁴/n and not 2σ⁴/n.
"""

from typing import Final

import numpy as np
import scipy

from hapscene.capture.io.streams import Array

__all__ = ["FLOOR", "ORDER", "change_points"]

ORDER: Final = 8
"""Order of the search's models [count]: four resonances up to 1.25 kHz. The texture's own order is chosen later."""

RATE_HZ: Final = 2500.0
"""Rate that the search brings a recording down to, about [Hz]: what is felt is below 1 kHz."""

BLOCK_S: Final = 0.005
"""Grid of places for a change [s]."""

COARSE: Final = 4
"""Blocks of the first search's grid [count]: a sixteenth of the pairs."""

WINDOW_S: Final = 10.0
"""Longest stretch that is searched at once [s]."""

MARGIN_S: Final = 1.0
"""End of such a stretch in which a change is left to the next [s]."""

PIECE_MIN_S: Final = 0.1
"""Shortest piece [s]: five periods of what is lowest, and over less the hand changes nothing."""

PART: Final = 4096
"""Blocks whose sums are taken at once [count], for memory's sake."""

FLOOR: Final = 1e-6
"""White noise beneath every piece, as a share of its power [1]: −60 dB, as the noise of a good accelerometer."""


def change_points(signal: Array, rate_Hz: float) -> list[int]:
    """Samples at which a sliding vibration (n,) changes, ascending; none for one that is stationary.

    Places are first sought on every `COARSE`-th block, then between. A long recording is searched in windows of
    `WINDOW_S`, each from the last change on, so that the time grows with the length and not with its square.
    """
    factor = max(1, int(rate_Hz // RATE_HZ))
    low = np.asarray(scipy.signal.decimate(signal, factor, ftype="fir")) if factor > 1 else signal
    block = max(1, round(BLOCK_S * rate_Hz / factor))
    count = len(low) // (COARSE * block) * COARSE
    shortest = -(-round(PIECE_MIN_S * rate_Hz / factor) // (COARSE * block))
    if count < 2 * shortest * COARSE or not np.any(low):
        return []
    coarse = _product_sums(low[: count * block], block * COARSE)
    window, margin = (round(s / BLOCK_S) // COARSE for s in (WINDOW_S, MARGIN_S))
    penalty = 0.5 * (ORDER + 4) * np.log(min(count * block, WINDOW_S * rate_Hz / factor))
    penalty *= 1.0 + 0.5 * _excess_kurtosis(low)
    start, places = 0, [0]
    while True:
        end = min(start + window, len(coarse) - 1)
        found = [start + place for place in _cheapest(coarse[start : end + 1], block * COARSE, shortest, penalty)]
        if end == len(coarse) - 1:
            places += found
            break
        sure = [place for place in found if place <= end - margin]  # what comes after the window may move the others
        places += sure
        start = sure[-1] if sure else end - margin
    borders = [*places, len(coarse) - 1]
    return [
        _refined(low, coarse, before, at, after, block) * block * factor
        for before, at, after in zip(borders, borders[1:], borders[2:], strict=False)
    ]


def _refined(signal: Array, coarse: Array, before: int, at: int, after: int, block: int) -> int:
    """Where near the coarse block `at` the two pieces about it meet, in blocks: the mean of all places, each by its
    likelihood."""
    first, last = max(before + 1, at - 2), min(after - 1, at + 2)
    fine = coarse[first] + _product_sums(signal[: last * COARSE * block], block, first * COARSE * block)
    floor = _floor(coarse)
    left, right = fine - coarse[before] + floor, coarse[after] - fine + floor
    places, before, after = first * COARSE + np.arange(len(fine)), before * COARSE, after * COARSE
    size = (places - before) * block, (after - places) * block
    cost = size[0] * np.log(_residual(left) / size[0]) + size[1] * np.log(_residual(right) / size[1])
    weight = np.exp(-0.5 * (cost - cost.min()))
    return round(float((weight * places).sum() / weight.sum()))


def _floor(sums: Array) -> Array:
    """What rounding leaves in differences of sums, added so that none is singular."""
    return np.asarray((FLOOR**2 * sums[-1, -1, -1] + 1e-300) * np.eye(ORDER + 1))


def _product_sums(signal: Array, block: int, start: int = 0) -> Array:
    """Σ x(t−i) x(t−j) over all blocks from sample `start` on before each (count+1, ORDER+1, ORDER+1): of any piece by
    one subtraction.

    The sums of the covariance method. The shorter table of the autocorrelation method would not do: it is off by the
    edges of a piece, which outweigh the residual of a resonant surface. Lag 0 stands last.
    """
    count = (len(signal) - start) // block
    sums = np.zeros((count + 1, ORDER + 1, ORDER + 1))
    for first in range(0, count, PART):
        here = range(first, min(first + PART, count))
        end = start + here.stop * block
        past = signal[max(0, start + first * block - ORDER) : end]
        past = np.concatenate([np.zeros(ORDER + len(here) * block - len(past)), past])
        rows = np.lib.stride_tricks.sliding_window_view(past, ORDER + 1).reshape(len(here), block, ORDER + 1)
        sums[first + 1 : here.stop + 1] = rows.transpose(0, 2, 1) @ rows
    return np.cumsum(sums, axis=0, out=sums)


def _cheapest(sums: Array, block: int, shortest: int, penalty: float) -> list[int]:
    """The blocks at which a new piece begins, by PELT."""
    count = len(sums) - 1
    sums = sums - sums[0]
    floor = _floor(sums)
    best = np.full(count + 1, np.inf)  # cost of describing all blocks before this one
    best[0] = -penalty
    last = np.zeros(count + 1, dtype=np.intp)
    starts = np.zeros(0, dtype=np.intp)  # where the last piece may begin
    until = np.zeros(0, dtype=np.intp)  # and up to which end: one that lost still counts for `shortest` blocks
    for end in range(shortest, count + 1):
        newest = end - shortest
        if np.isfinite(best[newest]):
            starts, until = np.append(starts, newest), np.append(until, count + 1)
        length = (end - starts) * block
        cost = best[starts] + 0.5 * length * np.log(_residual(sums[end] - sums[starts] + floor) / length)
        chosen = int(np.argmin(cost))
        best[end], last[end] = cost[chosen] + penalty, starts[chosen]
        until = np.minimum(until, np.where(cost > best[end], end + shortest, count + 1))
        starts, until = starts[until > end], until[until > end]
    places, end = [], count
    while last[end] > 0:
        end = int(last[end])
        places.append(end)
    return places[::-1]


def _residual(products: Array) -> Array:
    """Σ e² (m,) that the best AR model leaves of pieces of products (m, ORDER+1, ORDER+1), by Cholesky's factor."""
    lag = np.arange(ORDER + 1)
    products[:, lag, lag] *= 1.0 + FLOOR
    return np.asarray(np.linalg.cholesky(products)[:, -1, -1] ** 2)


def _excess_kurtosis(signal: Array) -> float:
    """Of the residual of short pieces, each by its own level, so that a change of level is no burst; at least 0."""
    from hapscene.dsp.linear_prediction import autocorrelation, solve

    residual = np.asarray(scipy.signal.lfilter(solve(autocorrelation(signal, ORDER)), [1.0], signal))[ORDER:]
    length = ORDER * 32  # a tenth of a second
    count = len(residual) // length
    rows = residual[: count * length].reshape(count, length) if count else residual[None]
    power = np.mean(rows**2, axis=1)
    heard = power > 0.0
    kurtosis = np.mean(rows[heard] ** 4, axis=1) / power[heard] ** 2 - 3.0
    return max(0.0, float(np.median(kurtosis)))
