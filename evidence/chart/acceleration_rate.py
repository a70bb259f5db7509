"""The question of the sample rate of the acceleration channel."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hapscene.constants import ACCELERATION_RATE_HZ as DEFAULT_HZ
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch

from ..bench.handle import RATE_HZ
from .measuring import FINE_HZ, ISRAR, Array, apart_jnd, bands_of, texture_bands, texture_us
from .question import Measure, Point, Question, Setting

RATES_HZ: Final = (20_000.0, 10_000.0, 8000.0, 5000.0, 4000.0, 3000.0, 2000.0)

REFERENCE_HZ: Final = 20_000.0
"""Sample rate of the reference [Hz]."""

SWATCHES: Final = ("wood", "paper", "leather")

FORCE_N, SPEED_M_S, TAP_M_S = 1.0, 0.1, 0.2
"""Normal force and speed of the stroke; approach speed of the tap."""

OUTPUTS: Final = {"held": "zero-order hold (converter)", "filtered": "low-pass (sound card)"}
"""Output stage by its key."""


def settings(scene_file: str | None) -> list[Setting]:
    return [
        Setting("Acceleration rate", "", f"{r / 1e3:g} kHz", {"rate_Hz": r, "output": o}, case, r == DEFAULT_HZ)
        for r in RATES_HZ
        for o, case in OUTPUTS.items()
    ]


def error(rate_Hz: float, output: str) -> dict[str, float]:
    """Return the distance in bands of textures and taps from those at 20 kHz [JND], in closed form."""
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
    """Return the levels (k,) [m/s²] of a transient (n,) in the perceptible bands, averaged over a tenth of a second."""
    turn = np.exp(-2j * np.pi * np.outer(FINE_HZ, np.arange(len(tap_m_s2))) / rate_Hz)
    density = 2.0 * np.abs(turn @ tap_m_s2 / rate_Hz) ** 2 / 0.1
    return bands_of(FINE_HZ, density * np.sinc(FINE_HZ / rate_Hz) ** 2 if held else density)


def time(rate_Hz: float, output: str) -> tuple[float, float]:
    swatch = Swatch("timed", texture=load_swatch("wood").texture)
    return texture_us(swatch, rate_Hz)


def caveat(used: Sequence[Point], every: Sequence[Point]) -> str:
    """Return that compensators are tested at one rate only."""
    return f"audio or compensators (tested at {RATE_HZ / 1e3:g} kHz only)"


QUESTION: Final = Question(
    name="acceleration-rate",
    title="Sample rate of the acceleration channel",
    measures=(
        Measure("texture", "textures, twelve bands", "JND", 1.0, ISRAR),
        Measure("tap", "taps, twelve bands", "JND", 1.0, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    caveat=caveat,
    conditions=(
        f"Shipped swatches {', '.join(SWATCHES)} at {FORCE_N:g} N and {SPEED_M_S:g} m/s, and their taps at "
        f"{TAP_M_S:g} m/s. Error: levels in bands from 20 to 1000 Hz against those at 20 kHz, in closed form. Time: "
        "wood's texture; its order grows with the rate."
    ),
)
