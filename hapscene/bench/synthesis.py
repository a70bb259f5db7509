"""Time of texture synthesis: the lattice with its noise and its models along a stroke, beside SciPy's direct form."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.synthesis import synthesize
from hapscene.surface.lsf import ar_from_reflection, power_gain
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

Array = NDArray[np.float64]

ORDERS: Final = (8, 20, 40, 80, 120)
"""Orders that are timed [count]."""

RATE_HZ: Final = 10_000.0
DURATION_S: Final = 10.0
REPEATS: Final = 7


@dataclass(frozen=True)
class SynthesisTime:
    """Times to make `DURATION_S` at `RATE_HZ`, the best of `REPEATS` [s].

    Attributes:
        order: of the models.
        one_s: `synthesize` where one filter holds for all forces and speeds, and the level follows them.
        many_s: `synthesize` with nine models that differ, along a stroke through all of them.
        lfilter_s: one call of `scipy.signal.lfilter` on noise that is there already, with one fixed filter and level.
    """

    order: int
    one_s: float
    many_s: float
    lfilter_s: float

    def real_times(self) -> tuple[float, float, float]:
        """The three as multiples of real time [1]."""
        return DURATION_S / self.one_s, DURATION_S / self.many_s, DURATION_S / self.lfilter_s


def measure() -> list[SynthesisTime]:
    """A row per order."""
    return [_measure(order) for order in ORDERS]


def _measure(order: int) -> SynthesisTime:
    from scipy.signal import lfilter

    rng = np.random.default_rng(order)
    common = rng.uniform(-0.3, 0.3, order)
    one = Swatch("one", texture=_texture(common[None], np.array([2.0]), np.array([0.2])))
    force, speed = (grid.ravel() for grid in np.meshgrid([0.5, 1.0, 2.0], [0.05, 0.1, 0.2]))
    many = Swatch("many", texture=_texture(common + rng.uniform(-0.1, 0.1, (9, order)), force, speed))
    t_s = np.arange(round(RATE_HZ * DURATION_S)) / RATE_HZ
    along = 1.0 + 0.9 * np.sin(2.1 * t_s), 0.1 + 0.09 * np.sin(3.3 * t_s)
    noise, a = rng.standard_normal(len(t_s)), ar_from_reflection(common)
    return SynthesisTime(
        order,
        _best(lambda: synthesize(one, *along)),
        _best(lambda: synthesize(many, *along)),
        _best(lambda: lfilter([1.0], a, noise)),
    )


def _texture(k: Array, force_N: Array, speed_m_s: Array) -> Texture:
    a = ar_from_reflection(k)
    return Texture.from_models(RATE_HZ, force_N, speed_m_s, a, 1.0 / power_gain(a))


def _best(job: Callable[[], Array]) -> float:
    job()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        job()
        times.append(time.perf_counter() - start)
    return min(times)
