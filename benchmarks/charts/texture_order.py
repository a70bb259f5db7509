"""How many coefficients a texture's filter needs."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.signal import freqz, iirpeak, lfilter

from hapscene.capture.fit.distance import spectrum
from hapscene.constants import ORDER_MAX
from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.dsp.linear_prediction import autocorrelation, smoothed, solve, tapered
from hapscene.dsp.warped_prediction import lag_count, warp_at, warped
from hapscene.surface.texture import Texture

from .measuring import (
    ISRAR,
    RATE_HZ,
    STROKES,
    Array,
    apart_jnd,
    bands_of,
    best,
    enough,
    model_bands,
    no_recordings,
    recorded,
    texture_us,
)
from .question import Measure, Point, Question, Setting

ORDERS: Final = (2, 4, 8, 12, 20, 30, 40, 60, 80, 120, 160)
WARPED_ORDERS: Final = (4, 8, 12, 16, 20, 28, 40)

METHODS: Final = {False: "AR model", True: "warped AR model"}
"""By whether an allpass stands for each delay."""

LINES: Final = ((45.0, 20.0), (90.0, 6.0), (160.0, 40.0), (260.0, 12.0), (400.0, 60.0), (620.0, 20.0), (900.0, 40.0))
FLOOR_M_S2, SHARPNESS = 5.0, 5.0
"""The surface that is made: its lines [Hz, m/s²], white noise below them, and centre over width of the lines [1]."""

AUDIO_RATE_HZ: Final = 48_000.0


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    orders, warped = ((2, 8, 24, 80), (8, 28)) if quick else (ORDERS, WARPED_ORDERS)
    plain = [Setting(METHODS[False], f"order {p}", {"order": p}) for p in orders]
    return plain + [Setting(METHODS[True], f"order {p}", {"order": p, "warped": True}) for p in warped]


def error(order: int, warped: bool = False) -> dict[str, float]:
    """A half of each recording is fitted and held against the other half, both ways; a made one against its truth."""
    warp = warp_at(RATE_HZ) if warped else 0.0
    found = {"planted": _planted(order, warp)}
    if not no_recordings():
        apart = []
        for name in STROKES:
            signal = recorded(name).acceleration_m_s2
            halves = np.array_split(signal, 2)
            for own, other in (halves, halves[::-1]):
                apart.append(_apart(own, order, warp, bands_of(*spectrum(other, RATE_HZ))))
        found["recorded"] = float(np.sqrt(np.mean(np.square(apart))))
    return found


def _planted(order: int, warp: float = 0.0) -> float:
    """A second of a known surface is fitted; the truth is its spectrum."""
    heard, frequency, density = planted_surface(10_000)
    return _apart(heard, order, warp, bands_of(frequency, density))


def planted_surface(count: int, seed: int = 1) -> tuple[Array, Array, Array]:
    """Samples (n,) [m/s²] of a surface, and its spectrum: frequencies (k,) [Hz], power density (k,) [(m/s²)²/Hz].

    Noise through `LINES`, filters of SciPy's, each noise its own, over a white floor: nothing that a few poles make.
    """
    rng, warm = np.random.default_rng(seed), 5000
    frequency = np.geomspace(20.0, 1000.0, 2000)
    heard = FLOOR_M_S2 * rng.standard_normal(count + warm)
    density = np.full(len(frequency), FLOOR_M_S2**2)
    for at_Hz, loud_m_s2 in LINES:
        b, a = iirpeak(at_Hz, SHARPNESS, RATE_HZ)
        heard += lfilter(loud_m_s2 * b, a, rng.standard_normal(count + warm))
        density += np.abs(freqz(loud_m_s2 * b, a, worN=frequency, fs=RATE_HZ)[1]) ** 2
    return heard[warm:], frequency, 2.0 * density / RATE_HZ


def _apart(signal: Array, order: int, warp: float, true_m_s2: Array) -> float:
    """How far a fit of that order is from the true levels of the bands, as loud as these in all [JND]."""
    r = smoothed(autocorrelation(tapered(signal, RATE_HZ), lag_count(order, warp)), RATE_HZ)
    bands = model_bands(solve(warped(r, order, warp)), 1.0, RATE_HZ, warp)
    return float(apart_jnd(bands * np.sqrt(np.sum(true_m_s2**2) / np.sum(bands**2)), true_m_s2))


def time(order: int, warped: bool = False) -> tuple[float, float]:
    a = ar_from_reflection(np.random.default_rng(order).uniform(-0.3, 0.3, order))
    warp = warp_at(RATE_HZ) if warped else 0.0
    variance = 1.0 / float(power_gain(a, warp))
    return texture_us(Texture.from_models(RATE_HZ, [2.0], [0.2], a=a[None], variance_m2_s4=[variance], warp=warp))


def advice(points: Sequence[Point]) -> str:
    """The smallest order within a just-noticeable difference of the best, and which axis needs fewer."""
    key = "planted" if no_recordings() else "recorded"
    least = best(points, key)
    chosen = enough(points, key, least.errors[key] + 1.0)
    plain, warped = (
        enough([p for p in points if p.method == one], key, least.errors[key] + 0.1) for one in METHODS.values()
    )
    most = round(ORDER_MAX * RATE_HZ / AUDIO_RATE_HZ)
    return (
        f"Choose the {chosen.method} of {chosen.label}: at {chosen.errors[key]:.2g} JND it is the quickest within one "
        f"of the best, {least.label} ({least.errors[key]:.2g} JND), and takes {chosen.median_us:.2g} µs a block where "
        f"that takes {least.median_us:.2g}. To come within a tenth of the best, or as near as may be, it takes "
        f"{_told(plain, key)}, or {_told(warped, key)}, which sees low frequencies finer. Not so small where a surface "
        f"rings at sharp lines, which a low order blurs; and not above {most} for what is played at "
        f"{AUDIO_RATE_HZ / 1e3:g} kHz: resampled it would pass the {ORDER_MAX} that a tick has room for."
    )


def _told(point: Point, key: str) -> str:
    return f"the {point.method} of {point.label} ({point.errors[key]:.2g} JND, {point.median_us:.2g} µs)"


QUESTION: Final = Question(
    name="texture-order",
    title="How many coefficients does a texture's filter need?",
    measures=(
        *(() if no_recordings() else (Measure("recorded", "real recordings, held out", "JND", 1.0, ISRAR),)),
        Measure("planted", "a known surface", "JND", 1.0, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "Levels in twelve bands from 20 to 1000 Hz: half of each recording of wood, paper and leather against a "
        f"model of the other half, brought to one loudness; and a known surface of {len(LINES)} lines against a fit "
        "to one second. A warped model has an allpass for each delay (Strube 1980)."
    ),
    per="block",
)
