"""Exports a swatch as an MPEG haptics file: `.hjif`, the JSON interchange format of ISO/IEC 23090-31.

The format describes signals and not surfaces. The texture is therefore synthesised at one force and speed and written
as a `Curve` band with a keyframe per sample and linear interpolation (a player that resamples it loses 0.3 dB at 1 kHz
and a rate of 10 kHz). The taps and the transients of leaving the surface follow as `Transient` bands: one transient
every half second, in order of speed, with peak and frequency. The player decides how a transient decays.

Amplitudes in the format range from −1 to 1. The maximum amplitude of the reference device, in m/s², is the value of 1.

Structure, names and limits follow the JSON schemas of the MPEG group (MPEGGroup/HapticJSONSchemas at commit e3b9aa67)
and the conformance checks of its reference software (at commit 73ffe9bb), which also requires timescale and syncs,
integer limits and frequencies, and a named profile and level. The schema requires version "2023".
"""

import datetime
import json
import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.io.streams import Array
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import SwatchError
from hapscene.io.files import write_whole
from hapscene.surface.swatch import Swatch, SwatchLike, touched_with
from hapscene.surface.taps import Taps
from hapscene.swatches.library import load_swatch

__all__ = ["SECONDS_MAX", "TAP_SPACING_S", "TIMESCALE_MAX", "as_hjif", "export_hjif"]

TIMESCALE_MAX: Final = 48_000
"""Largest number of time units per second in the profile "Main" [1/s]."""

SECONDS_MAX: Final = 60.0
"""Longest texture that can be written [s]: 60 MB of text at 10 kHz."""

TAP_SPACING_S: Final = 0.5
"""Time between two taps, and from the texture to the first tap [s]; longer than a tap rings."""

Json = dict[str, Any]

_UNSPECIFIED: Final = 0  # body part mask


def export_hjif(
    swatch: SwatchLike,
    path: str | os.PathLike[str],
    *,
    force_N: float,
    speed_m_s: float,
    seconds: float,
    rate_Hz: float | None = None,
    seed: int = 0,
) -> None:
    """Writes a swatch as an MPEG haptics file.

    Args:
        swatch: a swatch with a texture or taps.
        path: file to write; suffix .hjif.
        force_N: normal force of the texture, ≥ 0.
        speed_m_s: slip speed of the texture, ≥ 0.
        seconds: length of the texture, at most 60.
        rate_Hz: sample rate, an integer up to 48000; None: the rate of the texture, or 10000.
        seed: seed of the texture's noise.

    Raises:
        SwatchError: the swatch has neither texture nor taps, a number is out of range, or the file cannot be written.
    """
    swatch = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    target = Path(path)
    if target.suffix != ".hjif":
        raise SwatchError(f"{target}: invalid suffix of an MPEG haptics file; expected .hjif")
    content = as_hjif(swatch, force_N, speed_m_s, seconds, rate_Hz, seed)
    write_whole(target, json.dumps(content, ensure_ascii=False, allow_nan=False).encode(), SwatchError)


def as_hjif(
    swatch: Swatch, force_N: float, speed_m_s: float, seconds: float, rate_Hz: float | None = None, seed: int = 0
) -> Json:
    """Content of the file that `export_hjif` writes."""
    rate = rate_Hz or (swatch.texture.rate_Hz if swatch.texture is not None else 10_000.0)
    if swatch.texture is None and swatch.taps is None:
        raise SwatchError(f"swatch {swatch.name!r} has neither texture nor taps; expected at least one of them")
    if rate != round(rate) or not 1000 <= rate <= TIMESCALE_MAX:
        raise SwatchError(f"rate_Hz is {rate:g}; expected an integer from 1000 to {TIMESCALE_MAX}")
    if not 0.0 < seconds <= SECONDS_MAX:
        raise SwatchError(f"seconds is {seconds:g}; expected more than 0 and at most {SECONDS_MAX:g}")
    for name, value in (("force_N", force_N), ("speed_m_s", speed_m_s)):
        if not 0.0 <= value < np.inf:
            raise SwatchError(f"{name} is {value:g}; expected a finite number, 0 or more")
    perceptions = []
    first_tap_s = 0.0
    if swatch.texture is not None:
        count = max(2, round(seconds * rate))
        signal = synthesize(swatch, np.full(count, force_N), np.full(count, speed_m_s), rate_Hz=rate, seed=seed)
        title = f"{swatch.name}: texture at {force_N:g} N and {speed_m_s:g} m/s, {seconds:g} s"
        perceptions.append(_perception(0, title, float(np.abs(signal).max()), rate, _curve(signal)))
        first_tap_s = count / rate + TAP_SPACING_S
    for what, taps in (("taps", swatch.taps), ("leaving", swatch.leaving)):
        if taps is not None:
            speeds = ", ".join(f"{v:g}" for v in taps.approach_m_s[:20])
            title = f"{swatch.name}: {what} at {speeds} m/s, one every {TAP_SPACING_S:g} s from {first_tap_s:g} s"
            peak, band = _transients(taps, rate, first_tap_s)
            perceptions.append(_perception(len(perceptions), title, peak, rate, band))
            first_tap_s += len(taps.approach_m_s) * TAP_SPACING_S
    touched = touched_with(swatch)
    notes = [swatch.name, f"Touched with: {touched}." if touched else "", swatch.provenance]
    notes.append(f"Licence: {swatch.licence}" if swatch.licence else "")
    return {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "description": " ".join(note for note in notes if note),
        "timescale": int(rate),
        "avatars": [],
        "perceptions": perceptions,
        "syncs": [],
    }


