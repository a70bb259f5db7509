"""In which coordinates a texture's models are best blended: at forces and speeds that were not tested."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hapscene.capture.fit.distance import spectrum
from hapscene.capture.fit.texture import fit_texture
from hapscene.capture.fit.windows import Pieces, cut
from hapscene.dsp.ar_filter import power_gain, power_response
from hapscene.dsp.linear_prediction import solve
from hapscene.dsp.warped_prediction import warp_at, warped
from hapscene.surface.texture import Texture

from .measuring import (
    ISRAR,
    RATE_HZ,
    STROKES,
    Array,
    apart_jnd,
    bands_of,
    best,
    measured,
    model_bands,
    no_recordings,
    recorded,
    texture_bands,
    texture_us,
)
from .question import Measure, Point, Question, Setting

DOMAINS: Final = {
    "lsf": "LSF",
    "warped": "warped LSF",
    "reflection": "reflection",
    "direct": "direct",
    "hatt": "LSF and variance",
    "nearest": "nearest model",
}
"""By `hapscene.surface.texture.INTERPOLATIONS`; LSF of warped models; and the nearest model, which blends nothing."""

ORDER, MODELS, PARTS = 20, 3, 4
"""Of the texture that is fitted, the models that are left in it, and the parts of a recording that are left out in
turn, those between others in speed or in force."""

GRIDS: Final = (2, 3, 5)
"""Models along force and along speed of the known surface [count]."""

FORCE_N, SPEED_M_S = (0.3, 2.0), (0.04, 0.25)
"""What the known surface is tested between."""

PLACES: Final = 40
"""Places between the models of the known surface that are asked for [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    grids = GRIDS[:2] if quick else GRIDS
    made = [Setting(said, f"{n} × {n} models", {"domain": d, "grid": n}) for d, said in DOMAINS.items() for n in grids]
    real = [Setting(said, "recordings", {"domain": d, "grid": 0}) for d, said in DOMAINS.items()]
    return made if no_recordings() else made + real


def error(domain: str, grid: int) -> dict[str, float]:
    """A known surface, tested on a grid and asked for between; without one, recordings, asked for what was left out."""
    if grid:
        return {"planted": _planted(domain, grid)}
    return {"recorded": float(np.sqrt(np.mean([_left_out(domain, name) ** 2 for name in STROKES])))}


def surface_at(force_N: float, speed_m_s: float) -> tuple[Array, float]:
    """The known surface: a filter (p+1,) whose lines rise with the speed and widen with the force, and its variance.

    Three lines rise, as ridges that are crossed faster; two stay, as those of a tool. Its power grows with both.
    """
    frequency = np.linspace(0.0, 0.5 * RATE_HZ, 4097)
    lines = np.array([*(np.array([80.0, 170.0, 360.0]) * (speed_m_s / 0.1) ** 0.7), 450.0, 800.0])
    width = 0.2 * lines[:, None] * force_N**0.3
    density = 0.01 + np.sum(1.0 / (1.0 + ((frequency - lines[:, None]) / width) ** 2), axis=0)
    a = solve(np.fft.irfft(density)[: ORDER + 1])
    return a, 25.0 * force_N * (speed_m_s / 0.1) / float(power_gain(a))


def planted_texture(domain: str, grid: int) -> Texture:
    """The known surface as a texture of grid × grid models."""
    warp = warp_of(domain)
    force, speed = (g.ravel() for g in np.meshgrid(np.geomspace(*FORCE_N, grid), np.geomspace(*SPEED_M_S, grid)))
    models = [_warped(*surface_at(f, v), warp) for f, v in zip(force, speed, strict=True)]
    a, variance = zip(*models, strict=True)
    return Texture.from_models(
        RATE_HZ, force, speed, a=np.stack(a), variance_m2_s4=variance, interpolation=_blended(domain), warp=warp
    )


def _warped(a: Array, variance_m2_s4: float, warp: float) -> tuple[Array, float]:
    """The warped model of as many coefficients that is nearest to an AR model's spectrum, and its variance."""
    if warp == 0.0:
        return a, variance_m2_s4
    found = solve(warped(np.fft.irfft(power_response(a, np.linspace(0.0, np.pi, 4097))), len(a) - 1, warp))
    return found, variance_m2_s4 * float(power_gain(a) / power_gain(found, warp))


def warp_of(domain: str) -> float:
    """The warp of the models that are blended in a domain."""
    return warp_at(RATE_HZ) if domain == "warped" else 0.0


def _blended(domain: str) -> str:
    return "lsf" if domain in ("nearest", "warped") else domain


def _planted(domain: str, grid: int, seed: int = 0) -> float:
    rng = np.random.default_rng(seed)
    texture = planted_texture(domain, grid)
    apart = []
    low, high = np.log((FORCE_N, SPEED_M_S)).T
    for force, speed in np.exp(rng.uniform(low, high, (PLACES, 2))).tolist():
        apart.append(apart_jnd(asked(texture, domain, force, speed), model_bands(*surface_at(force, speed), RATE_HZ)))
    return float(np.sqrt(np.mean(np.square(apart))))


def asked(texture: Texture, domain: str, force_N: float, speed_m_s: float) -> Array:
    """Levels of the bands [m/s²] that a texture has at a force and a speed."""
    if domain == "nearest":
        away = (texture.force_N - force_N) ** 2 / texture.force_max_N**2
        away += (texture.speed_m_s - speed_m_s) ** 2 / texture.speed_max_m_s**2
        nearest = int(np.argmin(np.where(texture.variance_m2_s4 > 0.0, away, np.inf)))
        force_N, speed_m_s = float(texture.force_N[nearest]), float(texture.speed_m_s[nearest])
    return np.asarray(texture_bands(texture, [force_N], [speed_m_s])[0])


def _left_out(domain: str, name: str) -> float:
    """Each part of a recording between others in force or speed, against a texture of the others [JND]."""
    pieces = cut(recorded(name))
    apart = []
    for order in (np.argsort(pieces.force_N), np.argsort(pieces.speed_m_s)):
        for part in np.array_split(order, PARTS)[1:-1]:
            left = np.ones(len(pieces), bool)
            left[part] = False
            texture = fit_texture(
                pieces[left], RATE_HZ, ORDER, MODELS, interpolation=_blended(domain), warp=warp_of(domain)
            )
            out: Pieces = pieces[~left]
            found = [asked(texture, domain, f, v) for f, v in zip(out.force_N, out.speed_m_s, strict=True)]
            true = [bands_of(*spectrum(signal, RATE_HZ)) for signal in out.acceleration_m_s2]
            apart.append(apart_jnd(*(np.sqrt(np.mean(np.square(each), axis=0)) for each in (found, true))))
    return float(np.sqrt(np.mean(np.square(apart))))


def time(domain: str, grid: int) -> tuple[float, float]:
    return texture_us(planted_texture(domain, grid or MODELS))


def advice(points: Sequence[Point]) -> str:
    """How far the domains are apart, and what a tick pays for them."""
    real, told = measured(points, "recorded"), ""
    if real:
        warped = min(p.errors["recorded"] for p in real if p.method == DOMAINS["warped"])
        plain = [p.errors["recorded"] for p in real if p.method != DOMAINS["warped"]]
        said = "cannot be told apart" if max(plain) - min(plain) < 1.0 else "differ"
        told = (
            f" On recordings, where they were not tested, all but the warped {said}: {min(plain):.3g} to "
            f"{max(plain):.3g} JND, and warped models miss {warped:.3g}."
        )
    least = best(points, "planted")
    blended = [p for p in measured(points, "planted") if p.label == least.label and p.method != DOMAINS["nearest"]]
    most = max(p.errors["planted"] for p in blended)
    dear, cheap = (
        float(np.median([p.median_us for p in points if (p.method == DOMAINS["warped"]) == warped]))
        for warped in (True, False)
    )
    return (
        f"Blend in any domain that is always stable: with {least.label} they miss {least.errors['planted']:.2g} to "
        f"{most:.2g} JND of a surface whose lines move with the speed.{told} Not the nearest model where a hand "
        "is to feel no steps, nor direct coefficients between unlike models, whose blends are unstable. A tick does "
        f"not pay for the blend, which is made when a swatch is loaded: a block of {ORDER} coefficients takes "
        f"{cheap:.2g} µs in all of them, and {dear:.2g} warped."
    )


QUESTION: Final = Question(
    name="texture-domain",
    title="In which domain are a texture's models blended?",
    measures=(
        *(() if no_recordings() else (Measure("recorded", "real recordings, left out", "JND", 1.0, ISRAR),)),
        Measure("planted", "a known surface, between its models", "JND", 1.0, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"Levels in twelve bands from 20 to 1000 Hz at forces and speeds that no model was fitted at: wood, paper and "
        f"leather without a quarter of their pieces, fitted at order {ORDER} with up to {MODELS} models; and a known "
        f"surface of five lines, three of which rise with the speed, at {PLACES} places between its models."
    ),
    per="block",
)
