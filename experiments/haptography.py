"""The tables of docs/haptography.md: what is modelled of a surface's vibration and how well, and what was not kept.

`python -m hapscene_experiments.haptography RECORDINGS docs/haptography.md` makes them again from the recordings. Half
of each is fitted and asked for the other half, at that one's forces and speeds, both ways. How well a texture does is
told in closed form, of the mean of its spectra along the stroke: no chance of synthesis is in it.
"""

import sys
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import kurtosis

from hapscene.capture.fit import distance as metric
from hapscene.capture.fit.change_point import change_points
from hapscene.capture.fit.segment import segment
from hapscene.capture.fit.swatch import FitOptions, fit_parts
from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.streams import Streams, part_of
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import autocorrelation, solve, tapered
from hapscene.files import whole_file
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import INTERPOLATIONS, Texture
from hapscene_benchmarks.charts.measuring import RATE_HZ
from hapscene_benchmarks.charts.texture_domain import FORCE_N, SPEED_M_S, planted_texture
from hapscene_benchmarks.markdown import table

from .paper.material import load_materials

Array = NDArray[np.float64]
Halves = dict[str, list[tuple[Streams, Streams]]]
"""By surface, the half that is fitted and the one that is asked for, both ways."""

STEP_S: Final = 0.01
"""Steps in which a stroke's forces and speeds are gone along [s]."""

HATT_ORDER: Final = 20
"""Order of the models of the Penn toolkit's finest files [count]."""

MODEL_COUNTS: Final = (1, 3, 6, 12, 24, "auto")

WIDE_S: Final = 30.0
"""How long the known surface is stroked, at 0.3 to 2 N and 0.04 to 0.25 m/s [s]: recordings of two seconds have a tenth
of that range and tell nothing of how many models are needed."""


WARM: Final = 2000
"""Samples that a filter is let run in for [count]."""


class Missed(NamedTuple):
    """How far a texture is from a recording.

    Attributes:
        shape_dB: log-spectral distance, 20 to 1000 Hz, level aside.
        level_dB: difference of level, its sign left out.
        bands_dB: root mean square over the twelve bands that are felt, level aside.
    """

    shape_dB: float
    level_dB: float
    bands_dB: float


def halves(folder: Path) -> Halves:
    """The two halves of each recording of a folder, both ways."""
    made = {}
    for name, material in load_materials(folder).items():
        middle = len(material.streams.force_N) // 2
        first, second = (part_of(material.streams, half) for half in (slice(middle), slice(middle, None)))
        made[name] = [(first, second), (second, first)]
    return made


def missed(texture: Texture, other: Streams) -> Missed:
    """How far a texture is from a recording that it was not fitted to."""
    frequency, true = metric.spectrum(other.acceleration_m_s2, other.rate_Hz)
    step = round(STEP_S * other.rate_Hz)
    density = texture.density(other.force_N[::step], other.speed_m_s[::step], frequency_Hz=frequency)
    return apart(density.mean(axis=0), true, frequency)


def apart(density: Array, true: Array, frequency_Hz: Array) -> Missed:
    """How far a power density is from the true one."""
    bands = [10.0 * np.log10(metric.band_power(one, frequency_Hz)) for one in (density, true)]
    power = [10.0 * np.log10(np.sum(10.0 ** (0.1 * one))) for one in bands]
    level = power[0] - power[1]
    shape = metric.log_spectral_distance(density, true, frequency_Hz)
    return Missed(shape, abs(level), float(np.sqrt(np.mean((bands[0] - bands[1] - level) ** 2))))


def chance(own: Streams, other: Streams) -> Missed:
    """How far the recording's other half itself is."""
    (frequency, one), (_, true) = (metric.spectrum(half.acceleration_m_s2, half.rate_Hz) for half in (own, other))
    return apart(one, true, frequency)


def fitted(own: Streams, **words: Any) -> Texture:
    """The texture that is fitted to a half; `words` as of `FitOptions`."""
    texture = fit_parts([(own, segment(own))], FitOptions(**words)).texture
    assert texture is not None
    return texture


def hatt_pipeline(own: Streams) -> Texture:
    """As the Penn toolkit makes its files, on the same half: cut where least description length says, an AR model of
    each stretch at its mean force and speed, line spectral frequencies and variance blended, clamped beyond."""
    cuts = [0, *change_points(own.acceleration_m_s2, own.rate_Hz), len(own.force_N)]
    force, speed, a, variance = [], [], [], []
    for start, end in pairwise(cuts):
        r = autocorrelation(tapered(own.acceleration_m_s2[start:end], own.rate_Hz), HATT_ORDER)
        a.append(solve(r))
        power = float(np.mean(own.acceleration_m_s2[start:end] ** 2))
        variance.append(power / float(power_gain(a[-1])))
        force.append(float(own.force_N[start:end].mean()))
        speed.append(float(own.speed_m_s[start:end].mean()))
    return Texture.from_models(own.rate_Hz, force, speed, a=np.stack(a), variance_m2_s4=variance, interpolation="hatt")


def mean_missed(parts: list[tuple[Streams, Streams]], how: Callable[[Streams, Streams], Missed]) -> Missed:
    """The mean of some halves."""
    return Missed(*np.mean([how(own, other) for own, other in parts], axis=0).tolist())


def _row(said: str, found: Missed) -> tuple[str, ...]:
    return (said, *(f"{value:.2f}" for value in found))


HEAD: Final = ("shape [dB]", "level [dB]", "bands [dB]")