def _perception(number: int, description: str, peak_m_s2: float, rate_Hz: float, band: Json) -> Json:
    """A signal on one channel; an amplitude of 1 is the maximum of the reference device."""
    full = peak_m_s2 if peak_m_s2 > 0.0 else 1.0
    low, high = (round(f) for f in ACCELERATION_BAND_HZ)
    device = {
        "id": 1,
        "name": f"haptography handle, 1 = {full:.6g} m/s2",
        "body_part_mask": _UNSPECIFIED,
        "minimum_frequency": low,
        "maximum_frequency": high,
        "maximum_amplitude": full,
        "type": "VCA",
    }
    channel = {
        "id": 0,
        "description": f"acceleration along the handle, 1 = {full:.6g} m/s2",
        "reference_device_id": 1,
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": _UNSPECIFIED,
        "frequency_sampling": int(rate_Hz),
        "bands": [band],
    }
    return {
        "id": number,
        "perception_modality": "Vibrotactile",
        "description": description,
        "avatar_id": 0,
        "unit_exponent": -3,
        "perception_unit_exponent": 0,
        "effect_library": [],
        "reference_devices": [device],
        "channels": [channel],
    }


def _effect(position: int, keyframes: list[Json]) -> Json:
    return {"effect_type": "Basis", "position": position, "phase": 0.0, "base_signal": "Sine", "keyframes": keyframes}


def _band(kind: str, effects: list[Json], **more: str) -> Json:
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": round(ACCELERATION_BAND_HZ[1])}
    return {"band_type": kind, **more, **limits, "effects": effects}


def _curve(signal: Array) -> Json:
    """A signal (n,) as a band with peak 1; six decimals are 120 dB below the peak."""
    peak = float(np.abs(signal).max())
    scaled = np.round(signal / (peak if peak > 0.0 else 1.0), 6).tolist()
    keyframes = [{"relative_position": i, "amplitude_modulation": value} for i, value in enumerate(scaled)]
    return _band("Curve", [_effect(0, keyframes)], curve_type="Linear")


def _transients(taps: Taps, rate_Hz: float, first_s: float) -> tuple[float, Json]:
    """Largest peak of the taps [m/s²], and the taps as a band."""
    each = [taps.at(float(speed)) for speed in taps.approach_m_s]
    waves = taps.wave_m_s2
    peaks = [_peak(*tap) for tap in each] if waves is None else np.abs(waves).max(axis=1).tolist()
    largest = max(peaks)
    effects = []
    for i, (peak, tap) in enumerate(zip(peaks, each, strict=True)):
        keyframe = {
            "relative_position": 0,
            "amplitude_modulation": round(peak / largest, 6) if largest > 0.0 else 0.0,
            "frequency_modulation": round(min(tap.frequency_Hz, 10_000.0)),
        }
        effects.append(_effect(round((first_s + i * TAP_SPACING_S) * rate_Hz), [keyframe]))
    return largest, _band("Transient", effects)


def _peak(amplitude_m_s2: float, frequency_Hz: float, decay_1_s: float) -> float:
    """Peak [m/s²] of A exp(−βt) sin(ωt), which is at ωt = atan(ω/β)."""
    omega = 2.0 * np.pi * frequency_Hz
    angle = float(np.arctan2(omega, decay_1_s))
    return amplitude_m_s2 * float(np.exp(-decay_1_s * angle / omega) * np.sin(angle))
