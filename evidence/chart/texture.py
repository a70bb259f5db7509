"""The question of texture order and domain: how many coefficients, and in which form models are interpolated."""

from functools import cache
from typing import Final

import numpy as np

from hapscene.capture.fit.distance import spectrum
from hapscene.capture.fit.texture import fit_texture
from hapscene.capture.fit.windows import AnalysisWindows, cut
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import solve
from hapscene.dsp.warped_prediction import lag_count, warp_at, warped
from hapscene.fidelity.tune import painted
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene.touch import open_scene

from .measuring import (
    ISRAR,
    RATE_HZ,
    RECORDINGS,
    STROKES,
    Array,
    apart_jnd,
    bands_of,
    recorded,
    texture_bands,
    texture_us,
)
from .question import Measure, Question, Setting

DOMAINS: Final = {
    "lsf": "LSF",
    "warped": "warped LSF",
    "reflection": "reflection",
    "direct": "direct",
    "hatt": "LSF and variance",
    "nearest": "nearest model",
}
"""`hapscene.surface.texture.INTERPOLATIONS`; LSF of warped models; the nearest model without interpolation."""

ORDERS: Final[dict[str, tuple[int, ...]]] = {
    "lsf": (120, 80, 40, 20, 12, 8, 4, 2),
    "warped": (40, 28, 20, 12, 8, 4),
}
"""Orders that are tried in these domains. The default is the paper's 120; the other domains have `ORDER`."""

ORDER_LEVER: Final = "Texture order (paper: 120)"

ORDER, MODELS, PARTS = 20, 3, 4
"""Order of the other domains; models of a fitted texture; parts of a recording, of which inner ones are left out."""

FORCE_N, SPEED_M_S = (0.3, 2.0), (0.04, 0.25)
"""Range of force [N] and speed [m/s] of the simulated surface's models."""

PLACES: Final = 40
"""Random conditions at which the simulated surface is tested [count]."""

FREQUENCY_HZ: Final = np.linspace(0.0, 0.5 * RATE_HZ, 4097)


def settings(scene_file: str | None) -> list[Setting]:
    if scene_file is not None:
        return [
            Setting(
                *(f"Texture order of {swatch.name}", "", f"order {order}"),
                {"domain": "", "order": order, "scene_file": scene_file, "swatch": swatch.name},
                default=order == swatch.texture.order,
            )
            for swatch in painted(open_scene(scene_file))
            if swatch.texture is not None
            for order in sorted({swatch.texture.order, *ORDERS["lsf"]}, reverse=True)
        ]
    found = []
    for domain, orders in ORDERS.items():
        for order in orders:
            default = domain == "lsf" and order == orders[0]
            arguments = {"domain": domain, "order": order}
            found.append(Setting(ORDER_LEVER, DOMAINS[domain], f"order {order}", arguments, default=default))
    for domain, name in DOMAINS.items():
        found.append(Setting("Texture domain", name, "", {"domain": domain, "order": ORDER}, default=domain == "lsf"))
    return found


def program(domain: str, order: int, scene_file: str | None = None, swatch: str = "") -> bytes:
    """Return the coefficients of the texture."""
    if scene_file is None:
        return f"{domain}, {order}".encode()
    texture = scene_texture(scene_file, swatch).truncated(order)
    return texture.lsf_rad.tobytes() + texture.variance_m2_s4.tobytes()


@cache
def scene_texture(scene_file: str, swatch: str) -> Texture:
    """Return the texture of a swatch of a scene."""
    found = next(each.texture for each in open_scene(scene_file).swatches if each.name == swatch)
    assert found is not None
    return found


def error(domain: str, order: int, scene_file: str | None = None, swatch: str = "") -> dict[str, float]:
    """Return the errors on a simulated surface between its models, and on left-out parts of recordings [JND].

    For a swatch of a scene, return the error against its own order, over the forces and speeds of its models.
    """
    if scene_file is not None:
        texture, share = scene_texture(scene_file, swatch), np.linspace(0.2, 1.0, 5)
        places = [g.ravel() for g in np.meshgrid(share * texture.force_max_N, share * texture.speed_max_m_s)]
        apart = apart_jnd(texture_bands(texture.truncated(order), *places), texture_bands(texture, *places))
        return {"own": float(np.percentile(apart, 95))}
    found = {"planted": known_surface_error(domain, order)}
    if RECORDINGS.is_dir():
        found["recorded"] = float(np.sqrt(np.mean([left_out(domain, order, name) ** 2 for name in STROKES])))
    return found


def surface_density(force_N: float, speed_m_s: float) -> Array:
    """Return the power density (n,) [(m/s²)²/Hz] of the simulated surface at `FREQUENCY_HZ`.

    Three spectral lines rise with the speed, like those of ridges; two are fixed, like those of a tool. Lines widen
    with the force, and the power grows with both.
    """
    lines = np.array([*(np.array([80.0, 170.0, 360.0]) * (speed_m_s / 0.1) ** 0.7), 450.0, 800.0])
    width = 0.2 * lines[:, None] * force_N**0.3
    density = 0.01 + np.sum(1.0 / (1.0 + ((FREQUENCY_HZ - lines[:, None]) / width) ** 2), axis=0)
    power_m2_s4 = 25.0 * force_N * (speed_m_s / 0.1)
    return np.asarray(power_m2_s4 * density / np.fft.irfft(density)[0] / (0.5 * RATE_HZ))


