"""Summary of a swatch in figures and words: stiffness, roughness, friction, taps."""

from typing import Final, NamedTuple

import numpy as np

from hapscene.constants import LEVEL_BOUND_DB
from hapscene.surface.swatch import TOOL_FIELDS, Swatch
from hapscene.surface.texture import Texture

__all__ = ["FORCE_N", "SPEED_M_S", "TAP_M_S", "Phrase", "figures", "lines", "phrases", "words"]

FORCE_N: Final = 1.0
"""Normal force at which roughness is stated [N]: a light stroke."""

SPEED_M_S: Final = 0.1
"""Slip speed at which roughness is stated [m/s]: a slow stroke."""

TAP_M_S: Final = 0.1
"""Approach speed at which tap transients are stated [m/s]."""

_WORDS: Final = {
    # each class spans several just-noticeable differences: 22 % in compliance (Tan et al. 1995), 2 to 3 dB in level
    # (Israr et al. 2006), 11 % in friction (Gueorguiev et al. 2017)
    "stiffness_N_m": ((150.0, "very soft"), (400.0, "soft"), (800.0, "firm"), (1600.0, "stiff"), (np.inf, "rigid")),
    "roughness_m_s2": (
        *((0.05, "smooth"), (0.5, "fine-grained"), (1.5, "slightly rough")),
        *((5.0, "rough"), (np.inf, "very rough")),
    ),
    "friction_dynamic": ((0.15, "slippery"), (0.35, "sliding easily"), (0.7, "grippy"), (np.inf, "very grippy")),
}

OPTIONAL: Final = {
    "friction_stribeck_m_s": ("", "{:.3g} m/s Stribeck speed"),
    "friction_viscous_s_m": ("", "{:.3g} s/m growth with speed"),
    "hunt_crossley_Ns_m2": ("damping", "{:.4g} N·s/m² growth with depth"),
    "adhesion_N": ("adhesion", "{:.3g} N"),
    "adhesion_range_m": ("", "{:.3g} m beyond the surface"),
    "breakaway_1_kg": ("breakaway", "{:.3g} m/s² per newton released"),
    "breakaway_Hz": ("", "{:.4g} Hz"),
    "breakaway_decay_1_s": ("", "{:.4g} 1/s decay"),
}
"""Label and text of parameters that not every surface has."""


def figures(swatch: Swatch) -> dict[str, float]:
    """Return the figures of a swatch, by name with unit, without those that it lacks.

    `roughness_m_s2` is the root mean square of the acceleration at 1 N and 0.1 m/s, or at the maxima of the texture if
    they are lower. `tap_m_s2` and `tap_Hz` describe the tap at 0.1 m/s.
    """
    found = swatch.own_numbers
    texture = swatch.texture
    if texture is not None:
        at = [min(FORCE_N, texture.force_max_N)], [min(SPEED_M_S, texture.speed_max_m_s)]
        found["roughness_m_s2"] = float(np.sqrt(texture.power(*at)[0]))
        found |= {"rate_Hz": texture.rate_Hz, "order": float(texture.order), "models": float(sounding(texture))}
        found |= {"force_max_N": texture.force_max_N, "speed_max_m_s": texture.speed_max_m_s}
    if swatch.taps is not None:
        tap = swatch.taps.at(TAP_M_S)
        found |= {"tap_m_s2": tap.amplitude_m_s2, "tap_Hz": tap.frequency_Hz}
    return found


def sounding(texture: Texture) -> int:
    """Return the number of models that are not silent; silent models only close the plane of force and speed."""
    return int(np.count_nonzero(texture.variance_m2_s4))


def words(numbers: dict[str, float]) -> list[str]:
    """Return words for figures, such as ["firm", "rough", "grippy"]; missing figures are left out."""
    known = {key: steps for key, steps in _WORDS.items() if key in numbers}
    return [next(word for bound, word in steps if numbers[key] < bound) for key, steps in known.items()]


