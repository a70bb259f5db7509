"""Fits a swatch to recordings of a tool on a surface: `fit_swatch`, the main entry of `hapscene.capture`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any, Final, Literal

import numpy as np

from hapscene.capture.fit.contact import fit_contact
from hapscene.capture.fit.distance import tonal_share
from hapscene.capture.fit.friction import fit_friction, no_sliding
from hapscene.capture.fit.modulation import fit_modulation
from hapscene.capture.fit.order import DOMAINS, search_domain
from hapscene.capture.fit.segment import InteractionState, SegmentedRecording, segment
from hapscene.capture.fit.stiffness import fit_stiffness
from hapscene.capture.fit.taps import fit_taps
from hapscene.capture.fit.texture import choose_model_count, fit_texture
from hapscene.capture.fit.windows import WINDOW_S, AnalysisWindows, cut, fit_level, pooled
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import (
    ASSUMED_FORCE_N,
    ASSUMED_SPEED_M_S,
    DURATION_MIN_S,
    Array,
    clean,
    part_of,
)
from hapscene.constants import ORDER_MAX
from hapscene.dsp.warped_prediction import warp_at
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

__all__ = ["QUALITY", "FitOptions", "fit_recordings", "fit_swatch", "prepare", "verdict"]

STATIONARY_WINDOWS: Final = 5.0
"""Smallest median length of the stationary segments, in analysis windows, at which windows are aligned to the segments.
With shorter segments too many samples are lost at their ends: a fifth of the project's recordings of two seconds, which
reduced the likelihood of the other half by 0.003 per sample."""

QUALITY: Final = "texture.quality"
"""Key in `Swatch.absent` of the reason why a texture is unreliable."""

TONAL_MAX: Final = 0.7
"""Largest fraction of the power of a texture in narrow lines [1]. A texture model replaces lines by noise."""

HALVES_JND: Final = 2.0
"""Largest difference between a model of one half of a recording and the other half [JND rms over the bands]."""


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit, and notes for the swatch.

    Attributes:
        name: name of the swatch.
        order: order of the AR models, or "auto": chosen on held-out data (`hapscene.capture.fit.order`).
        model_count: number of models over force and speed, or "auto": chosen by cross-validation.
        domain: frequency axis of the AR models: "plain"; "warped" (`hapscene.dsp.warped_prediction`), with a higher
            resolution at low frequencies, at sample rates above 3 kHz; or "auto": the better one on held-out data, or
            "plain" if an order is given.
        tool: description of the tool, for example "steel probe".
        tip: description of the tip, for example "3.2 mm ball".

    Raises:
        CaptureError: an invalid order or domain.
    """

    name: str = "unnamed"
    order: int | Literal["auto"] = "auto"
    model_count: int | Literal["auto"] = "auto"
    domain: str = "auto"
    tool: str = ""
    tip: str = ""

    def __post_init__(self) -> None:
        if self.order != "auto" and not (isinstance(self.order, Integral) and 1 <= self.order <= ORDER_MAX):
            raise CaptureError(f'order is {self.order!r}; expected "auto" or an integer from 1 to {ORDER_MAX}')
        if self.domain not in DOMAINS:
            raise CaptureError(f"domain is {self.domain!r}; expected one of {', '.join(DOMAINS)}")


def fit_swatch(recording: SurfaceRecording, options: FitOptions | None = None) -> Swatch:
    """Fits a swatch to a recording of a tool on a surface.

    Args:
        recording: a recording, for example from `load_recording`. Force and speed may be single numbers; if they were
            not recorded, 1 N and 0.1 m/s are assumed.
        options: options of the fit.

    Returns:
        A swatch with the quantities that the recording supports: texture from sliding, taps from impacts, friction,
        stiffness, damping, adhesion. `intervals` has their 95 % intervals, `absent` the reason for each quantity that
        was not measured. `verdict` summarises what the swatch can be used for.

    Raises:
        CaptureError: the recording is invalid, or no quantity can be fitted to it.
    """
    return fit_recordings([prepare(recording)], options)


def prepare(recording: SurfaceRecording) -> SegmentedRecording:
    """Filters a recording and segments it by interaction state.

    Raises:
        CaptureError: a stream is too short, without vibration, not finite, or of another length than the others.
    """
    r = dict(vars(recording))
    del recording  # so that `clean` can free streams that the caller does not hold
    channels = clean(
        r.pop("acceleration_m_s2"), r["rate_Hz"], r.pop("force_N"), r.pop("speed_m_s"), r.pop("tangential_force_N"),
        r.pop("depth_m"), torque_Nm=r.pop("torque_Nm"), grip_force_N=r.pop("grip_force_N"),
        contact_angle_rad=r.pop("contact_angle_rad"),
    )  # fmt: skip
    return channels, segment(channels)


