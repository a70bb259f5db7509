"""How one surface changes: several of its swatches or recordings in the order of time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hapscene.capture.compare import Comparison, Quantity, compare
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch

TREND_COUNT: Final = 5
"""Fewest surfaces that a trend is told from [count]: even four in perfect order come so by chance once in twelve."""

CHANCE: Final = 0.05
"""Chance below which an order is taken for a trend [1]."""


@dataclass(frozen=True)
class Trend:
    """How a quantity goes over the surfaces.

    Attributes:
        quantity: which.
        change: (n,) of each surface against the first, in the quantity's unit of difference; NaN where unknown.
        slope: change from one surface to the next: the median slope of all pairs (Sen 1968).
        p_value: chance that as clear an order comes about without a trend (Kendall's τ), NaN for fewer than
            `TREND_COUNT` surfaces.
    """

    quantity: Quantity
    change: tuple[float, ...]
    slope: float
    p_value: float

    @property
    def word(self) -> str:
        """ "rising", "falling", "no trend", or "too few to tell"."""
        if math.isnan(self.p_value):
            return "too few to tell"
        if self.p_value >= CHANCE or self.slope == 0.0:
            return "no trend"
        return "rising" if self.slope > 0.0 else "falling"


@dataclass(frozen=True)
class Series:
    """A surface over time.

    Attributes:
        names: of the surfaces, in the order of time.
        comparisons: of each with the first.
        trends: of each quantity that was compared.
    """

    names: tuple[str, ...]
    comparisons: tuple[Comparison, ...]
    trends: tuple[Trend, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON; what is not known is null."""
        return {
            "surfaces": list(self.names),
            "against_first": [comparison.as_dict() for comparison in self.comparisons],
            "trends": [
                {
                    "name": trend.quantity.name,
                    "unit": trend.quantity.unit,
                    "change": [None if math.isnan(c) else c for c in trend.change],
                    "slope_per_surface": trend.slope,
                    "p_value": None if math.isnan(trend.p_value) else trend.p_value,
                    "trend": trend.word,
                }
                for trend in self.trends
            ],
        }


def follow(surfaces: Sequence[Swatch]) -> Series:
    """How a surface changes over its swatches, given in the order of time.

    Raises:
        CaptureError: fewer than two.
    """
    if len(surfaces) < 2:
        raise CaptureError(f"a change over time needs two surfaces or more, there {_are(len(surfaces))}")
    comparisons = tuple(compare(surfaces[0], other) for other in surfaces)
    quantities: dict[Quantity, list[float]] = {}
    for i, comparison in enumerate(comparisons):
        for difference in comparison.differences:
            change = quantities.setdefault(difference.quantity, [math.nan] * len(surfaces))
            change[i] = difference.change
    trends = tuple(_trend(quantity, change) for quantity, change in quantities.items() if len(_known(change)) > 1)
    return Series(tuple(surface.name for surface in surfaces), comparisons, trends)


def _trend(quantity: Quantity, change: list[float]) -> Trend:
    from scipy.stats import kendalltau, theilslopes

    known = _known(change)
    values = np.array(change)[known]
    slope = float(theilslopes(values, known)[0])
    p_value = math.nan
    if len(known) >= TREND_COUNT:
        tau = kendalltau(known, values)
        p_value = 1.0 if math.isnan(tau.pvalue) else float(tau.pvalue)  # NaN where all values are one
    return Trend(quantity, tuple(change), slope, p_value)


def _known(change: list[float]) -> list[int]:
    return [i for i, value in enumerate(change) if not math.isnan(value)]


def _are(count: int) -> str:
    return "is one" if count == 1 else f"are {count}"
