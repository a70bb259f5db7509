"""An adaptive threshold by QUEST+ (Watson 2017, J. Vision 17(3):10): each trial where it says most.

The chance to be right in two intervals is a Weibull function of the level, over threshold, slope and lapses
(Watson & Pelli 1983): 1 − λ − (½ − λ) exp(−(level / threshold)^slope). At the threshold it is 0.82, less a little for
lapses. All three are estimated; questplus, a library, keeps their joint posterior.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hapscene.errors import StudyError

SLOPES: Final = (1.4, 2.0, 2.8, 4.0, 5.6)
"""Slopes that are thought possible [1]: 1.3 where d′ grows as the level does, 3.5 for detection (Watson & Pelli 1983).
With fewer, intervals hold the thresholds of people with other slopes less often; with more, each trial says less."""

LAPSES: Final = (0.0, 0.02, 0.05)
"""Shares of lapses that are thought possible [1] (Wichmann & Hill 2001: most people's are below 0.05)."""

THRESHOLDS: Final = 80
"""Thresholds between the least and the most level [count]."""


class Staircase:
    """One staircase: `level` is what to play next, `add` tells the answer."""

    def __init__(self, levels: Sequence[float], *, linear: bool = False) -> None:
        """Begins without knowing anything.

        Args:
            levels: what can be played, ascending, > 0 (≥ 0 where linear).
            linear: thresholds are spaced evenly, else by ratio.

        Raises:
            StudyError: questplus is not installed.
        """
        questplus = library()
        self._levels = np.asarray(levels, dtype=np.float64)
        least, most = float(self._levels[0]), float(self._levels[-1])
        space = np.linspace if linear else np.geomspace
        least = max(least, 1e-3 * most)  # a threshold of nothing has no slope
        self._thresholds = space(least, most, THRESHOLDS)
        self._quest = questplus.QuestPlus(
            stim_domain={"intensity": self._levels},
            param_domain={
                "threshold": self._thresholds,
                "slope": np.array(SLOPES),
                "lower_asymptote": np.array([0.5]),
                "lapse_rate": np.array(LAPSES),
            },
            outcome_domain={"response": ["right", "wrong"]},
            func="weibull",
            stim_scale="linear",
        )
        self._linear = linear

    @property
    def level(self) -> float:
        """What to play next: where the expected entropy of the posterior is least."""
        return float(self._quest.next_stim["intensity"])

    def add(self, level: float, right: bool) -> None:
        """Takes the answer to a level; one that is none of ours counts as the nearest."""
        nearest = float(self._levels[np.argmin(np.abs(self._levels - level))])
        self._quest.update(stim={"intensity": nearest}, outcome={"response": "right" if right else "wrong"})

    @property
    def known_within(self) -> float:
        """How far the threshold is known, as a share of it [1].

        The standard deviation of the normal whose entropy is that of the threshold's posterior.
        """
        p = self._marginal()
        entropy = -float(np.sum(p[p > 0.0] * np.log(p[p > 0.0])))
        scale = self._thresholds if self._linear else np.log(self._thresholds)
        spread = float(scale[1] - scale[0]) * math.exp(entropy) / math.sqrt(2.0 * math.pi * math.e)
        return spread / self.threshold if self._linear else spread

    @property
    def threshold(self) -> float:
        """The threshold: the median of its posterior, in the unit of the levels."""
        return self.quantile(0.5)

    def quantile(self, share: float) -> float:
        """The threshold below which it lies with this probability, in the unit of the levels."""
        scale = self._thresholds if self._linear else np.log(self._thresholds)
        half = 0.5 * (scale[1] - scale[0])
        edges = np.concatenate([[scale[0] - half], scale + half])
        below = np.concatenate([[0.0], np.cumsum(self._marginal())])
        found = float(np.interp(share, below, edges))
        found = min(max(found, float(scale[0])), float(scale[-1]))
        return found if self._linear else math.exp(found)

    def interval(self, certainty: float) -> tuple[float, float]:
        """Where the threshold is with this probability, in the unit of the levels; open where it may lie beyond them.

        Open is an end at which the outermost threshold that is thought possible is so probable that the interval
        does not end before it: people who are never right, or always, have their threshold beyond.
        """
        tail = 0.5 * (1.0 - certainty)
        low, high = self.quantile(tail), self.quantile(1.0 - tail)
        least, most = float(self._thresholds[0]), float(self._thresholds[-1])
        return -math.inf if low <= least * (1.0 + 1e-9) else low, math.inf if high >= most * (1.0 - 1e-9) else high

    def _marginal(self) -> Any:
        return self._quest.marginal_posterior["threshold"]


def library() -> Any:
    """questplus.

    Raises:
        StudyError: it is not installed.
    """
    try:
        import questplus
    except ImportError:
        raise StudyError("a staircase needs the package questplus: pip install 'hapscene[study]'") from None
    return questplus
