"""Section 2 of the paper: realism ratings of taps, computed for the handle in several grips. No person is involved.

A tap on wood is rendered by the handle with each compensator. A rating is 7 (like wood) minus the distance in twelve
frequency bands (`hapscene.perception`) in just-noticeable differences, and at least 1.
"""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.force_source import simulated_grips
from hapscene.handle.handle_loop import play
from hapscene.handle.plant import Plant
from hapscene.perception import BAND_DB, band_edges_Hz, band_rms_m_s2, bands_jnd
from hapscene.swatches.library import load_swatch

from .result import COLOURS, SETTING, Array, FigureResult, Number, Plot, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CONDITIONS: Final = ("real", *COMPENSATORS)
GRIPS: Final = 12
"""Simulated grips [count], from a light to a firm one."""

LOWEST: Final = 1.0
HIGHEST: Final = 7.0
SPEEDS_M_S: Final = (0.1, 0.2, 0.3)
"""Approach speeds of the taps that are rated together [m/s]."""

PAPER_RATINGS: Final = {"none": 2.0, "inverse": 5.0}
"""Ratings of the stiffest wall made of a spring alone, and of the same wall with acceleration transients."""

PLACE: Final = "Section 2, The Key to Haptographic Realism"


def distances(seed: int) -> Array:
    """Return the distance of each condition from the real tap (GRIPS, conditions) [JND], mean over the speeds."""
    taps, edges_Hz = load_swatch("wood").taps, band_edges_Hz()
    found = np.zeros((GRIPS, len(CONDITIONS)))
    assert taps is not None  # the shipped swatch has taps
    for row, (_, k, b) in enumerate(simulated_grips(GRIPS, seed)):
        hand = Plant(k_u_N_m=k, b_u_Ns_m=b)
        for column, condition in enumerate(CONDITIONS[1:], 1):
            for speed in SPEEDS_M_S:
                # Silence on both sides: Welch's windows weight the ends of a signal by zero.
                wave = np.pad(taps.transient(speed, ACCELERATION_RATE_HZ), 3000)
                played = play(wave, ACCELERATION_RATE_HZ, hand, compensator=condition, seed=seed).acceleration_m_s2
                bands, real = (band_rms_m_s2(signal, ACCELERATION_RATE_HZ, edges_Hz) for signal in (played, wave))
                found[row, column] += float(bands_jnd(bands, real, edges_Hz)) / len(SPEEDS_M_S)
    return found


def rated_taps(seed: int = 0) -> FigureResult:
    """Compute the ratings."""
    distance_jnd = distances(seed)
    ratings = np.maximum(HIGHEST - distance_jnd, LOWEST)
    names = ["no vibration" if name == "none" else name for name in CONDITIONS]

    def draw(axes: "Axes") -> None:
        at = np.arange(len(CONDITIONS))
        axes.plot(at, ratings.T, ".", color=COLOURS[0], alpha=0.5, markersize=5)
        axes.plot(at, ratings.mean(axis=0), "o", color=COLOURS[1], label="mean")
        axes.set_xticks(at, names)
        axes.set(ylabel="rating [1]", ylim=(LOWEST - 0.4, HIGHEST + 0.4))
        axes.grid(visible=False, axis="x")

    note = "computed from spectra; nothing follows about people"
    numbers = [Number("highest rating", HIGHEST, "1", 7.0, PLACE, SETTING)]
    for condition, name, value in zip(CONDITIONS, names, ratings.mean(axis=0), strict=True):
        paper = PAPER_RATINGS.get(condition)
        numbers.append(
            Number(f"mean rating, {name}", float(value), "1", paper, PLACE if paper else "", note if paper else "")
        )
    text = (
        "The paper cites a study (Kuchenbecker et al. 2006) in which people tapped on the stiffest spring-based wall "
        "of a Phantom, without and with acceleration transients, and on a real wooden block. Here the handle in "
        f"{GRIPS} simulated grips renders taps on wood at 0.1, 0.2 and 0.3 m/s. A rating is 7 minus 1 for each "
        f"just-noticeable difference ({BAND_DB:g} dB in a band). The waveform of the taps is assumed."
    )
    plots = [Plot("Ratings of taps, computed", "One dot for each grip.", drawn("taps", draw, 3.0))]
    return FigureResult("Realism ratings of taps: computed", text, numbers, plots)
