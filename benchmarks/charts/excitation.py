"""What noise drives a texture: Gaussian, or with the distribution that was measured."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.constants import EXCITATION_KNOTS, EXCITATION_SPAN

from .measuring import RATE_HZ, STROKES, Array, best, measured, no_recordings, recorded, texture_us
from .question import Measure, Point, Question, Setting
from .texture_domain import ORDER, planted_texture

if TYPE_CHECKING:
    from hapscene.surface.texture import Texture

STRIDES: Final = (16, 8, 4, 2, 1)
"""Each how many-th of the `EXCITATION_KNOTS` is kept [count]."""

FREEDOM: Final = 6.0
"""Of Student's t distribution that bursts are planted by [1]: an excess kurtosis of 3; recordings have 1.3 to 12.7."""

MODELS: Final = 3
"""Models of the textures that are fitted [count]."""

NEAR: Final = 1.05
"""How much farther fewer knots may be than all, to do as well [1]."""

PLAYED: Final = 200_000
"""Samples that are played to see their distribution [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    strides = (8, 1) if quick else STRIDES
    knots = [
        Setting("measured", f"{(EXCITATION_KNOTS - 1) // n + 1} knots", {"stride": n, "quick": quick}) for n in strides
    ]
    return [Setting("Gaussian", "no knots", {"stride": 0, "quick": quick}), *knots]


def error(stride: int, quick: bool = False) -> dict[str, float]:
    """Distances of what a noise is, and of what becomes of it in the filter, from what was not used to find it [σ]."""
    rng = np.random.default_rng(2)
    seen = rng.standard_t(FREEDOM, PLAYED // 10) / np.sqrt(FREEDOM / (FREEDOM - 2.0))
    found = {"planted": planted_distance(kept(seen, stride))}
    if not no_recordings():
        parts = [_held_out(name, stride) for name in (STROKES[:1] if quick else STROKES)]
        found["recorded"] = float(np.mean(parts))
    return found


def kept(residual: Array, stride: int) -> Array:
    """Each `stride`-th knot of a measured noise, brought back to mean 0 and variance 1; none for 0."""
    from hapscene.capture.excitation import quantile_knots
    from hapscene.surface.texture import excitation_moments

    if stride == 0:
        return np.empty(0)
    knots = quantile_knots(residual)[::stride]
    mean, variance = excitation_moments(knots)
    return np.asarray((knots - mean) / np.sqrt(variance))


def planted_distance(knots: Array) -> float:
    """Wasserstein's distance of a noise from Student's t distribution of SciPy's, both of variance 1 [σ]."""
    from scipy.stats import norm, t

    level = (np.arange(4000) + 0.5) / 4000
    z = norm.ppf(level)
    if len(knots):
        place = np.linspace(-EXCITATION_SPAN, EXCITATION_SPAN, len(knots))
        z = np.interp(z, place, knots)
    return float(np.mean(np.abs(z - t.ppf(level, FREEDOM) / np.sqrt(FREEDOM / (FREEDOM - 2.0)))))


@cache
def _pieces(name: str) -> tuple["Texture", Array, Array]:
    """A texture fitted to a recording; residual and output of its pieces, each over its model's level."""
    from hapscene.capture.excitation import normalised
    from hapscene.capture.texture_fit import fit_texture
    from hapscene.capture.texture_pieces import cut

    pieces = cut(recorded(name))
    texture = fit_texture(pieces, RATE_HZ, ORDER, MODELS)
    return texture, *normalised(texture, pieces)


def _held_out(name: str, stride: int) -> float:
    """Amplitudes that are played, by the noise of a half of the pieces, against those of the other half; both ways."""
    from hapscene.capture.excitation import wasserstein
    from hapscene.dsp.lattice import run_lattice
    from hapscene.dsp.noise import seeded_state

    texture, residual, output = _pieces(name)
    k, _ = texture.lattice([texture.force_max_N], [texture.speed_max_m_s])
    middle, apart = len(output) // 2, []
    for own, other in ((slice(middle), slice(middle, None)), (slice(middle, None), slice(middle))):
        played: Any = np.empty(PLAYED)
        rng, state = seeded_state(0, "excitation"), np.zeros((3, texture.order + 1))
        run_lattice(k, np.ones(1), 1.0, PLAYED, kept(residual[own].ravel(), stride), rng, state, played)
        heard = output[other].ravel()
        apart.append(wasserstein(played / played.std(), (heard - heard.mean()) / heard.std()))
    return float(np.mean(apart))


def time(stride: int, quick: bool = False) -> tuple[float, float]:
    texture = planted_texture("lsf", 2)
    knots = kept(np.random.default_rng(2).standard_t(FREEDOM, PLAYED // 10), 1) if stride else np.empty(0)
    return texture_us(replace(texture, excitation=knots))


def advice(points: Sequence[Point]) -> str:
    """Whether measured noise is nearer, and what it costs."""
    key = "planted" if no_recordings() else "recorded"
    plain = next(p for p in points if p.method == "Gaussian")
    knots = [p for p in measured(points, key) if p.method != "Gaussian"]  # the last has all
    few = next(p for p in knots if p.errors[key] <= NEAR * knots[-1].errors[key])
    gain = 100.0 * (1.0 - knots[-1].errors[key] / plain.errors[key])
    dear = float(np.median([p.median_us for p in knots])) - plain.median_us
    price = f"{dear:.2g} µs a block" if dear > 0.0 else "no more time"
    chosen = "measured" if gain > 0.0 else "Gaussian"
    known = best(points, "planted")
    return (
        f"Choose {chosen} noise where bursts are to be felt: with all {knots[-1].label} amplitudes that were not used "
        f"to find it are {gain:.0f} % nearer than with Gaussian noise ({knots[-1].errors[key]:.2g} and "
        f"{plain.errors[key]:.2g} σ), for {price}; {few.label} would do as well. Where the bursts are "
        f"known, {known.label} leave {known.errors['planted']:.1g} σ of {plain.errors['planted']:.2g}. Not where a "
        "recording is short or its noise is near to Gaussian; and levels in bands, by which most is felt, do not "
        "change at all."
    )


QUESTION: Final = Question(
    name="excitation",
    title="Which noise drives a texture?",
    measures=(
        *(() if no_recordings() else (Measure("recorded", "amplitudes on recordings, held out", "σ", log=False),)),
        Measure("planted", "against a known distribution", "σ"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "Wasserstein's distance of order 1 in standard deviations: of the amplitudes that a fit to half of the "
        "pieces of wood, paper and leather plays, from those of the other half; and of a noise found from 20,000 "
        f"samples from the distribution that they were drawn from, Student's t of {FREEDOM:g} degrees of freedom. "
        "Timed with all knots: a table is looked up as fast whatever its length."
    ),
    per="block",
)