def lines(swatch: Swatch) -> list[str]:
    """Return a summary for a reader: words, every figure with unit, provenance, licence."""
    found = figures(swatch)
    measured = {name: value for name, value in found.items() if name not in swatch.absent}
    text = [f"{swatch.name}: {', '.join(words(measured)) or 'not measured'}", ""]
    text += [_line("stiffness", _stated(swatch, "stiffness_N_m", f"{swatch.stiffness_N_m:.4g} N/m"))]
    text += [_line("damping", _stated(swatch, "damping_Ns_m", f"{swatch.damping_Ns_m:.4g} N·s/m"))]
    text += [_line("friction", _stated(swatch, "friction_static", f"{swatch.friction_static:.3g} static"))]
    text += [_line("", _stated(swatch, "friction_dynamic", f"{swatch.friction_dynamic:.3g} dynamic"))]
    text += [
        _line(label, _stated(swatch, name, form.format(found[name])))
        for name, (label, form) in OPTIONAL.items()
        if name in found
    ]
    texture, taps = swatch.texture, swatch.taps
    if texture is None:
        text.append(_line("texture", _missing(swatch, "texture")))
    else:
        at_N, at_m_s = min(FORCE_N, texture.force_max_N), min(SPEED_M_S, texture.speed_max_m_s)
        rough = f"{found['roughness_m_s2']:.3g} m/s² rms at {at_N:.3g} N and {at_m_s:.3g} m/s"
        text.append(_line("roughness", _stated(swatch, "texture.level", rough)))
        count = sounding(texture)
        size = f"{count} model{'s' if count != 1 else ''} of order {texture.order} at {texture.rate_Hz:g} Hz"
        reach = f"up to {texture.force_max_N:.3g} N and {texture.speed_max_m_s:.3g} m/s"
        warped = f", warp {texture.warp:.3g}" if texture.warp else ""
        text.append(_line("texture", f"{size}, {reach}, interpolation {texture.interpolation!r}{warped}"))
        text += [_line("", sentence) for sentence in _texture_details(texture)]
    if taps is None:
        text.append(_line("taps", _missing(swatch, "taps")))
    else:
        speeds = f"{len(taps.approach_m_s)} speeds from {taps.approach_m_s[0]:.3g} to {taps.approach_m_s[-1]:.3g} m/s"
        peak = f"at {TAP_M_S:g} m/s: {found['tap_m_s2']:.3g} m/s², {found['tap_Hz']:.3g} Hz"
        text.append(_line("taps", f"{speeds}; {peak}"))
    if swatch.leaving is not None:
        speed_m_s = swatch.leaving.approach_m_s
        text.append(_line("leaving", f"{len(speed_m_s)} speeds from {speed_m_s[0]:.3g} to {speed_m_s[-1]:.3g} m/s"))
    text.append(_line("colour", " ".join(f"{c:.2f}" for c in swatch.albedo_rgb) + " (red green blue, 0 to 1)"))
    for effect, numbers in swatch.effects.items():
        text.append(_line(effect, ", ".join(f"{param} {value:g}" for param, value in numbers.items())))
    text += [_line(name, getattr(swatch, name)) for name in TOOL_FIELDS if getattr(swatch, name)]
    text += [_line("provenance", " ".join(swatch.provenance.split()) or "not stated")]
    text += [_line("licence", " ".join(swatch.licence.split()) or "not stated")]
    return text


def _texture_details(texture: Texture) -> list[str]:
    """Return sentences about the amplitude modulation, and the level beyond the recorded range."""
    text = []
    gain = texture.modulation
    if gain is not None:
        each = [f"{x:.3g}/s + {y:.3g}/m" for x, y in zip(gain.decay_1_s, gain.decay_1_m, strict=True)]
        spread_dB = 20.0 / np.log(10.0) * gain.log_spread
        text.append(f"amplitude modulation of {spread_dB:.2g} dB (standard deviation), decorrelation {', '.join(each)}")
    if np.any(texture.exponents != 0.0):
        force, speed = texture.exponents
        text.append(
            f"beyond that range, assumed: power grows with force^{force:.2g} and speed^{speed:.2g}, "
            f"by at most {LEVEL_BOUND_DB:g} dB"
        )
    return text


def _stated(swatch: Swatch, name: str, value: str) -> str:
    """Return a value with its confidence interval, or as an assumption with the reason if it was not measured."""
    if name in swatch.intervals:
        low, high = swatch.intervals[name]
        return f"{value} (95 %: {low:.3g} to {high:.3g})"
    if name == "texture.level" and name in swatch.absent:
        return f"{value} (assumed: {swatch.absent[name]})"
    if (reason := swatch.absent.get(f"{name}.interval")) is not None:
        value += f" (no interval: {reason})"
    return f"not measured: {swatch.absent[name]}; {value} assumed" if name in swatch.absent else value


def _missing(swatch: Swatch, name: str) -> str:
    """Return why a part of a swatch is missing."""
    return f"not measured: {swatch.absent[name]}" if name in swatch.absent else f"no {name}"


def _line(label: str, text: str) -> str:
    """Return one line; control characters are replaced, because they could change the state of a terminal."""
    return f"  {label:<11} " + "".join(c if c.isprintable() else "�" for c in text)


# Description of the qualities of a swatch, each with its figure.


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
