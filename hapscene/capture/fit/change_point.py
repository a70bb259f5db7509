"""Change point detection (PELT): divides sliding into stationary segments by minimum description length.

Each segment is described by an AR model of order `ORDER`. Its n samples cost n/2 ln σ², where σ² is the residual power
of the model. Each segment adds a penalty of (ORDER + 4)/2 ln N: ½ ln N for each of its ORDER + 1 parameters, and 3/2 ln
N for the position of its end (Davis, Lee & Rodriguez-Yam 2006, "Structural break estimation for nonstationary time
series models", JASA 101; used for textures by Culbertson, Unwin & Kuchenbecker 2014). Dynamic programming with pruning
finds the exact minimum over all positions (PELT: Killick, Fearnhead & Eckley 2012, JASA 107).

This cost detects changes of level and of spectrum, and its penalty needs no tuning. It assumes a Gaussian residual. The
residual of real surfaces has bursts, so the variance of a power estimate is (2 + κ)σ⁴/n instead of 2σ⁴/n, where κ is
the excess kurtosis of the residual of the recording. The penalty is increased by the factor 1 + κ/2 accordingly."""

from typing import Final

import numpy as np
import scipy

from hapscene.capture.io.streams import Array

__all__ = ["change_points"]

ORDER: Final = 8
"""Order of the AR models: four resonances up to 1.25 kHz. The order of the texture is chosen later."""

RATE_HZ: Final = 2500.0
"""Approximate sample rate to which the recording is decimated [Hz]; perceptible vibration is below 1 kHz."""

BLOCK_S: Final = 0.005
"""Resolution of the change points [s]."""

COARSE: Final = 4
"""Blocks per step of the first, coarse search; it reduces the number of pairs to a sixteenth."""

WINDOW_S: Final = 10.0
"""Longest interval that is searched at once [s]."""

MARGIN_S: Final = 1.0
"""Final part of such an interval, whose change points are determined with the next interval [s]."""

SEGMENT_MIN_S: Final = 0.1
"""Shortest segment [s]: five periods of the lowest frequency; the hand changes little in a shorter time."""

BATCH: Final = 4096
"""Blocks whose sums are computed at once; this limits the memory."""

FLOOR: Final = 1e-6
"""White noise that is added to every segment, as a fraction of its power [1]: −60 dB, as of a good accelerometer."""


def change_points(signal: Array, rate_Hz: float) -> list[int]:
    """Samples at which the vibration (n,) of sliding changes, ascending; empty if it is stationary.

    A coarse search on every `COARSE`-th block is followed by a refinement. A long recording is searched in intervals of
    `WINDOW_S` that start at the last change point, so that the computing time is proportional to its length.
    """
    factor = max(1, int(rate_Hz // RATE_HZ))
    low = np.asarray(scipy.signal.decimate(signal, factor, ftype="fir")) if factor > 1 else signal
    block = round(BLOCK_S * rate_Hz / factor)
    count = len(low) // (COARSE * block) * COARSE
    shortest = -(-round(SEGMENT_MIN_S * rate_Hz / factor) // (COARSE * block))
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
        # samples after the interval may move later change points
        sure = [place for place in found if place <= end - margin]
        places += sure
        start = sure[-1] if sure else end - margin
    borders = [*places, len(coarse) - 1]
    return [
        _refined(low, coarse, before, at, after, block) * block * factor
        for before, at, after in zip(borders, borders[1:], borders[2:], strict=False)
    ]


def _refined(signal: Array, coarse: Array, before: int, at: int, after: int, block: int) -> int:
    """Refines a change point near the coarse block `at`: the mean of all positions, weighted by likelihood [blocks]."""
    first, last = at - 2, at + 2  # within the segments beside it, which are longer
    fine = coarse[first] + _product_sums(signal[: last * COARSE * block], block, first * COARSE * block)
    floor = _floor(coarse)
    left, right = fine - coarse[before] + floor, coarse[after] - fine + floor
    places, before, after = first * COARSE + np.arange(len(fine)), before * COARSE, after * COARSE
    size = (places - before) * block, (after - places) * block
    cost = size[0] * np.log(_residual(left) / size[0]) + size[1] * np.log(_residual(right) / size[1])
    weight = np.exp(-0.5 * (cost - cost.min()))
    return round(float((weight * places).sum() / weight.sum()))


def _floor(sums: Array) -> Array:
    """Regularisation: the rounding error of differences of sums, added so that no matrix is singular."""
    return np.asarray((FLOOR**2 * sums[-1, -1, -1] + 1e-300) * np.eye(ORDER + 1))


def _product_sums(signal: Array, block: int, start: int = 0) -> Array:
    """Cumulative sums (count+1, ORDER+1, ORDER+1) of x(t−i) x(t−j) at the borders of all blocks from `start` on.

    The difference of two of them is the matrix of the covariance method for the segment between them; lag 0 is the last
    row. The autocorrelation method would need smaller tables, but its error at the edges of a segment exceeds the
    residual of a resonant surface.
    """
    count = (len(signal) - start) // block
    sums = np.zeros((count + 1, ORDER + 1, ORDER + 1))
    for first in range(0, count, BATCH):
        here = range(first, min(first + BATCH, count))
        end = start + here.stop * block
        past = signal[max(0, start + first * block - ORDER) : end]
        past = np.concatenate([np.zeros(ORDER + len(here) * block - len(past)), past])
        rows = np.lib.stride_tricks.sliding_window_view(past, ORDER + 1).reshape(len(here), block, ORDER + 1)
        sums[first + 1 : here.stop + 1] = rows.transpose(0, 2, 1) @ rows
    return np.cumsum(sums, axis=0, out=sums)


def _cheapest(sums: Array, block: int, shortest: int, penalty: float) -> list[int]:
    """Blocks at which a new segment begins, by PELT."""
    count = len(sums) - 1
    sums = sums - sums[0]
    floor = _floor(sums)
    best = np.full(count + 1, np.inf)  # lowest cost of all blocks before this one
    best[0] = -penalty
    last = np.zeros(count + 1, dtype=np.intp)
    starts = np.zeros(0, dtype=np.intp)  # possible starts of the last segment
    # end up to which a start is kept: a pruned start stays possible for `shortest` blocks
    until = np.zeros(0, dtype=np.intp)
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
    """Residual Σ e² (m,) of the best AR models for matrices (m, ORDER+1, ORDER+1), by Cholesky factorisation."""
    lag = np.arange(ORDER + 1)
    products[:, lag, lag] *= 1.0 + FLOOR
    return np.asarray(np.linalg.cholesky(products)[:, -1, -1] ** 2)


def _excess_kurtosis(signal: Array) -> float:
    """Excess kurtosis of the residual, at least 0: the median over windows, so that changes of level do not count."""
    from hapscene.dsp.linear_prediction import autocorrelation, solve

    residual = np.asarray(scipy.signal.lfilter(solve(autocorrelation(signal, ORDER)), [1.0], signal))[ORDER:]
    length = ORDER * 32  # a tenth of a second
    count = len(residual) // length
    rows = residual[: count * length].reshape(count, length) if count else residual[None]
    power = np.mean(rows**2, axis=1)
    nonzero = power > 0.0
    kurtosis = np.mean(rows[nonzero] ** 4, axis=1) / power[nonzero] ** 2 - 3.0
    return max(0.0, float(np.median(kurtosis)))
