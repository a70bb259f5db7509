"""Adaptive thresholds by QUEST+ (Watson 2017, J. Vision 17(3):10): each trial uses the most informative level.

The probability of a correct answer in two intervals is a Weibull function of the level (Watson & Pelli 1983): 1 − λ
− (½ − λ) exp(−(level / threshold)^slope), with threshold, slope and lapse rate λ. At the threshold it is 0.82,
slightly less with lapses. The library questplus estimates the joint posterior of the three parameters.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hapscene.errors import StudyError

__all__ = ["Staircase", "questplus_module"]

SLOPES: Final = (1.4, 2.0, 2.8, 4.0, 5.6)
"""Slopes of the grid [1]: 1.3 if d′ is proportional to the level, 3.5 for detection (Watson & Pelli 1983). With fewer
values, intervals contain the thresholds of people with other slopes less often; with more, each trial is less
informative."""

LAPSES: Final = (0.0, 0.02, 0.05)
"""Lapse rates of the grid [1]; those of most people are below 0.05 (Wichmann & Hill 2001)."""

THRESHOLDS: Final = 80
"""Number of thresholds between the lowest and the highest level [count]."""


class Staircase:
    """One staircase: `level` is the next level to play, `add` takes the answer."""

    def __init__(self, levels: Sequence[float]) -> None:
        """Begin with a uniform prior.

        Args:
            levels: levels that can be played, ascending, above 0.

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
        """The next level: the one with the least expected entropy of the posterior."""
        return float(self._quest.next_stim["intensity"])

    def add(self, level: float, right: bool) -> None:
        """Add the answer to a level; a level that is not on the grid counts as the nearest one."""
        nearest = float(self._levels[np.argmin(np.abs(self._levels - level))])
        self._quest.update(stim={"intensity": nearest}, outcome={"response": "right" if right else "wrong"})

    def quantile(self, share: float) -> float:
        """A quantile of the posterior of the threshold, in the unit of the levels."""
        scale = np.log(self._thresholds)
        half = 0.5 * (scale[1] - scale[0])
        edges = np.concatenate([[scale[0] - half], scale + half])
        marginal = self._quest.marginal_posterior["threshold"]
        found = float(np.interp(share, np.concatenate([[0.0], np.cumsum(marginal)]), edges))
        return math.exp(min(max(found, float(scale[0])), float(scale[-1])))

    def interval(self, certainty: float) -> tuple[float, float]:
        """The credible interval of the threshold, in the unit of the levels.

        An end beyond the range of the levels is infinite: a participant who is never or always right has a threshold
        outside it.
        """
        tail = 0.5 * (1.0 - certainty)
        low, high = self.quantile(tail), self.quantile(1.0 - tail)
        least, most = float(self._thresholds[0]), float(self._thresholds[-1])
        return -math.inf if low <= least * (1.0 + 1e-9) else low, math.inf if high >= most * (1.0 - 1e-9) else high


def questplus_module() -> Any:
    """Import the module questplus.

    Raises:
        StudyError: it is not installed.
    """
    try:
        import questplus
    except ImportError:
        raise StudyError("staircase blocks need the package questplus; run: pip install 'hapscene[study]'") from None
    return questplus
