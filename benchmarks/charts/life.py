"""What makes a texture as lively as the surface: a slow gain of how many processes, by time or by distance."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
from scipy.signal import lfilter

from hapscene.capture.fit.distance import liveliness
from hapscene.capture.fit.modulation import fit_life
from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.fit.texture import fit_texture
from hapscene.capture.fit.windows import cut
from hapscene.capture.streams import Streams, part_of
from hapscene.surface.life import Life
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

from .measuring import RATE_HZ, STROKES, Array, best, measured, no_recordings, recorded, texture_us
from .question import Measure, Point, Question, Setting
from .texture_domain import ORDER, planted_texture

COUNTS: Final = (1, 2, 4)
"""To how many processes those that `fit` finds are joined [count]."""

OVER: Final = ("time", "distance")

SEEDS: Final = 20
"""Strokes that are synthesised for each half of a recording [count]."""

PLANTED: Final = ((0.4, 0.04), (0.3, 0.15))
"""Spread [1] and time of forgetting [s] of the processes of the known surface: none that `fit` has."""

PLANTED_S: Final = 10.0
"""How long it is recorded [s]."""

DRAWS: Final = 5
"""Strokes over the known surface [count]."""

LAGS_S: Final = np.linspace(0.0, 0.5, 51)
"""Over which the known gain and the found one are compared [s]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    counts = COUNTS[::2] if quick else COUNTS
    labels = {n: f"{n} process{'es' * (n > 1)}" for n in counts}
    made = [Setting(f"by {over}", labels[n], {"count": n, "over": over}) for over in OVER for n in counts]
    return [Setting("steady", "no process", {"count": 0, "over": ""}), *made]


def error(count: int, over: str) -> dict[str, float]:
    """How lively strokes are that a half of a recording gives, against the other half; and a gain that is known."""
    found = {"planted": _planted(count, over)}
    if not no_recordings():
        rows = [_held_out(name, which, count, over) for name in STROKES for which in (0, 1)]
        found["modulation"], found["levels"] = np.mean(rows, axis=0).tolist()
    return found


def halves(name: str) -> list[Streams]:
    """The two halves of a recording."""
    whole = recorded(name)
    middle = len(whole.force_N) // 2
    return [part_of(whole, half) for half in (slice(middle), slice(middle, None))]


@cache
def _steady(name: str, which: int) -> Texture:
    """The texture of a half, without life."""
    return fit_texture(cut(halves(name)[which]), RATE_HZ, ORDER, 1)


def life_of(texture: Texture, stretch: Streams, count: int, over: str) -> Life | None:
    """The slow gain that is found in a stretch of sliding, joined to so many processes; None of none."""
    found = fit_life(texture, [stretch]).life if count else None
    return None if found is None else joined(found, count, over, float(stretch.speed_m_s.mean()))


def joined(life: Life, count: int, over: str, speed_m_s: float) -> Life:
    """A gain of at most so many processes, neighbours in time made one, that forget by time or by the distance that is
    travelled at a speed. The spread and the area beneath the covariance stay."""
    power, rate_1_s = life.spread**2, life.decay_1_s + life.decay_1_m * speed_m_s
    groups = np.array_split(np.argsort(rate_1_s), min(count, len(power)))
    total = np.array([power[group].sum() for group in groups])
    rates = total / np.array([np.sum(power[group] / rate_1_s[group]) for group in groups])
    none = np.zeros(len(groups))
    return Life(np.sqrt(total), *((rates, none) if over == "time" else (none, rates / speed_m_s)))


def _held_out(name: str, which: int, count: int, over: str) -> Array:
    """How far strokes of a half's texture are from the other half in modulation and spread of levels (2,), |ln ratio|:
    mean over `SEEDS`."""
    texture, parts = _steady(name, which), halves(name)
    swatch = Swatch("asked", texture=replace(texture, life=life_of(texture, parts[which], count, over)))
    other = parts[1 - which]
    made = [synthesize(swatch, other.force_N, other.speed_m_s, seed=seed) for seed in range(SEEDS)]
    true = liveliness(other.acceleration_m_s2, RATE_HZ)
    return np.asarray(np.mean([np.abs(np.log(np.array(liveliness(one, RATE_HZ)) / true)) for one in made], axis=0)[:2])