def of_models(recorded: Halves) -> str:
    """Models over force and speed: how many, of a surface that is known where it is asked for."""
    surface = planted_texture("lsf", 5)
    force, speed = _wide_stroke(0)
    heard = synthesize(Swatch("known", texture=surface), force, speed, seed=0)
    step = round(10 * STEP_S * surface.rate_Hz)
    force_at, speed_at = (series[step // 2 :: step] for series in _wide_stroke(1))
    frequency = np.arange(20.0, 1000.0, 2.0)
    true = surface.density(force_at, speed_at, frequency_Hz=frequency)
    own, rows = Streams(surface.rate_Hz, heard, force, speed, None), []
    for count in MODEL_COUNTS:
        found = fitted(own, model_count=count).density(force_at, speed_at, frequency_Hz=frequency)
        each = [apart(one, right, frequency) for one, right in zip(found, true, strict=True)]
        rows.append(_row(f"{count}", Missed(*np.mean(each, axis=0).tolist())))
    return str(table(("models", *HEAD), rows))


def _wide_stroke(which: int) -> tuple[Array, Array]:
    """Forces and speeds (n,) of a hand that strokes softly and hard, slowly and fast."""
    t_s = np.arange(round(WIDE_S * RATE_HZ)) / RATE_HZ
    turn = [0.5 + 0.5 * np.sin(2.0 * np.pi * rate_Hz * t_s + which) for rate_Hz in (0.31, 0.47 * np.sqrt(2.0))]
    force, speed = (low * (high / low) ** one for (low, high), one in zip((FORCE_N, SPEED_M_S), turn, strict=True))
    return force, speed


def of_domains(recorded: Halves) -> str:
    """What is blended, and on which axis of frequency the filters are."""
    parts = [pair for pairs in recorded.values() for pair in pairs]
    several = {"model_count": 8}
    words = {f"plain, {name}": {"domain": "plain", "interpolation": name, **several} for name in INTERPOLATIONS}
    words |= {"warped, lsf": {"domain": "warped", **several}, "warped, lsf, models as chosen": {"domain": "warped"}}
    words |= {"all as chosen on held-out data": {}}
    rows = [
        _row(said, mean_missed(parts, lambda own, other: missed(fitted(own, **how), other)))  # noqa: B023 (called here)
        for said, how in words.items()
    ]
    return str(table(("filters, blended in", *HEAD), rows))


def of_hatt(recorded: Halves) -> str:
    """The toolkit's pipeline beside ours, surface by surface."""
    rows = []
    for name, pairs in recorded.items():
        if pairs[0][0].assumed:  # the toolkit needs force and speed
            continue
        for said, how in (
            ("HaTT's pipeline", lambda own, other: missed(hatt_pipeline(own), other)),
            ("hapscene", lambda own, other: missed(fitted(own), other)),
            ("its other half", chance),
        ):
            rows.append((name, *_row(said, mean_missed(pairs, how))))
    return str(table(("surface", "", *HEAD), rows))


def of_excitation(recorded: Halves) -> str:
    """Noise of a known distribution before and after the filter, and the surface itself."""
    rows, kinds = [], ("the surface, other half", "its residual, drawn anew", "Gaussian noise")
    for name, pairs in recorded.items():
        found: dict[str, list[tuple[float, ...]]] = {kind: [] for kind in kinds}
        for own, other in pairs:
            a = solve(autocorrelation(tapered(own.acceleration_m_s2, own.rate_Hz), 2 * HATT_ORDER))
            left = metric.residual(a, own.acceleration_m_s2)
            rng = np.random.default_rng(0)
            count = len(other.acceleration_m_s2) + WARM
            noises = rng.choice(left, count), rng.normal(0.0, left.std(), count)
            found[kinds[0]].append(_character(metric.residual(a, other.acceleration_m_s2), other.acceleration_m_s2))
            for kind, noise in zip(kinds[1:], noises, strict=True):
                found[kind].append(_character(noise, lfilter([1.0], a, noise)[WARM:]))
        rows += [(name, kind, *(f"{value:.2g}" for value in np.mean(found[kind], axis=0))) for kind in kinds]
    head = ("surface", "driven by", "kurtosis before", "and after", "modulation", "levels [dB]", "crest")
    return str(table(head, rows))


def _character(noise: Array, heard: Array) -> tuple[float, ...]:
    """Excess kurtosis of a noise and of what is heard of it, and how lively that is."""
    return float(kurtosis(noise)), float(kurtosis(heard)), *metric.liveliness(heard, RATE_HZ)


TABLES: Final[Mapping[str, Callable[[Halves], str]]] = {
    "models": of_models,
    "domains": of_domains,
    "hatt": of_hatt,
    "excitation": of_excitation,
}
"""By the name that the page has for them."""


def put_in(page: str, found: Mapping[str, str]) -> str:
    """The page with its tables, each between `<!-- table NAME -->` and `<!-- end -->`, made anew."""
    for name, text in found.items():
        before, start, rest = page.partition(f"<!-- table {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise ValueError(f"the page has no place for the table {name!r}")
        page = before + start + text + end + after
    return page


if __name__ == "__main__":
    page = Path(sys.argv[2])
    recorded = halves(Path(sys.argv[1]))
    found = {name: made(recorded) for name, made in TABLES.items()}
    with whole_file(page) as part:
        part.write_text(put_in(page.read_text(encoding="utf-8"), found), encoding="utf-8")
