"""A swatch in figures and in words: how stiff, how rough, how slippery it is."""

from typing import Final

import numpy as np

from hapscene.constants import LEVEL_BOUND_DB
from hapscene.surface.swatch import TOOL_FIELDS, Swatch
from hapscene.surface.texture import Texture

__all__ = ["FORCE_N", "SPEED_M_S", "TAP_M_S", "figures", "lines", "words"]

FORCE_N: Final = 1.0
"""Normal force that roughness is told at [N]: a light stroke."""

SPEED_M_S: Final = 0.1
"""Slip speed that roughness is told at [m/s]: a slow stroke."""

TAP_M_S: Final = 0.1
"""Approach speed that hardness is told at [m/s]."""

_WORDS: Final = {
    # bounds are steps that are surely told apart: 22 % in compliance (Tan et al. 1995), 2 to 3 dB in level (Israr et
    # al. 2006), 11 % in friction (Gueorguiev et al. 2017); several of them to a word
    "stiffness_N_m": ((150.0, "very soft"), (400.0, "soft"), (800.0, "firm"), (1600.0, "stiff"), (np.inf, "rigid")),
    "roughness_m_s2": (
        *((0.05, "smooth"), (0.5, "fine-grained"), (1.5, "slightly rough")),
        *((5.0, "rough"), (np.inf, "very rough")),
    ),
    "friction_dynamic": ((0.15, "slippery"), (0.35, "sliding easily"), (0.7, "grippy"), (np.inf, "very grippy")),
}

MORE: Final = {
    "friction_stribeck_m_s": ("", "{:.3g} m/s over which it falls"),
    "friction_viscous_s_m": ("", "{:.3g} s/m growing with the speed"),
    "hunt_crossley_Ns_m2": ("damping", "{:.4g} N·s/m² growing with the depth"),
    "adhesion_N": ("adhesion", "{:.3g} N"),
    "adhesion_range_m": ("", "{:.3g} m beyond the surface"),
    "breakaway_1_kg": ("breakaway", "{:.3g} m/s² per newton set free"),
    "breakaway_Hz": ("", "{:.4g} Hz"),
    "breakaway_decay_1_s": ("", "{:.4g} 1/s decay"),
}
"""How numbers that not every surface has are told: by what, and in which words."""


def figures(swatch: Swatch) -> dict[str, float]:
    """What can be said of a swatch in numbers, by name with the unit; what it lacks is left out.

    `roughness_m_s2` is the root mean square of the acceleration at 1 N and 0.1 m/s (a texture that reaches less far is
    asked at its maximum), `tap_m_s2` and `tap_Hz` the tap at 0.1 m/s.
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
    """How many models of a texture sound; the silent ones on its two axes only close it."""
    return int(np.count_nonzero(texture.variance_m2_s4))


def words(numbers: dict[str, float]) -> list[str]:
    """The same in words, as ["firm", "rough", "grippy"]; a figure that is missing says nothing."""
    told = {key: steps for key, steps in _WORDS.items() if key in numbers}
    return [next(word for bound, word in steps if numbers[key] < bound) for key, steps in told.items()]


def lines(swatch: Swatch) -> list[str]:
    """A swatch told to a reader: words, every figure with its unit, provenance, licence."""
    found = figures(swatch)
    told = [f"{swatch.name}: {', '.join(words(found))}", ""]
    told += [_line("stiffness", f"{swatch.stiffness_N_m:.4g} N/m" + _measured(swatch, "stiffness_N_m"))]
    told += [_line("damping", f"{swatch.damping_Ns_m:.4g} N·s/m" + _measured(swatch, "damping_Ns_m"))]
    static, dynamic = _measured(swatch, "friction_static"), _measured(swatch, "friction_dynamic")
    told += [_line("friction", f"{swatch.friction_static:.3g} static{static}")]
    told += [_line("", f"{swatch.friction_dynamic:.3g} dynamic{dynamic}")]
    told += [
        _line(what, text.format(found[name]) + _measured(swatch, name))
        for name, (what, text) in MORE.items()
        if name in found
    ]
    texture, taps = swatch.texture, swatch.taps
    if texture is None:
        told.append(_line("texture", _measured(swatch, "texture").strip(" ()") or "not measured"))
    else:
        at_N, at_m_s = min(FORCE_N, texture.force_max_N), min(SPEED_M_S, texture.speed_max_m_s)
        told.append(_line("roughness", f"{found['roughness_m_s2']:.3g} m/s² rms at {at_N:.3g} N and {at_m_s:.3g} m/s"))
        count = sounding(texture)
        size = f"{count} model{'s' if count != 1 else ''} of order {texture.order} at {texture.rate_Hz:g} Hz"
        reach = f"to {texture.force_max_N:.3g} N and {texture.speed_max_m_s:.3g} m/s"
        warped = f", warped by {texture.warp:.3g}" if texture.warp else ""
        told.append(_line("texture", f"{size}, {reach}, blended as {texture.interpolation!r}{warped}"))
        told += [_line("", sentence) for sentence in _living(texture)]
    if taps is None:
        told.append(_line("taps", _measured(swatch, "taps").strip(" ()") or "not measured"))
    else:
        speeds = f"{len(taps.approach_m_s)} from {taps.approach_m_s[0]:.3g} to {taps.approach_m_s[-1]:.3g} m/s"
        peak = f"at {TAP_M_S:g} m/s: {found['tap_m_s2']:.3g} m/s², {found['tap_Hz']:.3g} Hz"
        told.append(_line("taps", f"{speeds}; {peak}"))
    if swatch.leaving is not None:
        speed_m_s = swatch.leaving.approach_m_s
        told.append(_line("leaving", f"sounds at {len(speed_m_s)} from {speed_m_s[0]:.3g} to {speed_m_s[-1]:.3g} m/s"))
    told.append(_line("colour", " ".join(f"{c:.2f}" for c in swatch.albedo_rgb) + " (red green blue, 0 to 1)"))
    for effect, numbers in swatch.effects.items():
        told.append(_line(effect, ", ".join(f"{param} {value:g}" for param, value in numbers.items())))
    told += [_line(what, getattr(swatch, what)) for what in TOOL_FIELDS if getattr(swatch, what)]
    told += [_line("provenance", " ".join(swatch.provenance.split()) or "not stated")]
    told += [_line("licence", " ".join(swatch.licence.split()) or "not stated")]
    return told


def _living(texture: Texture) -> list[str]:
    """What is said of its slow gain, and of its level beyond what was recorded."""
    told = []
    if texture.life is not None:
        life = texture.life
        each = [f"{x:.3g}/s + {y:.3g}/m" for x, y in zip(life.decay_1_s, life.decay_1_m, strict=True)]
        told.append(f"alive: gain of {20.0 / np.log(10.0) * life.log_spread:.2g} dB spread, forgets {', '.join(each)}")
    if np.any(texture.exponents != 0.0):
        force, speed = texture.exponents
        told.append(
            f"beyond: power as force^{force:.2g} and speed^{speed:.2g}, by {LEVEL_BOUND_DB:g} dB at most (not recorded)"
        )
    return told


def _measured(swatch: Swatch, name: str) -> str:
    """Return the confidence interval of a parameter, or the reason why it was not measured."""
    if name in swatch.intervals:
        low, high = swatch.intervals[name]
        return f" (95 %: {low:.3g} to {high:.3g})"
    return f" (not measured: {swatch.absent[name]})" if name in swatch.absent else ""


def _line(what: str, told: str) -> str:
    """One line; what could steer a terminal is shown as a box."""
    return f"  {what:<11} " + "".join(c if c.isprintable() else "�" for c in told)
