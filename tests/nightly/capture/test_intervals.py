"""95 % intervals contain the true value in 90 to 99 % of simulated recordings of random surfaces and natural hands.

HAPSCENE_COVERAGE_SEED is the first seed, 0 by default: other seeds are other surfaces and hands.
"""

import math
import os
from collections import defaultdict
from dataclasses import replace

import numpy as np

from hapscene.capture.fit.friction import _blocks, _slope, fit_friction
from tests.capture.natural_strokes import Hand, Surface, stroked

FIRST = int(os.environ.get("HAPSCENE_COVERAGE_SEED", "0"))
STROKED = range(FIRST, FIRST + 800)
"""Seeds. Each quantity is measured in more than 150 recordings: with 80, a coverage of 97 % is often seen as 100 %."""


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A random number whose logarithm is uniform."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def test_friction() -> None:
    """A quarter of the surfaces has no Stribeck curve, half no viscous friction; a term that is not there counts as 0.

    Without a viscous term, dynamic friction is that at the recorded speeds.
    """
    held = defaultdict(list)
    for seed in STROKED:
        rng = np.random.default_rng([7, seed])
        dynamic = rng.uniform(0.15, 0.6)
        surface = Surface(
            static=dynamic * (1.0 if rng.random() < 0.25 else rng.uniform(1.1, 1.6)),
            dynamic=dynamic,
            stribeck_m_s=between(rng, 0.008, 0.05),
            viscous_s_m=0.0 if rng.random() < 0.5 else dynamic * rng.uniform(0.5, 2.5),
        )
        hand = Hand(
            strokes=int(rng.integers(3, 21)),
            length_m=between(rng, 0.04, 0.15),
            duration_s=between(rng, 0.5, 3.0),
            rest_s=between(rng, 0.05, 0.5),
            force_N=rng.uniform(1.0, 3.0),
            spread=rng.uniform(0.05, 0.4),
        )
        recording = stroked(surface, hand, seed)
        found = fit_friction([recording])
        blocks = _blocks([recording])
        usual = _slope(replace(blocks, ratio=surface.ratio(blocks.fine).mean(axis=1)))
        truth = {
            "friction_static": surface.static,
            "friction_dynamic": dynamic if "friction_viscous_s_m" in found.intervals or not found.absent else usual,
            "friction_stribeck_m_s": surface.stribeck_m_s if surface.static > dynamic else math.inf,
            "friction_viscous_s_m": surface.viscous_s_m,
        }
        for name, (low, high) in found.intervals.items():
            held[name].append(low <= truth[name] <= high)
        for name in {"friction_dynamic", "friction_static"} - found.intervals.keys():
            assert found.absent.get(f"{name}.interval") or found.absent[name]
    few = {"friction_stribeck_m_s": 150, "friction_viscous_s_m": 280}
    least = {"friction_static": 700, "friction_dynamic": 700, **few}
    for name, inside in held.items():
        print(f"{name}: {100 * np.mean(inside):.1f} % of {len(inside)}")
        assert 0.9 <= np.mean(inside) <= 0.99 and len(inside) >= least[name], name
    assert held.keys() == least.keys()