def known_texture(domain: str, grid: int, order: int = ORDER) -> Texture:
    """Return the simulated surface as a texture of grid × grid models."""
    warp = warp_of(domain)
    force, speed = (g.ravel() for g in np.meshgrid(np.geomspace(*FORCE_N, grid), np.geomspace(*SPEED_M_S, grid)))
    models = []
    for f, v in zip(force, speed, strict=True):
        r = 0.5 * RATE_HZ * np.fft.irfft(surface_density(f, v))
        a = solve(warped(r[: lag_count(order, warp) + 1], order, warp))
        models.append((a, r[0] / float(power_gain(a, warp))))
    filters, variance = zip(*models, strict=True)
    return Texture.from_models(
        RATE_HZ,
        force,
        speed,
        a=np.stack(filters),
        variance_m2_s4=variance,
        interpolation=_interpolation(domain),
        warp=warp,
    )


def warp_of(domain: str) -> float:
    """Return the frequency warping of the models of a domain."""
    return warp_at(RATE_HZ) if domain == "warped" else 0.0


def _interpolation(domain: str) -> str:
    return "lsf" if domain in ("nearest", "warped") else domain


def known_surface_error(domain: str, order: int, grid: int = MODELS, seed: int = 0) -> float:
    """Return the rms error of the simulated surface at conditions between its models [JND]."""
    texture, (low, high) = known_texture(domain, grid, order), np.log((FORCE_N, SPEED_M_S)).T
    apart = []
    for force, speed in np.exp(np.random.default_rng(seed).uniform(low, high, (PLACES, 2))).tolist():
        true = bands_of(FREQUENCY_HZ, surface_density(force, speed))
        apart.append(apart_jnd(levels_of(texture, domain, force, speed), true))
    return float(np.sqrt(np.mean(np.square(apart))))


def levels_of(texture: Texture, domain: str, force_N: float, speed_m_s: float) -> Array:
    """Return the levels of a texture in the perceptible bands [m/s²] at a force and a speed."""
    if domain == "nearest":
        distance2 = (texture.force_N - force_N) ** 2 / texture.force_max_N**2
        distance2 += (texture.speed_m_s - speed_m_s) ** 2 / texture.speed_max_m_s**2
        nearest = int(np.argmin(np.where(texture.variance_m2_s4 > 0.0, distance2, np.inf)))
        force_N, speed_m_s = float(texture.force_N[nearest]), float(texture.speed_m_s[nearest])
    return np.asarray(texture_bands(texture, [force_N], [speed_m_s])[0])


def left_out(domain: str, order: int, name: str) -> float:
    """Return the error of a texture on parts of a recording that were left out of its fit [JND].

    The parts lie between the others in force or speed.
    """
    pieces = cut(recorded(name))
    apart = []
    for by in (np.argsort(pieces.force_N), np.argsort(pieces.speed_m_s)):
        for part in np.array_split(by, PARTS)[1:-1]:
            left = np.ones(len(pieces), bool)
            left[part] = False
            texture = fit_texture(
                pieces[left], RATE_HZ, order, MODELS, interpolation=_interpolation(domain), warp=warp_of(domain)
            )
            out: AnalysisWindows = pieces[~left]
            found = [levels_of(texture, domain, f, v) for f, v in zip(out.force_N, out.speed_m_s, strict=True)]
            true = [bands_of(*spectrum(signal, RATE_HZ)) for signal in out.acceleration_m_s2]
            apart.append(apart_jnd(*(np.sqrt(np.mean(np.square(each), axis=0)) for each in (found, true))))
    return float(np.sqrt(np.mean(np.square(apart))))


def time(domain: str, order: int, scene_file: str | None = None, swatch: str = "") -> tuple[float, float]:
    own = None if scene_file is None else scene_texture(scene_file, swatch).truncated(order)
    texture = own or known_texture(domain, MODELS, order)
    return texture_us(Swatch("timed", texture=texture))


QUESTION: Final = Question(
    name="texture",
    title="Order and interpolation domain of a texture",
    measures=(
        Measure("recorded", "recordings, more than the best", "JND", 1.0, ISRAR, excess=True),
        Measure("planted", "simulated surface", "JND", 1.0, ISRAR),
        Measure("own", "against the swatch's own order", "JND", 1.0, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    conditions=(
        "Error: levels in twelve bands from 20 to 1000 Hz at conditions that no model was fitted at. Recordings: wood, "
        f"paper and leather without a quarter of their windows, fitted with up to {MODELS} models. Simulated surface: "
        f"five spectral lines, three of which rise with the speed, at {PLACES} conditions between {MODELS} × {MODELS} "
        "models. A warped model has an allpass instead of each delay (Strube 1980). The domains are compared at order "
        f"{ORDER}. `hapscene fit` chooses the order of each swatch by held-out windows."
    ),
    program=program,
)
