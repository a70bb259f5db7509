"""Section 2 of the paper: realism ratings of taps, with simulated raters. It tests the protocol, not people.

Each rater taps on wood as it is and as the handle renders it with each compensator, with a certain grip, and rates
each from 1 (not like wood) to 7 (like wood). A Williams square balances the order: every condition occurs equally
often at each place and after each other condition. A rating is 7 minus the distance in twelve frequency bands
(`hapscene.perception`) in just-noticeable differences, minus a small amount for each earlier rating, plus noise.
"""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.force_source import simulated_grips
from hapscene.handle.plant import Plant
from hapscene.handle.playback import play
from hapscene.perception import BAND_DB, band_edges_Hz, band_rms_m_s2, bands_jnd
from hapscene.swatches.library import load_swatch

from .result import COLOURS, SETTING, Array, FigureResult, Number, Plot, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CONDITIONS: Final = ("real", *COMPENSATORS)
RATERS: Final = 12
"""Simulated raters [count]: each order of the square twice."""

LOWEST: Final = 1.0
HIGHEST: Final = 7.0
SPEEDS_M_S: Final = (0.1, 0.2, 0.3)
"""Approach speeds of the taps that are rated together [m/s]."""

FATIGUE: Final = 0.05
"""Decrease of a rating for each earlier rating in the session [points]. Assumed."""

SCATTER_POINTS: Final = 0.5
"""Standard deviation of a rater's offset, and of each rating [points]. Assumed."""

PAPER_RATINGS: Final = {"none": 2.0, "inverse": 5.0}
"""Ratings of the stiffest wall made of a spring alone, and of the same wall with acceleration transients."""

PLACE: Final = "Section 2, The Key to Haptographic Realism"


def williams_square(count: int) -> list[list[int]]:
    """Return balanced orders of an even number of conditions; each follows every other one exactly once."""
    first = [k // 2 + 1 if k % 2 else (count - k // 2) % count for k in range(count)]
    return [[(place + row) % count for place in first] for row in range(count)]


def distances(seed: int) -> Array:
    """Return the distance of each condition from the real tap (RATERS, conditions) [JND], mean over the speeds."""
    taps, edges_Hz = load_swatch("wood").taps, band_edges_Hz()
    found = np.zeros((RATERS, len(CONDITIONS)))
    assert taps is not None  # the shipped swatch has taps
    for row, (_, k, b) in enumerate(simulated_grips(RATERS, seed)):
        hand = Plant(k_u_N_m=k, b_u_Ns_m=b)
        for column, condition in enumerate(CONDITIONS[1:], 1):
            for speed in SPEEDS_M_S:
                # Silence on both sides: Welch's windows weight the ends of a signal by zero.
                wave = np.pad(taps.transient(speed, ACCELERATION_RATE_HZ), 3000)
                played = play(wave, ACCELERATION_RATE_HZ, hand, compensator=condition, seed=seed).acceleration_m_s2
                bands, real = (band_rms_m_s2(signal, ACCELERATION_RATE_HZ, edges_Hz) for signal in (played, wave))
                found[row, column] += float(bands_jnd(bands, real, edges_Hz)) / len(SPEEDS_M_S)
    return found


def rate(distance: Array, seed: int, scatter: float = SCATTER_POINTS, rounded: bool = True) -> Array:
    """Return ratings (raters, conditions) for distances (raters, conditions) [JND], in balanced orders.

    With `rounded` they are integers within the scale; otherwise they are the model's exact values.
    """
    rng = np.random.default_rng([seed, 11])
    orders, ratings = williams_square(distance.shape[1]), np.empty_like(distance)
    for rater, row in enumerate(distance):
        offset = scatter * rng.standard_normal()
        for place, condition in enumerate(orders[rater % len(orders)]):
            exact = HIGHEST - row[condition] - FATIGUE * place + offset + scatter * rng.standard_normal()
            ratings[rater, condition] = np.clip(round(exact), LOWEST, HIGHEST) if rounded else exact
    return ratings


def rated_taps(seed: int = 0) -> FigureResult:
    """Run the study."""
    distance_jnd = distances(seed)
    ratings = rate(distance_jnd, seed)
    mean, error = ratings.mean(axis=0), ratings.std(axis=0, ddof=1) / np.sqrt(RATERS)
    names = ["no vibration" if name == "none" else name for name in CONDITIONS]

    def draw(axes: "Axes") -> None:
        at = np.arange(len(CONDITIONS))
        spread = np.random.default_rng(seed).uniform(-0.2, 0.2, ratings.shape)
        axes.plot((at + spread).T, ratings.T, ".", color=COLOURS[0], alpha=0.5, markersize=5)
        axes.errorbar(at, mean, 1.96 * error, fmt="o", color=COLOURS[1], capsize=4, label="mean, ±1.96 standard errors")
        axes.set_xticks(at, names)
        axes.set(ylabel="rating [1]", ylim=(LOWEST - 0.4, HIGHEST + 0.4))
        axes.grid(visible=False, axis="x")

    note = "computed from spectra; nothing follows about people"
    numbers = [Number("highest rating", HIGHEST, "1", 7.0, PLACE, SETTING)]
    for condition, name, value in zip(CONDITIONS, names, mean, strict=True):
        paper = PAPER_RATINGS.get(condition)
        numbers.append(
            Number(f"mean rating, {name}", float(value), "1", paper, PLACE if paper else "", note if paper else "")
        )
    numbers += [
        Number(f"distance, {n}", float(d), "JND") for n, d in zip(names[1:], distance_jnd.mean(axis=0)[1:], strict=True)
    ]
    text = (
        "The paper cites a study (Kuchenbecker et al. 2006) in which people tapped on the stiffest spring-based wall "
        "of a Phantom, without and with acceleration transients, and on a real wooden block. Here "
        f"{RATERS} simulated raters tap at 0.1, 0.2 and 0.3 m/s on wood and on each rendering, in balanced orders. A "
        f"rating is 7 minus 1 for each just-noticeable difference ({BAND_DB:g} dB in a band), minus {FATIGUE:g} for "
        f"each earlier rating, with a standard deviation of {SCATTER_POINTS:g} between raters and between ratings, "
        "rounded to an integer from 1 to 7. The waveform of the taps is assumed."
    )
    caption = f"{RATERS} simulated raters, one dot each, and their means."
    plots = [Plot("Ratings of taps, simulated", caption, drawn("taps", draw, 3.0))]
    return FigureResult("Realism ratings of taps: simulated raters", text, numbers, plots)
