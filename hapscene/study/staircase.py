"""An adaptive threshold by QUEST+ (Watson 2017, J. Vision 17(3):10): each trial where it is most informative.

The chance to be right in two intervals is a Weibull function of the level, over threshold, slope and lapses
(Watson & Pelli 1983): 1 − λ − (½ − λ) exp(−(level / threshold)^slope). At the threshold it is 0.82, less a little for
lapses. All three are estimated; the library questplus keeps their joint posterior.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hapscene.errors import StudyError

__all__ = ["Staircase", "questplus_module"]

SLOPES: Final = (1.4, 2.0, 2.8, 4.0, 5.6)
"""Slopes that are considered [1]: 1.3 where d′ grows as the level does, 3.5 for detection (Watson & Pelli 1983).
With fewer, intervals hold the thresholds of people with other slopes less often; with more, each trial says less."""

LAPSES: Final = (0.0, 0.02, 0.05)
"""Lapse rates that are considered [1] (Wichmann & Hill 2001: most people's are below 0.05)."""

THRESHOLDS: Final = 80
"""Thresholds between the least and the most level [count]."""


class Staircase:
    """One staircase: `level` is what to play next, `add` takes the answer."""

    def __init__(self, levels: Sequence[float]) -> None:
        """Begin with a uniform prior.

        Args:
            levels: what can be played, ascending, > 0.

        Raises:
            StudyError: questplus is not installed.
        """
        self._levels = np.asarray(levels, dtype=np.float64)
        self._thresholds = np.geomspace(max(float(levels[0]), 1e-3 * float(levels[-1])), float(levels[-1]), THRESHOLDS)
        self._quest = questplus_module().QuestPlus(
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

    @property
    def level(self) -> float:
        """What to play next: where the expected entropy of the posterior is least."""
        return float(self._quest.next_stim["intensity"])

    def add(self, level: float, right: bool) -> None:
        """Take the answer to a level; one that is not among the levels counts as the nearest."""
        nearest = float(self._levels[np.argmin(np.abs(self._levels - level))])
        self._quest.update(stim={"intensity": nearest}, outcome={"response": "right" if right else "wrong"})

    def quantile(self, share: float) -> float:
        """A quantile of the threshold's posterior, in the unit of the levels."""
        scale = np.log(self._thresholds)
        half = 0.5 * (scale[1] - scale[0])
        edges = np.concatenate([[scale[0] - half], scale + half])
        marginal = self._quest.marginal_posterior["threshold"]
        found = float(np.interp(share, np.concatenate([[0.0], np.cumsum(marginal)]), edges))
        return math.exp(min(max(found, float(scale[0])), float(scale[-1])))

    def interval(self, certainty: float) -> tuple[float, float]:
        """The credible interval of the threshold, in the unit of the levels.

        An end that the levels do not enclose is infinite: people who are never right, or always, have their threshold
        beyond the levels.
        """
        tail = 0.5 * (1.0 - certainty)
        low, high = self.quantile(tail), self.quantile(1.0 - tail)
        least, most = float(self._thresholds[0]), float(self._thresholds[-1])
        return -math.inf if low <= least * (1.0 + 1e-9) else low, math.inf if high >= most * (1.0 - 1e-9) else high


def questplus_module() -> Any:
    """The module questplus.

    Raises:
        StudyError: it is not installed.
    """
    try:
        import questplus
    except ImportError:
        raise StudyError("a staircase needs the package questplus: pip install 'hapscene[study]'") from None
    return questplus
