"""How loud a texture is beyond the forces and speeds that were recorded: clamped, or by a law."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hapscene.capture.fit.windows import EXPONENT_SPREADS, EXPONENTS, Pieces, cut, fit_level
from hapscene.constants import LEVEL_BOUND_DB
from hapscene.surface.texture import Texture

from .measuring import RATE_HZ, STROKES, Array, best, measured, no_recordings, recorded, texture_us
from .question import Measure, Point, Question, Setting

LAWS: Final[dict[str, Any]] = {
    "clamped": None,
    "exponents 1 and 1": ((1.0, 1.0), (0.5, 0.5)),
    "exponents learnt": (EXPONENTS, EXPONENT_SPREADS),
    "no expectation": ((0.0, 0.0), (100.0, 100.0)),
}
"""Mean and standard deviation of the exponents of force and of speed that are expected; and no law."""

KNOWN: Final = ((0.2, 1.2), (0.2, 2.8), (0.5, 2.0), (1.0, 1.2), (1.0, 2.8))
"""Exponents of force and of speed of the known surfaces: a deviation to either side of what surfaces have."""

PIECES, SCATTER_DB = 30, 2.0
"""Pieces that a known surface is recorded in [count], and how much their levels scatter [dB]."""

NARROW, WIDE = 0.2, 2.0
"""By how much its force and speed change while it is recorded [1], and how many times more they are when asked [1]."""

DRAWS: Final = 20
"""Recordings of each known surface [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    return [Setting("clamped" if law == "clamped" else "goes on", law, {"law": law}) for law in LAWS]


def error(law: str) -> dict[str, float]:
    """Levels of what is faster or harder than all that a law was fitted to [dB rms], of recordings and as planted."""
    found = {"planted": _planted(law)}
    if not no_recordings():
        found["recorded"] = float(np.sqrt(np.mean([_narrow_to_wide(law, name) ** 2 for name in STROKES])))
    return found


def level_dB(law: str, known: Pieces, force_N: Array, speed_m_s: Array) -> Array:
    """Levels (n,) [dB] that a law gives beyond what it was fitted to."""
    inner = np.minimum(force_N, known.force_N.max()), np.minimum(speed_m_s, known.speed_m_s.max())
    words = {} if LAWS[law] is None else dict(zip(("expected", "spreads"), LAWS[law], strict=True))
    fitted = fit_level(known, **words)
    edge = 10.0 * np.log10(fitted(*inner))
    beyond = 0.0 if LAWS[law] is None else 10.0 * np.log10(fitted(force_N, speed_m_s)) - edge
    return np.asarray(edge + np.clip(beyond, -LEVEL_BOUND_DB, LEVEL_BOUND_DB))


def _planted(law: str, seed: int = 0) -> float:
    rng, off = np.random.default_rng(seed), []
    for exponents in KNOWN:
        for _ in range(DRAWS):
            force, speed = rng.uniform(1.0 - NARROW, 1.0 + NARROW, (2, PIECES))
            loud = force ** exponents[0] * speed ** exponents[1]
            loud = loud * 10.0 ** (0.1 * SCATTER_DB * rng.standard_normal(PIECES))
            known = Pieces(np.sqrt(loud)[:, None] * np.ones(2), force, speed, np.arange(PIECES))
            far = rng.uniform(1.0 - NARROW, 1.0 + NARROW, (2, PIECES))
            far[np.arange(PIECES) % 2, np.arange(PIECES)] = rng.uniform(1.0 + NARROW, WIDE, PIECES)
            true = 10.0 * (exponents[0] * np.log10(far[0]) + exponents[1] * np.log10(far[1]))
            off.append(level_dB(law, known, *far) - true)
    return float(np.sqrt(np.mean(np.square(off))))


def _narrow_to_wide(law: str, name: str) -> float:
    """The slower half of a recording's pieces is asked for the faster one, the softer half for the harder one."""
    pieces, off = cut(recorded(name)), []
    for along in (pieces.force_N, pieces.speed_m_s):
        far = along > np.median(along)
        known, asked = pieces[~far], pieces[far]
        true = 10.0 * np.log10(np.mean(asked.acceleration_m_s2**2, axis=1))
        off.append(level_dB(law, known, asked.force_N, asked.speed_m_s) - true)
    return float(np.sqrt(np.mean(np.square(np.concatenate(off)))))


def time(law: str) -> tuple[float, float]:
    """Of a block of a texture that was recorded slower and softer than it is felt."""
    exponents = (0.0, 0.0) if law == "clamped" else (0.5, 2.0)
    a = [[1.0, *np.zeros(20)]]
    return texture_us(Texture.from_models(RATE_HZ, [0.3], [0.02], a=a, variance_m2_s4=[1.0], exponents=exponents))


def advice(points: Sequence[Point]) -> str:
    """What a law buys beyond the recorded, and what it costs."""
    by_label, least = {p.label: p for p in points}, best(points, "planted")
    clamped, old, learnt = (by_label[one].errors["planted"] for one in list(LAWS)[:3])
    real = measured(points, "recorded")
    told = [f"{p.label} {p.errors['recorded']:.2f}" for p in real]
    said = f" On recordings, whose halves differ little, it is off by [dB]: {', '.join(told)}." if real else ""
    return (
        f"Let the level go on, with {least.label}: up to {WIDE:g} times what was recorded it is {learnt:.2g} dB off, "
        f"{clamped:.2g} where it is clamped, {old:.2g} with exponents of 1 and 1.{said} It goes on by "
        f"{LEVEL_BOUND_DB:g} dB at most, as far as it was tested. Not where a tool may meet forces or speeds that a "
        "device was not made for: exponents of 0 clamp it there."
    )


QUESTION: Final = Question(
    name="level-law",
    title="How loud is a texture beyond what was recorded?",
    measures=(
        *(() if no_recordings() else (Measure("recorded", "level of recordings, narrow → wide", "dB rms", log=False),)),
        Measure("planted", "level of known surfaces, narrow → wide", "dB rms", log=False),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "Levels of a tenth of a second. Wood, paper and leather: the slower half of a recording is asked for the "
        f"faster one, the softer one for the harder. Known surfaces: power laws of {len(KNOWN)} pairs of exponents, "
        f"recorded within {100 * NARROW:g} % with a scatter of {SCATTER_DB:g} dB, asked at up to {WIDE:g} times the "
        "force or speed. Timed where all of the stroke is beyond."
    ),
    per="block",
)