def fit_recordings(recordings: Sequence[SegmentedRecording], options: FitOptions | None = None) -> Swatch:
    """Fits one swatch to several recordings of a surface, as `fit_swatch` does to one.

    Raises:
        CaptureError: the recordings have different sample rates, or no quantity can be fitted.
    """
    options = options or FitOptions()
    rates = {channels.rate_Hz for channels, _ in recordings}
    if len(rates) != 1:
        given = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise CaptureError(f"the recordings have sample rates of {given} Hz; expected equal rates: resample them")
    (rate_Hz,) = rates
    if options.order != "auto" and options.order > (most := int(WINDOW_S * rate_Hz / 2)):
        raise CaptureError(f"order is {options.order}; expected at most {most} at {rate_Hz:g} Hz")
    friction, taps, contact = fit_friction(recordings), fit_taps(recordings), fit_contact(recordings)
    ranges = recorded_ranges(recordings)
    intervals = friction.intervals | taps.intervals | contact.intervals
    absent = friction.absent | taps.absent | contact.absent
    numbers: dict[str, Any] = dict(contact.numbers)
    if "stiffness_N_m" not in numbers:  # else it was fitted together with the damping
        stiffness = fit_stiffness(recordings)
        if stiffness.slope_N_m is None or stiffness.slope_N_m <= 0.0:
            absent["stiffness_N_m"] = stiffness.reason or "the force does not increase with the depth"
        elif stiffness.interval is None:
            numbers["stiffness_N_m"], absent["stiffness_N_m.interval"] = stiffness.slope_N_m, stiffness.reason
        else:
            numbers["stiffness_N_m"], intervals["stiffness_N_m"] = stiffness.slope_N_m, stiffness.interval
    assumed = {"force_N": f"{ASSUMED_FORCE_N:g} N", "speed_m_s": f"{ASSUMED_SPEED_M_S:g} m/s"}
    for stream in sorted({stream for channels, _ in recordings for stream in channels.assumed}):
        absent[stream] = f"was not recorded; {assumed[stream]} is assumed"
    texture = None
    try:
        texture, known, missing = _texture(recordings, options)
        intervals, absent = intervals | known, absent | missing
    except CaptureError as error:
        wrong = options.model_count != "auto" and not isinstance(error, _NoSliding)
        nothing = taps.taps is None and "stiffness_N_m" in absent and friction.dynamic == 0.0
        if wrong or nothing:
            raise
        absent["texture"] = str(error)
    return Swatch(
        options.name,
        **numbers,
        friction_static=friction.static,
        friction_dynamic=friction.dynamic,
        friction_stribeck_m_s=friction.stribeck_m_s,
        friction_viscous_s_m=friction.viscous_s_m,
        texture=texture,
        taps=taps.taps,
        leaving=contact.leaving,
        provenance=" ".join(filter(None, (friction.note, ranges and f"Recorded with {ranges}."))),
        tool=options.tool,
        tip=options.tip,
        intervals=intervals,
        absent=absent,
    )


def recorded_ranges(recordings: Sequence[SegmentedRecording]) -> str:
    """Describes the ranges of grip force, contact angle and torque during sliding; empty if they were not recorded."""
    ranges = []
    for name, (word, scale, unit) in RANGES.items():
        found = []
        for channels, states in recordings:
            stream = getattr(channels, name)
            if stream is not None:
                runs = states.runs(InteractionState.SLIDING) or [(0, len(stream))]
                found += [scale * stream[slice(*run)] for run in runs]
        if found:
            low, high = np.quantile(np.concatenate(found), RANGE_QUANTILES)
            ends = dict.fromkeys((f"{low:.3g}", f"{high:.3g}"))
            ranges.append(f"{word} {' to '.join(ends)} {unit}".replace(" °", "°"))
    return ", ".join(ranges)


RANGES: Final = {
    "grip_force_N": ("grip force", 1.0, "N"),
    "contact_angle_rad": ("contact angle", 180.0 / np.pi, "°"),
    "torque_Nm": ("torque", 1e3, "mN·m"),
}
"""Name, scale and unit of the streams to which no model is fitted."""

RANGE_QUANTILES: Final = (0.05, 0.95)
"""Quantiles at the ends of a range [1]."""


class _NoSliding(CaptureError):
    """The recordings contain too little sliding for a texture; other quantities may still be fitted."""


