"""The numbers of a report in words: what is in the swatch, how good it is, what is absent."""

from typing import Final, NamedTuple

import numpy as np

from hapscene.capture import metric
from hapscene.capture.report_judgement import FELT_DB, HeldOut, Judgement
from hapscene.capture.report_plot import signed
from hapscene.surface.swatch import Swatch

LEVEL_DB: Final = 0.5
"""How far the level on held-out data may be off [dB]; a person feels 1.65 to 2.98 dB (Israr et al. 2006)."""

CENTROID: Final = 0.05
"""How far the spectral centroid may be off [1]; a person feels 13 to 38 % of frequency (Israr et al. 2006)."""

DISTANCE_RATIO: Final = 1.1
"""How much farther off than the best order, or the recording's own floor, the spectrum may be [1]."""


class Fact(NamedTuple):
    """A number at the head of the page: what, how much, and a line on it."""

    label: str
    value: str
    detail: str


class Row(NamedTuple):
    """A line of the table: what was measured, what it is, what it is held to, what follows ("good", "short" or "")."""

    measure: str
    value: str
    held_to: str
    verdict: str


def facts(swatch: Swatch) -> list[Fact]:
    """The main numbers of a swatch; one that is absent says so."""
    return [_texture(swatch), _level(swatch), _friction(swatch), _stiffness(swatch), _taps(swatch)]


def absences(swatch: Swatch) -> list[tuple[str, str]]:
    """What the swatch does not have, with the reason as far as it is known."""
    found = dict(swatch.absent)
    if swatch.texture is None:
        found.setdefault("texture", "the swatch has none: sliding is silent")
    if swatch.taps is None:
        found.setdefault("taps", "the swatch has none: a touch is silent")
    if swatch.friction_static == 0.0 and not any("friction" in name for name in found):
        found["friction"] = "the coefficients are 0: the tool glides"
    return [(plain(name), reason) for name, reason in sorted(found.items())]


def rows(judgement: Judgement) -> list[Row]:
    """How good the texture is, measure by measure."""
    held, best = judgement.held_out, float(judgement.search.distance_dB.min())
    table = [] if held is None else _held_out_rows(held, best)
    similarity = judgement.similarity
    table.append(
        Row(
            "likeness as felt, spectral part of ST-SIM",
            f"{similarity.spectral:.3f}",
            f"1 is alike (temporal part {similarity.temporal:.2f}: noise repeats no waveform)",
            "",
        )
    )
    table.append(
        Row(
            "spectrogram error, swatch against recording",
            f"{100 * judgement.spectrogram_error:.0f} %",
            "66 % for other noise of the same spectrum, 100 % for silence",
            "",
        )
    )
    return table


def _held_out_rows(held: HeldOut, best_dB: float) -> list[Row]:
    allowed = DISTANCE_RATIO * max(best_dB, held.floor_dB)
    worst = int(np.argmax(np.abs(held.band_dB)))
    low, high = metric.BAND_EDGES_HZ[worst], metric.BAND_EDGES_HZ[worst + 1]
    felt = int(np.count_nonzero(np.abs(held.band_dB) > FELT_DB))
    bands = len(held.band_dB)
    fitted, other = (metric.spectral_centroid_Hz(d, held.frequency_Hz) for d in (held.fitted, held.held_out))
    return [
        Row(
            "spectrum on the held-out half (log-spectral distance)",
            f"{held.distance_dB:.2f} dB",
            f"at most {allowed:.2f} dB: 1.1 times the recording's floor ({held.floor_dB:.2f} dB) or the best order's "
            f"({best_dB:.2f} dB)",
            _verdict(held.distance_dB <= allowed),
        ),
        Row(
            "level on the held-out half",
            f"{signed(held.level_dB, 2)} dB",
            f"within ±{LEVEL_DB} dB; felt from {FELT_DB:g} dB; the half that was fitted is itself "
            f"{signed(held.halves_dB, 1)} dB from the held-out one",
            _verdict(abs(held.level_dB) <= LEVEL_DB),
        ),
        Row(
            "spectral centroid on the held-out half",
            f"{signed(100 * (held.centroid_ratio - 1), 1)} %",
            f"within ±{100 * CENTROID:g} %; felt from 13 %; the half that was fitted is itself "
            f"{signed(100 * (fitted / other - 1), 0)} % from the held-out one",
            _verdict(abs(held.centroid_ratio - 1) <= CENTROID),
        ),
        Row(
            "bands that differ by more than is felt",
            f"{felt} of {bands}",
            f"{FELT_DB:g} dB a band; most at {low:.0f} to {high:.0f} Hz, {signed(held.band_dB[worst], 1)} dB",
            "",
        ),
        Row("goodness of fit of the spectra (GFC)", f"{held.goodness_of_fit:.3f}", "1 is one shape", ""),
        Row(
            "residual on the held-out half",
            f"{held.residual_ratio:.4f}",
            "share of the power that the model does not predict; smaller is better",
            "",
        ),
    ]


