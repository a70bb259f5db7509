"""How fast the acceleration channel must run."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch

from .measuring import FINE_HZ, ISRAR, Array, apart_jnd, bands_of, effect_us, enough, texture_bands
from .question import Measure, Point, Question, Setting

RATES_HZ: Final = (2000.0, 3000.0, 4000.0, 5000.0, 8000.0, 10_000.0, 20_000.0)

REFERENCE_HZ: Final = 20_000.0
"""Rate of what a faster channel is held against [Hz]."""

SWATCHES: Final = ("wood", "paper", "leather")

FORCE_N, SPEED_M_S, TAP_M_S = 1.0, 0.1, 0.2
"""Of the stroke, and of the tap."""

METHODS: Final = {"held": "held, as by a converter", "filtered": "filtered, as by a sound card"}


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    rates = (2000.0, 5000.0, 20_000.0) if quick else RATES_HZ
    return [
        Setting(said, f"{r / 1e3:g} kHz", {"rate_Hz": r, "output": o}) for o, said in METHODS.items() for r in rates
    ]


def error(rate_Hz: float, output: str) -> dict[str, float]:
    """Bands of textures and of taps at a rate against those at 20 kHz [JND], in closed form: no chance is in it."""
    held, parts = output == "held", dict[str, list[float]]()
    for name in SWATCHES:
        swatch = load_swatch(name)
        if swatch.texture is not None:
            bands = texture_bands(swatch.texture.resampled(rate_Hz), [FORCE_N], [SPEED_M_S], held=held)
            apart = apart_jnd(bands, texture_bands(swatch.texture.resampled(REFERENCE_HZ), [FORCE_N], [SPEED_M_S]))[0]
            parts.setdefault("texture", []).append(float(apart))
        if swatch.taps is not None:
            tap, fine = (swatch.taps.transient(TAP_M_S, r) for r in (rate_Hz, REFERENCE_HZ))
            apart = apart_jnd(tap_bands(tap, rate_Hz, held), tap_bands(fine, REFERENCE_HZ))
            parts.setdefault("tap", []).append(float(apart))
    return {key: float(np.sqrt(np.mean(np.square(each)))) for key, each in parts.items()}


def tap_bands(tap_m_s2: Array, rate_Hz: float, held: bool = False) -> Array:
    """Levels (k,) [m/s²] of a transient (n,) in the bands that are felt, as over a tenth of a second."""
    turn = np.exp(-2j * np.pi * np.outer(FINE_HZ, np.arange(len(tap_m_s2))) / rate_Hz)
    density = 2.0 * np.abs(turn @ tap_m_s2 / rate_Hz) ** 2 / 0.1
    return bands_of(FINE_HZ, density * np.sinc(FINE_HZ / rate_Hz) ** 2 if held else density)


def time(rate_Hz: float, output: str) -> tuple[float, float]:
    swatch = Swatch("timed", texture=load_swatch("wood").texture)
    return effect_us(swatch, ("wall", "lpc_texture"), ("wall",), a_rate_Hz=rate_Hz)


def advice(points: Sequence[Point]) -> str:
    """The slowest rate of each output that is not felt."""
    said = []
    for method in METHODS.values():
        own = [p for p in points if p.method == method]
        if own:
            chosen = enough(own, "texture", 1.0)
            missed = f"{chosen.errors['texture']:.2g} JND, {chosen.median_us:.2g} µs"
            said.append(f"{chosen.label} where samples are {method} ({missed})")
    dear = max(points, key=lambda p: p.median_us)
    return (
        f"Enough is {' and '.join(said)}; {dear.label} takes {dear.median_us:.2g} µs a block and nothing more is "
        "felt. Not so slow where the channel is heard as well, or where a compensator runs at this rate and has to "
        "be ahead of the handle."
    )


QUESTION: Final = Question(
    name="acceleration-rate",
    title="How fast must the acceleration channel run?",
    measures=(
        Measure("texture", "textures, twelve bands", "JND", 1.0, ISRAR),
        Measure("tap", "taps, twelve bands", "JND", 1.0, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"The shipped {', '.join(SWATCHES)} at {FORCE_N:g} N and {SPEED_M_S:g} m/s, and their taps at {TAP_M_S:g} "
        "m/s: levels from 20 to 1000 Hz in closed form against those at 20 kHz. Time of wood's texture; its order "
        "grows with the rate."
    ),
    per="block",
)
