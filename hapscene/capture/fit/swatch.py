"""Fit a swatch to recordings of a tool on a surface: the main entry of `hapscene.capture`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any, Final, Literal

import numpy as np

from hapscene.capture.fit.contact import fit_contact
from hapscene.capture.fit.friction import fit_friction, no_sliding
from hapscene.capture.fit.modulation import fit_life
from hapscene.capture.fit.order import DOMAINS, search_domain
from hapscene.capture.fit.segment import InteractionState, Part, segment
from hapscene.capture.fit.stiffness import fit_stiffness
from hapscene.capture.fit.taps import fit_taps
from hapscene.capture.fit.texture import choose_model_count, fit_texture
from hapscene.capture.fit.windows import PIECE_S, Pieces, cut, fit_level, pooled
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

__all__ = ["FitOptions", "fit_parts", "fit_swatch", "prepare"]

STATIONARY_PIECES: Final = 5.0
"""Median length of the stationary stretches, in pieces of `PIECE_S`, from which the texture's pieces are cut at their
borders [1]. Of shorter ones too much is left over: of the project's recordings of two seconds a fifth, and the
likelihood of the other half fell by 0.003 a sample."""


@dataclass(frozen=True)
class FitOptions:
    """How a swatch is fitted, and what is noted in it.

    Attributes:
        name: of the swatch.
        order: of the AR models, or "auto": chosen on held-out data (`hapscene.capture.fit.order`).
        model_count: models over force and speed, or "auto": as many as held-out data support.
        interpolation: how the texture blends its models, see `hapscene.surface.texture`.
        domain: frequency axis of the AR models: "plain"; "warped", finer where more is felt, at rates above 3 kHz
            (`hapscene.dsp.warped_prediction`); or "auto": the better one on held-out data, "plain" for a given order.
        tool: what held the tip, as in "steel probe".
        tip: what touched the surface, as in "3.2 mm ball".

    Raises:
        CaptureError: an order or a domain that is invalid.
    """

    name: str = "unnamed"
    order: int | Literal["auto"] = "auto"
    model_count: int | Literal["auto"] = "auto"
    interpolation: str = "lsf"
    domain: str = "auto"
    tool: str = ""
    tip: str = ""

    def __post_init__(self) -> None:
        if self.order != "auto" and not (isinstance(self.order, Integral) and 1 <= self.order <= ORDER_MAX):
            raise CaptureError(f'order must be "auto" or a whole number from 1 to {ORDER_MAX}, is {self.order!r}')
        if self.domain not in DOMAINS:
            raise CaptureError(f"domain must be one of {', '.join(DOMAINS)}, is {self.domain!r}")


def fit_swatch(recording: SurfaceRecording, options: FitOptions | None = None) -> Swatch:
    """The swatch of a recording of a tool on a surface, as `load_recording` returns it.

    Args:
        recording: its streams. The models are made for its rate. Force and speed may be one number; without them 1 N
            and 0.1 m/s are assumed. Without a tangential force the swatch has no friction, without a depth the
            stiffness is the default.
        options: how it is fitted.

    Returns:
        A swatch with what the recording supports: texture where the tool slides, taps where it strikes, friction,
        stiffness. `intervals` has their 95 % intervals, `absent` the reason for each quantity that is missing.

    Raises:
        CaptureError: nothing can be fitted to such streams; the text gives the reason.
    """
    return fit_parts([prepare(recording)], options)


def prepare(recording: SurfaceRecording) -> Part:
    """A recording, cleaned and cut into states.

    Raises:
        CaptureError: too short, silent, not finite, or streams of different length.
    """
    r = dict(vars(recording))
    del recording  # a stream that the caller does not hold is freed by `clean`
    channels = clean(
        r.pop("acceleration_m_s2"), r["rate_Hz"], r.pop("force_N"), r.pop("speed_m_s"), r.pop("tangential_force_N"),
        r.pop("depth_m"), torque_Nm=r.pop("torque_Nm"), grip_force_N=r.pop("grip_force_N"),
        contact_angle_rad=r.pop("contact_angle_rad"),
    )  # fmt: skip
    return channels, segment(channels)


def fit_parts(parts: Sequence[Part], options: FitOptions | None = None) -> Swatch:
    """The swatch of several recordings of one surface, pooled; as `fit_swatch`.

    Raises:
        CaptureError: recordings of different rates, or from which nothing can be fitted.
    """
    options = options or FitOptions()
    rates = {channels.rate_Hz for channels, _ in parts}
    if len(rates) != 1:
        given = ", ".join(f"{rate:g}" for rate in sorted(rates)) or "none"
        raise CaptureError(f"recordings of one surface must have one rate, these have {given} Hz: resample them")
    if options.order != "auto" and options.order > (most := int(PIECE_S * min(rates) / 2)):
        raise CaptureError(f"order must be at most {most} at {min(rates):g} Hz, is {options.order}")
    friction, taps, contact = fit_friction(parts), fit_taps(parts), fit_contact(parts)
    ranges = recorded_ranges(parts)
    intervals = friction.intervals | taps.intervals | contact.intervals
    absent = friction.absent | taps.absent | contact.absent
    numbers: dict[str, Any] = dict(contact.numbers)
    if "stiffness_N_m" not in numbers:  # a damped spring is fitted with its damper
        stiffness = fit_stiffness(parts)
        if stiffness.slope_N_m is not None and stiffness.slope_N_m > 0.0 and stiffness.interval is not None:
            numbers["stiffness_N_m"], intervals["stiffness_N_m"] = stiffness.slope_N_m, stiffness.interval
        else:
            absent["stiffness_N_m"] = stiffness.reason or "the force does not grow with the depth"
    assumed = {"force_N": f"{ASSUMED_FORCE_N:g} N", "speed_m_s": f"{ASSUMED_SPEED_M_S:g} m/s"}
    for stream in sorted({stream for channels, _ in parts for stream in channels.assumed}):
        absent[stream] = f"was not recorded: {assumed[stream]} assumed"
    texture = None
    try:
        texture, known, missing = _texture(parts, options)
        intervals, absent = intervals | known, absent | missing
    except CaptureError as error:
        wrong = options.model_count != "auto" and not isinstance(error, _NoTexture)
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


def recorded_ranges(parts: Sequence[Part]) -> str:
    """The ranges of the streams beside force and speed while the tool slid, or else of all; "" without such streams."""
    ranges = []
    for name, (word, scale, unit) in RANGES.items():
        found = []
        for channels, states in parts:
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
"""Name, scale and unit of the streams that nothing is fitted to."""

RANGE_QUANTILES: Final = (0.05, 0.95)
"""Quantiles that bound a range [1]."""


class _NoTexture(CaptureError):
    """The recordings hold no sliding to fit a texture to: the rest of the swatch may do without."""


def _texture(
    parts: Sequence[Part], options: FitOptions
) -> tuple[Texture, dict[str, tuple[float, float]], dict[str, str]]:
    """The texture of all sliding, the 95 % intervals of its numbers, and what it lacks, by their names."""
    rate = parts[0][0].rate_Hz
    slid_s = sum(states.seconds(InteractionState.SLIDING) for _, states in parts)
    if slid_s < DURATION_MIN_S:
        _pieces(parts)  # where nothing slides at all, it says why
        raise _NoTexture(f"the tool slides for {slid_s:.2f} s: at least {DURATION_MIN_S:g} s are needed")
    if options.order == "auto":
        search = search_domain(_slid(parts), rate, options.domain)
        order, noise, warp = search.chosen, search.noise, search.warp
    else:
        order, noise, warp = int(options.order), None, warp_at(rate) if options.domain == "warped" else 0.0
    pieces = _pieces(parts)
    model_count = options.model_count
    if model_count == "auto":
        model_count = choose_model_count(pieces, rate, order, noise, warp)
    elif not (isinstance(model_count, Integral) and 1 <= model_count <= len(pieces)):
        raise CaptureError(f'model_count must be "auto" or a whole number from 1 to {len(pieces)}, is {model_count!r}')
    model_count, law = int(model_count), fit_level(pieces)
    ends = zip(law.exponents - 1.96 * law.spread, law.exponents + 1.96 * law.spread, strict=True)
    intervals = {f"texture.exponents[{i}]": (float(low), float(high)) for i, (low, high) in enumerate(ends)}

    texture = fit_texture(pieces, rate, order, model_count, options.interpolation, noise, warp)
    slid = [(c, run) for c, states in parts for run in states.runs(InteractionState.SLIDING)]
    found = fit_life(texture, [part_of(channels, slice(*run)) for channels, run in slid])
    if found.life is None:
        return texture, intervals, {"texture.life": found.reason}
    names = [*(f"texture.life.spread[{i}]" for i in range(len(found.life.spread))), "texture.life.log_spread"]
    intervals |= zip(names, found.intervals, strict=True)
    return replace(texture, modulation=found.life), intervals, {}


def _slid(parts: Sequence[Part]) -> Array:
    """The acceleration of all that slides."""
    slid = [(c.acceleration_m_s2, run) for c, states in parts for run in states.runs(InteractionState.SLIDING)]
    found = [acceleration[slice(*run)] for acceleration, run in slid]
    return found[0] if len(found) == 1 else np.concatenate(found)


def _pieces(parts: Sequence[Part]) -> Pieces:
    """The texture's pieces of all recordings; one in which nothing slides has none."""
    found, reason = [], "there is no recording"
    for channels, states in parts:
        runs = states.stationary()
        lengths = [end - start for start, end in runs]
        if not runs or np.median(lengths) < STATIONARY_PIECES * PIECE_S * channels.rate_Hz:
            runs = states.runs(InteractionState.SLIDING)
        try:
            found.append(cut(channels, runs))
        except CaptureError as error:
            reason = str(error)
    if not found:
        raise _NoTexture(no_sliding(parts) or reason)
    return pooled(found)