def plain(name: str) -> str:
    """The name of a quantity as words: "friction_static" is "friction static"."""
    for suffix in ("_N_m", "_Ns_m", "_m_s2", "_m_s", "_Hz", "_N"):
        name = name.removesuffix(suffix)
    return name.replace("_", " ").replace(".", ", ")


def _verdict(good: bool) -> str:
    return "good" if good else "short"


def _texture(swatch: Swatch) -> Fact:
    texture = swatch.texture
    if texture is None:
        return Fact("Texture", "none", "sliding is silent")
    count = int(np.count_nonzero(texture.variance_m2_s4))
    return Fact(
        "Texture",
        f"order {texture.order}",
        f"{count} model{'s' if count != 1 else ''} at {texture.rate_Hz / 1e3:g} kHz, up to {texture.force_max_N:.2g} N "
        f"and {1e3 * texture.speed_max_m_s:.0f} mm/s",
    )


def _level(swatch: Swatch) -> Fact:
    texture = swatch.texture
    if texture is None:
        return Fact("Vibration", "0 m/s²", "no texture")
    half = np.array([0.5 * texture.force_max_N]), np.array([0.5 * texture.speed_max_m_s])
    return Fact(
        "Vibration",
        f"{np.sqrt(texture.power(*half)[0]):.2g} m/s²",
        f"rms at half force and speed; at most {np.sqrt(texture.model_power_m2_s4.max()):.2g} m/s²",
    )


def _friction(swatch: Swatch) -> Fact:
    if swatch.friction_static == 0.0:
        return Fact("Friction", "none", "the tool glides")
    interval = swatch.intervals.get("friction_dynamic")
    known = "" if interval is None else f" (95 %: {interval[0]:.3f} to {interval[1]:.3f})"
    return Fact("Friction", f"{swatch.friction_dynamic:.3f}", f"dynamic{known}; static {swatch.friction_static:.3f}")


def _stiffness(swatch: Swatch) -> Fact:
    interval = swatch.intervals.get("stiffness_N_m")
    known = f"damping {swatch.damping_Ns_m:g} N·s/m"
    if interval is not None:
        known = f"95 %: {interval[0]:.0f} to {interval[1]:.0f} N/m; " + known
    elif any(name.startswith("stiffness") for name in swatch.absent):
        known = "not measured: the default; " + known
    return Fact("Stiffness", f"{swatch.stiffness_N_m:.0f} N/m", known)


def _taps(swatch: Swatch) -> Fact:
    if swatch.taps is None:
        return Fact("Taps", "none", "a touch is silent")
    speed = float(swatch.taps.approach_m_s[-1])
    tap = swatch.taps.at(speed)
    return Fact(
        "Taps",
        f"{tap.frequency_Hz:.0f} Hz",
        f"{tap.amplitude_m_s2:.2g} m/s² at {1e3 * speed:.0f} mm/s, gone to a third in {1e3 / tap.decay_1_s:.0f} ms",
    )