def _texture(
    recordings: Sequence[SegmentedRecording], options: FitOptions
) -> tuple[Texture, dict[str, tuple[float, float]], dict[str, str]]:
    """Texture, 95 % intervals of its parameters, and reasons for missing parameters and low quality."""
    rate = recordings[0][0].rate_Hz
    slid_s = sum(states.seconds(InteractionState.SLIDING) for _, states in recordings)
    if slid_s < DURATION_MIN_S:
        _analysis_windows(recordings)  # raises the reason if the tool never slides
        raise _NoSliding(f"the tool slides for only {slid_s:.2f} s; expected at least {DURATION_MIN_S:g} s")
    slid, missing = _sliding_acceleration(recordings), {}
    share = tonal_share(slid, rate)
    if options.order == "auto":
        search = search_domain(slid, rate, options.domain)
        order, noise, warp = search.chosen, search.noise, search.warp
        difference_jnd = float(search.band_jnd[search.orders == order][0])
        if difference_jnd > HALVES_JND:
            difference = f"a model of one half of the recording differs from the other half by {difference_jnd:.1f} JND"
            missing[QUALITY] = f"{difference} (at most {HALVES_JND:g} expected): record longer and steadier strokes"
    else:
        order, noise, warp = int(options.order), None, warp_at(rate) if options.domain == "warped" else 0.0
    if share > TONAL_MAX:
        missing[QUALITY] = (
            f"{100 * share:.0f} % of the vibration is in pure tones, which a texture model replaces by noise: look for "
            "hum or motor noise and record sliding on the surface"
        )
    del slid  # as large as a stream
    windows = _analysis_windows(recordings)
    model_count = options.model_count
    if model_count == "auto":
        model_count = choose_model_count(windows, rate, order, noise, warp)
    elif not (isinstance(model_count, Integral) and 1 <= model_count <= len(windows)):
        raise CaptureError(f'model_count is {model_count!r}; expected "auto" or an integer from 1 to {len(windows)}')
    model_count, law = int(model_count), fit_level(windows)
    ends = zip(law.exponents - 1.96 * law.spread, law.exponents + 1.96 * law.spread, strict=True)
    intervals = {f"texture.exponents[{i}]": (float(low), float(high)) for i, (low, high) in enumerate(ends)}

    texture = fit_texture(windows, rate, order, model_count, noise=noise, warp=warp)
    runs = [(c, run) for c, states in recordings for run in states.runs(InteractionState.SLIDING)]
    found = fit_modulation(texture, [part_of(channels, slice(*run)) for channels, run in runs])
    if found.modulation is None:
        return texture, intervals, missing | {"texture.life": found.reason}
    count = len(found.modulation.spread)
    names = [*(f"texture.life.spread[{i}]" for i in range(count)), "texture.life.log_spread"]
    intervals |= zip(names, found.intervals, strict=True)
    return replace(texture, modulation=found.modulation), intervals, missing


def _sliding_acceleration(recordings: Sequence[SegmentedRecording]) -> Array:
    """Acceleration of all sliding, concatenated."""
    runs = [(c.acceleration_m_s2, run) for c, states in recordings for run in states.runs(InteractionState.SLIDING)]
    found = [acceleration[slice(*run)] for acceleration, run in runs]
    return found[0] if len(found) == 1 else np.concatenate(found)


def _analysis_windows(recordings: Sequence[SegmentedRecording]) -> AnalysisWindows:
    """Analysis windows of all recordings; recordings without sliding are ignored."""
    found, reason = [], "no recording was given"
    for channels, states in recordings:
        runs = states.stationary()
        lengths = [end - start for start, end in runs]
        if not runs or np.median(lengths) < STATIONARY_WINDOWS * WINDOW_S * channels.rate_Hz:
            runs = states.runs(InteractionState.SLIDING)
        try:
            found.append(cut(channels, runs))
        except CaptureError as error:
            reason = str(error)
    if not found:
        raise _NoSliding(no_sliding(recordings) or reason)
    return pooled(found)


def verdict(swatch: Swatch) -> str:
    """Verdict on a fitted swatch: "usable", "usable for …; not measured: …", or "record more: …" with the reason."""
    measured = {
        "texture": swatch.texture is not None,
        "taps": swatch.taps is not None,
        "friction": "friction_dynamic" not in swatch.absent,
        "stiffness": "stiffness_N_m" not in swatch.absent,
    }
    if QUALITY in swatch.absent:
        return f"record more: {swatch.absent[QUALITY]}"
    usable = [name for name, known in measured.items() if known]
    missing = [name for name, known in measured.items() if not known]
    assumed = [word for name, word in (("force_N", "force"), ("speed_m_s", "speed")) if name in swatch.absent]
    if not usable:
        return f"record more: {swatch.absent.get('texture', 'no quantity was measured')}"
    if not missing and not assumed:
        return "usable"
    found = ", ".join(usable)
    if assumed and swatch.texture is not None:
        found = found.replace("texture", f"texture (at an assumed {' and '.join(assumed)})")
    return f"usable for {found}" + (f"; not measured: {', '.join(missing)}" if missing else "")