def _planted(count: int, over: str) -> float:
    """Largest difference of the covariance of the gain's logarithm from the true one, over the true variance [1]."""
    true, off = np.sum([spread**2 * np.exp(-LAGS_S / forgets) for spread, forgets in PLANTED], axis=0), []
    for seed in range(DRAWS):
        texture, stroke = known_stroke(seed)
        found = covariance(life_of(texture, stroke, count, over), float(stroke.speed_m_s[0]))
        off.append(float(np.abs(found - true).max() / true[0]))
    return float(np.mean(off))


def covariance(life: Life | None, speed_m_s: float) -> Array:
    """Of the logarithm of a gain, over `LAGS_S` at a steady speed."""
    if life is None:
        return np.zeros(len(LAGS_S))
    forgets_1_s = life.decay_1_s + life.decay_1_m * speed_m_s
    return np.asarray(np.sum(life.spread[:, None] ** 2 * np.exp(-np.outer(forgets_1_s, LAGS_S)), axis=0))


def known_stroke(seed: int) -> tuple[Texture, Streams]:
    """A steady stroke over the known surface: noise of a texture of ours, times a gain that SciPy's filters make."""
    rng, count, warm = np.random.default_rng(seed), round(PLANTED_S * RATE_HZ), round(2.0 * RATE_HZ)
    logarithm = np.zeros(count)
    for spread, forgets_s in PLANTED:
        kept = np.exp(-1.0 / (forgets_s * RATE_HZ))
        noise = np.sqrt(1.0 - kept**2) * spread * rng.standard_normal(count + warm)
        logarithm += lfilter([1.0], [1.0, -kept], noise)[warm:]
    a = np.array([1.0, -1.6, 0.8])
    heard = lfilter([1.0], a, rng.standard_normal(count + warm))[warm:]
    gain = np.exp(logarithm - sum(spread**2 for spread, _ in PLANTED))
    texture = Texture.from_models(RATE_HZ, [1.0], [0.1], a=a[None], variance_m2_s4=[1.0])
    force, speed = np.ones(count), np.full(count, 0.1)
    return texture, Streams(RATE_HZ, gain * heard, force, speed, None)


def time(count: int, over: str) -> tuple[float, float]:
    texture: Any = planted_texture("lsf", 2)
    if count:
        many = Life(np.full(count, 0.2), np.geomspace(4.0, 60.0, count), np.zeros(count))
        texture = replace(texture, life=joined(many, count, over, 0.1))
    return texture_us(texture)


def advice(points: Sequence[Point]) -> str:
    """What a slow gain buys, what it costs, and whether time or distance is nearer."""
    steady = next(p for p in points if p.method == "steady")
    alive = [p for p in points if p.method != "steady"]
    key = "planted" if no_recordings() else "modulation"
    least = best(alive, key)
    dear = float(np.median([p.median_us for p in alive])) - steady.median_us
    real = {over: best([p for p in measured(alive, key) if p.method == f"by {over}"], key) for over in OVER}
    apart = abs(real["time"].errors[key] - real["distance"].errors[key])
    nearer = "Time and distance are alike" if apart < 0.05 else f"{least.method.capitalize()} is nearer"
    told = ""
    if not no_recordings():
        told = (
            f" on recordings the modulation of the envelope is off by {least.errors[key]:.2g} in its logarithm where a "
            f"steady texture is by {steady.errors[key]:.2g}, levels by {least.errors['levels']:.2g} and "
            f"{steady.errors['levels']:.2g};"
        )
    return (
        f"Let a texture live, by {least.label}:{told} it costs {max(dear, 0.0):.2g} µs a block of "
        f"{steady.median_us:.2g}. {nearer} on strokes of one speed: `fit` takes time unless the recording says "
        "distance. Not where a level is to be held, as in a measurement: `texture_life` of 0 is steady."
    )


QUESTION: Final = Question(
    name="life",
    title="What makes a texture live?",
    measures=(
        *(
            ()
            if no_recordings()
            else (
                Measure("modulation", "modulation at 2 to 10 Hz, held out", "|ln ratio|", log=False),
                Measure("levels", "spread of levels of 50 ms, held out", "|ln ratio|", log=False),
            )
        ),
        Measure("planted", "covariance of a known gain", "of its variance", log=False),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"Half of wood, paper and leather is fitted at order {ORDER}, and {SEEDS} strokes along the other half's "
        "forces and speeds are held against that half, both ways. The known gain has "
        f"{len(PLANTED)} processes that forget in other times, recorded for {PLANTED_S:g} s, {DRAWS} times; a steady "
        "texture is 1 off."
    ),
    per="block",
)
