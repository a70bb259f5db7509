"""How many coefficients a texture's filter needs."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hapscene.constants import ORDER_MAX

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

LINES: Final = ((45.0, 20.0), (90.0, 6.0), (160.0, 40.0), (260.0, 12.0), (400.0, 60.0), (620.0, 20.0), (900.0, 40.0))
FLOOR_M_S2, SHARPNESS = 5.0, 5.0
"""The surface that is made: its lines [Hz, m/s²], white noise below them, and centre over width of the lines [1]."""

AUDIO_RATE_HZ: Final = 48_000.0


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    orders = (2, 8, 24, 80) if quick else ORDERS
    return [Setting("AR model", f"order {p}", {"order": p}) for p in orders]


def error(order: int) -> dict[str, float]:
    """A half of each recording is fitted and held against the other half, both ways; a made one against its truth."""
    from hapscene.capture.metric import spectrum

    found = {"planted": _planted(order)}
    if not no_recordings():
        apart = []
        for name in STROKES:
            signal = recorded(name).acceleration_m_s2
            halves = np.array_split(signal, 2)
            for own, other in (halves, halves[::-1]):
                apart.append(_apart(own, order, bands_of(*spectrum(other, RATE_HZ))))
        found["recorded"] = float(np.sqrt(np.mean(np.square(apart))))
    return found


def _planted(order: int) -> float:
    """A second of a known surface is fitted; the truth is its spectrum."""
    heard, frequency, density = planted_surface(10_000)
    return _apart(heard, order, bands_of(frequency, density))


def planted_surface(count: int, seed: int = 1) -> tuple[Array, Array, Array]:
    """Samples (n,) [m/s²] of a surface, and its spectrum: frequencies (k,) [Hz], power density (k,) [(m/s²)²/Hz].

    Noise through `LINES`, filters of SciPy's, each noise its own, over a white floor: nothing that a few poles make.
    """
    from scipy.signal import freqz, iirpeak, lfilter

    rng, warm = np.random.default_rng(seed), 5000
    frequency = np.geomspace(20.0, 1000.0, 2000)
    heard = FLOOR_M_S2 * rng.standard_normal(count + warm)
    density = np.full(len(frequency), FLOOR_M_S2**2)
    for at_Hz, loud_m_s2 in LINES:
        b, a = iirpeak(at_Hz, SHARPNESS, RATE_HZ)
        heard += lfilter(loud_m_s2 * b, a, rng.standard_normal(count + warm))
        density += np.abs(freqz(loud_m_s2 * b, a, worN=frequency, fs=RATE_HZ)[1]) ** 2
    return heard[warm:], frequency, 2.0 * density / RATE_HZ


def _apart(signal: Array, order: int, true_m_s2: Array) -> float:
    """How far a fit of that order is from the true levels of the bands, as loud as these in all [JND]."""
    from hapscene.dsp.linear_prediction import autocorrelation, smoothed, solve, tapered

    a = solve(smoothed(autocorrelation(tapered(signal, RATE_HZ), order), RATE_HZ))
    bands = model_bands(a, 1.0, RATE_HZ)
    return float(apart_jnd(bands * np.sqrt(np.sum(true_m_s2**2) / np.sum(bands**2)), true_m_s2))


def time(order: int) -> tuple[float, float]:
    from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
    from hapscene.surface.texture import Texture

    a = ar_from_reflection(np.random.default_rng(order).uniform(-0.3, 0.3, order))
    texture = Texture.from_models(RATE_HZ, [2.0], [0.2], a=a[None], variance_m2_s4=[1.0 / float(power_gain(a))])
    return texture_us(texture)


def advice(points: Sequence[Point]) -> str:
    """The smallest order within a just-noticeable difference of the best."""
    key = "planted" if no_recordings() else "recorded"
    least = best(points, key)
    chosen = enough(points, key, least.errors[key] + 1.0)
    most = round(ORDER_MAX * RATE_HZ / AUDIO_RATE_HZ)
    return (
        f"Choose {chosen.label}: at {chosen.errors[key]:.2g} JND it is the quickest within one of the best, "
        f"{least.label} ({least.errors[key]:.2g} JND), and takes {chosen.median_us:.2g} µs a block where that takes "
        f"{least.median_us:.2g}. Not so small where a surface rings at sharp lines, which a low order blurs; and not "
        f"above {most} for what is played at {AUDIO_RATE_HZ / 1e3:g} kHz: resampled it would pass the {ORDER_MAX} "
        "that a tick has room for."
    )


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
        "to one second."
    ),
    per="block",
)
