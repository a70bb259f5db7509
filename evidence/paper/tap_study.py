"""The study of taps with simulated raters: its protocol and its arithmetic. It says nothing about people.

Each rater taps on wood as it is and as the handle renders it with each compensator, in a grip of their own, and rates
all of them from 1 (not like wood) to 7 (like wood), in an order that a Williams square balances: every rendering stands
at each place, and after each other one, equally often. A rating is 7, less a point for each just-noticeable difference
by which the twelve bands are off (`hapscene.perception`), less a little for each rating before it, with scatter.
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

from .finding import COLOURS, REMEMBERED, Array, Finding, Number, Plot, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CONDITIONS: Final = ("real", *COMPENSATORS)
RATERS: Final = 12
"""Simulated raters [count]: each order of the square twice."""

LOWEST: Final = 1.0
HIGHEST: Final = 7.0
SPEEDS_M_S: Final = (0.1, 0.2, 0.3)
"""Approach speeds of the taps that are rated together [m/s]."""

TIRED: Final = 0.05
"""Points that each further rating of a session costs [1]. Assumed."""

SCATTER_POINTS: Final = 0.5
"""Standard deviation of a rater's own level, and of each rating [1]. Assumed."""


def williams_square(count: int) -> list[list[int]]:
    """Orders of `count` conditions, an even number: each once a row and column, each after each other one once."""
    first = [k // 2 + 1 if k % 2 else (count - k // 2) % count for k in range(count)]
    return [[(place + row) % count for place in first] for row in range(count)]


def distances(seed: int) -> Array:
    """How far each condition is from the real tap for each rater (RATERS, conditions) [JND], mean over the speeds."""
    taps, edges_Hz = load_swatch("wood").taps, band_edges_Hz()
    found = np.zeros((RATERS, len(CONDITIONS)))
    assert taps is not None  # it is shipped with taps
    for row, (_, k, b) in enumerate(simulated_grips(RATERS, seed)):
        hand = Plant(k_u_N_m=k, b_u_Ns_m=b)
        for column, condition in enumerate(CONDITIONS[1:], 1):
            for speed in SPEEDS_M_S:
                wave = np.pad(taps.transient(speed, ACCELERATION_RATE_HZ), 3000)  # at its ends Welch is deaf
                felt = play(wave, ACCELERATION_RATE_HZ, hand, compensator=condition, seed=seed).acceleration_m_s2
                now, true = (band_rms_m_s2(signal, ACCELERATION_RATE_HZ, edges_Hz) for signal in (felt, wave))
                found[row, column] += float(bands_jnd(now, true, edges_Hz)) / len(SPEEDS_M_S)
    return found


def rate(distance: Array, seed: int, scatter: float = SCATTER_POINTS, whole: bool = True) -> Array:
    """Ratings (raters, conditions) of distances (raters, conditions) [JND], in balanced orders.

    Without scatter and not `whole`, neither rounded nor kept within the scale, they are what the model says.
    """
    rng = np.random.default_rng([seed, 11])
    orders, ratings = williams_square(distance.shape[1]), np.empty_like(distance)
    for rater, row in enumerate(distance):
        level = scatter * rng.standard_normal()
        for place, condition in enumerate(orders[rater % len(orders)]):
            felt = HIGHEST - row[condition] - TIRED * place + level + scatter * rng.standard_normal()
            ratings[rater, condition] = np.clip(round(felt), LOWEST, HIGHEST) if whole else felt
    return ratings


def rated_taps(seed: int = 0) -> Finding:
    """The study."""
    away = distances(seed)
    ratings = rate(away, seed)
    mean, error = ratings.mean(axis=0), ratings.std(axis=0, ddof=1) / np.sqrt(RATERS)
    names = ["silent" if name == "none" else name for name in CONDITIONS]

    def draw(axes: "Axes") -> None:
        at = np.arange(len(CONDITIONS))
        spread = np.random.default_rng(seed).uniform(-0.2, 0.2, ratings.shape)
        axes.plot((at + spread).T, ratings.T, ".", color=COLOURS[0], alpha=0.5, markersize=5)
        axes.errorbar(at, mean, 1.96 * error, fmt="o", color=COLOURS[1], capsize=4, label="mean, ±1.96 standard errors")
        axes.set_xticks(at, names)
        axes.set(ylabel="rating [1]", ylim=(LOWEST - 0.4, HIGHEST + 0.4))
        axes.grid(visible=False, axis="x")

    said = f"{RATERS} simulated raters, a dot each, and their means."
    why = "it repeats the distance of spectra; people were not asked"
    numbers = [
        Number("lowest rating", LOWEST, "1", 1.0, REMEMBERED),
        Number("highest rating", HIGHEST, "1", 7.0, REMEMBERED),
        *(Number(f"simulated rating, {n}", float(value), why=why) for n, value in zip(names, mean, strict=True)),
        *(Number(f"distance, {n}", float(d), "JND") for n, d in zip(names[1:], away.mean(axis=0)[1:], strict=True)),
    ]
    text = (
        f"Simulated raters: this tries the protocol and says nothing about people. Each of {RATERS} taps at 0.1, 0.2 "
        "and 0.3 m/s on wood and on each rendering of it, in a Williams square of orders. A rating is 7, less 1 for "
        f"each just-noticeable difference ({BAND_DB:g} dB) by which the bands are off, less {TIRED:g} "
        f"for each rating before it, with a scatter of {SCATTER_POINTS:g} of rater and rating; whole numbers from 1 to "
        "7. The form of the taps is assumed."
    )
    plots = [Plot("Ratings of taps, simulated", said, drawn("taps", draw, 3.0))]
    return Finding("The study of taps: simulated raters", text, numbers, plots)
