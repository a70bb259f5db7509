"""How a cost grows with the work: its exponent, fitted on logarithmic axes. Drawn by the chart, judged by `growth`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import linregress, t

from .question import Point


class Exponent(NamedTuple):
    """cost = scale · work ^ slope."""

    slope: float
    low: float
    high: float
    """ends of its interval of 95 %; NaN of fewer than three points"""
    scale: float

    def words(self) -> str:
        """As it stands beside a line: "n^0.98 (0.95 to 1.01)"."""
        slope, low, high = (f"{round(number, 2) + 0.0:.2f}" for number in self[:3])  # no −0.00
        return f"n^{slope}" + ("" if np.isnan(self.low) else f" ({low} to {high})")


def fit_exponent(work: Sequence[float], cost: Sequence[float]) -> Exponent:
    """The exponent of costs (n,) over works (n,), both above 0, by least squares of their logarithms.

    Raises:
        ValueError: fewer than two works that differ.
    """
    found = linregress(np.log(work), np.log(cost))
    free = len(work) - 2
    half = float(t.ppf(0.975, free)) * float(found.stderr) if free > 0 else np.nan
    return Exponent(float(found.slope), found.slope - half, found.slope + half, float(np.exp(found.intercept)))


def exponents(points: Sequence[Point], key: str) -> dict[str, Exponent]:
    """How a cost grows, by what there is more of; what was too little to be measured is left out."""
    found = {}
    for method in dict.fromkeys(p.method for p in points):
        of = [p for p in points if p.method == method and p.errors.get(key, 0.0) > 0.0]
        if len({p.errors["work"] for p in of}) > 1:
            found[method] = fit_exponent([p.errors["work"] for p in of], [p.errors[key] for p in of])
    return found
