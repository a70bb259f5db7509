"""Verbal description of a swatch: hardness, texture, friction and taps, each with its figure."""

from typing import Final, NamedTuple

import numpy as np

from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, TAP_M_S, figures, words

__all__ = ["Phrase", "phrases"]

LOUDNESS: Final = ((1.5, "faint"), (4.0, "soft"), (12.0, "clear"), (np.inf, "loud"))
"""Loudness of taps by their amplitude at 0.1 m/s [m/s²], in steps of 9 dB: three to four just noticeable differences
(2 to 3 dB, Israr et al. 2006). "faint" is less than about fifteen times the detection threshold (0.1 m/s²)."""

PITCH: Final = ((42.0, "dull"), (173.0, "knocking"), (np.inf, "ringing"))
"""Pitch of taps by their frequency [Hz]. The bounds are geometric means between rubber (18 Hz), wood (100 Hz) and
aluminium (300 Hz) of Okamura, Cutkosky & Dennerlein 2001."""


class Phrase(NamedTuple):
    """Description of one quality of a swatch: a word such as "firm", and a figure such as "650 N/m" or ""."""

    quality: str
    word: str
    figure: str


def phrases(swatch: Swatch) -> tuple[Phrase, ...]:
    """Describe hardness, texture, friction and taps of a swatch with its current settings."""
    found = figures(swatch)
    (hard,) = words({"stiffness_N_m": swatch.stiffness_N_m})
    (slick,) = words({"friction_dynamic": swatch.friction_dynamic})
    # an assumed friction must not be described as if it were measured: the default 0 would be "slippery"
    slick = "friction not measured" if "friction_dynamic" in swatch.absent else slick
    return (
        Phrase("hardness", hard, f"{swatch.stiffness_N_m:.3g} N/m"),
        _texture(swatch, found),
        Phrase("friction", slick, f"µ {swatch.friction_dynamic:.2g}, {swatch.friction_static:.2g} at rest"),
        _taps(swatch, found),
    )


def _texture(swatch: Swatch, found: dict[str, float]) -> Phrase:
    texture = swatch.texture
    gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
    if texture is None:
        return Phrase("texture", "texture not measured" if "texture" in swatch.absent else "no texture", "")
    if gain == 0.0:
        return Phrase("texture", "no texture", "texture gain 0")
    roughness = gain * found["roughness_m_s2"]
    (word,) = words({"roughness_m_s2": roughness})
    force_N, speed_m_s = min(FORCE_N, texture.force_max_N), min(SPEED_M_S, texture.speed_max_m_s)
    return Phrase("texture", word, f"{roughness:.2g} m/s² at {force_N:.2g} N, {speed_m_s:.2g} m/s")


def _taps(swatch: Swatch, found: dict[str, float]) -> Phrase:
    gain = swatch.parameter("tap", "tap_gain", 1.0)
    if swatch.taps is None:
        return Phrase("taps", "taps not measured" if "taps" in swatch.absent else "no taps", "")
    if gain == 0.0:
        return Phrase("taps", "no taps", "tap gain 0")
    amplitude, frequency = gain * found["tap_m_s2"], found["tap_Hz"]
    word = f"{_step(LOUDNESS, amplitude)} {_step(PITCH, frequency)} taps"
    return Phrase("taps", word, f"{amplitude:.2g} m/s², {frequency:.3g} Hz at {TAP_M_S:g} m/s")


def _step(steps: tuple[tuple[float, str], ...], value: float) -> str:
    return next(word for bound, word in steps if value < bound)
