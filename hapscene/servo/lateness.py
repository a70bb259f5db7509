"""How late ticks begin and how long they take: histograms, which the tick fills without allocating."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.native import native

BIN_NS: Final = 100.0
"""Upper edge of the first bin [ns]: what the clock tells apart is less."""

BINS_PER_OCTAVE: Final = 8
"""Bins until a time has doubled [count]: each is 9 % wide, less than two runs differ by."""

BIN_COUNT: Final = 24 * BINS_PER_OCTAVE + 1
"""Bins of a histogram [count]: the last ends at 1.7 s, and holds what is longer."""


@native
def count(histogram: Any, span_ns: int) -> None:
    """One more in the bin of this time."""
    at = 1 + int(BINS_PER_OCTAVE * math.log2(span_ns / BIN_NS)) if span_ns > BIN_NS else 0
    histogram[min(at, BIN_COUNT - 1)] += 1


def percentile_us(histogram: NDArray[np.int64], share: float) -> float:
    """Upper edge of the bin in which that share of the counts is reached [µs]; 0 without any."""
    total = int(histogram.sum())
    if total == 0:
        return 0.0
    at = int(np.searchsorted(np.cumsum(histogram), share * total))
    return float(BIN_NS * 2.0 ** (at / BINS_PER_OCTAVE) / 1e3)


class Lateness(NamedTuple):
    """How well a loop kept time.

    Attributes:
        late, busy: (BIN_COUNT,) how many ticks began so late, and took so long, by bins as `count` has them.
        missed: ticks that were left out, since the loop was too late for them.
    """

    late: NDArray[np.int64]
    busy: NDArray[np.int64]
    missed: int

    def since(self, earlier: "Lateness") -> "Lateness":
        """What came after an earlier look at the same loop."""
        return Lateness(self.late - earlier.late, self.busy - earlier.busy, self.missed - earlier.missed)

    def late_us(self, share: float = 0.5) -> float:
        """How late, at most, that share of the ticks began: to 9 % [µs]."""
        return percentile_us(self.late, share)

    def busy_us(self, share: float = 0.5) -> float:
        """How long, at most, that share of them took: to 9 % [µs]."""
        return percentile_us(self.busy, share)
