"""A swatch from recordings of a tool on a surface: the main entry of `hapscene.capture`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from hapscene.capture.contact_fit import fit_contact
from hapscene.capture.friction import fit_friction, no_sliding
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import (
    ASSUMED_FORCE_N,
    ASSUMED_SPEED_M_S,
    DURATION_MIN_S,
    Array,
    clean,
    part_of,
)
from hapscene.capture.life_fit import fit_life
from hapscene.capture.order_search import DOMAINS, search_domain
from hapscene.capture.segment import InteractionState, Part, segment
from hapscene.capture.stiffness import fit_stiffness
from hapscene.capture.tap_fit import fit_taps
from hapscene.capture.texture_fit import choose_model_count, fit_texture
from hapscene.capture.texture_pieces import PIECE_S, Pieces, cut, fit_level, pooled
from hapscene.constants import ORDER_MAX
from hapscene.dsp.warped_prediction import warp_at
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

STATIONARY_PIECES: Final = 5.0
"""Median length of the stationary stretches, in pieces of `PIECE_S`, from which the texture's pieces are cut at their
borders [1]. Of shorter ones too much is left over: of the project's recordings of two seconds a fifth, and the
likelihood of the other half fell by 0.003 a sample."""


def fit(
    acceleration_m_s2: ArrayLike | SurfaceRecording,
    rate_Hz: float | None = None,
    *,
    force_N: ArrayLike | None = None,
    speed_m_s: ArrayLike | None = None,
    tangential_force_N: ArrayLike | None = None,
    name: str = "unnamed",
    order: int | Literal["auto"] = "auto",
    model_count: int | Literal["auto"] = "auto",
    interpolation: str = "lsf",
    depth_m: ArrayLike | None = None,
    domain: str = "auto",
    contact_angle_rad: ArrayLike | None = None,
    tool: str = "",
    tip: str = "",
) -> Swatch:
    """The swatch of a recording of a tool on a surface: `fit(load_recording("oak.csv", …))`, or of its streams.

    Args:
        acceleration_m_s2: a recording as `hapscene.capture.load_recording` gives it, which has the streams; or (n,)
            acceleration of the tool, one axis (of three `hapscene.capture.io.recording.one_axis` makes it).
        rate_Hz: sample rate of all streams; the models are made for it.
        force_N: (n,) normal force, zero in the air, one number, or None: then 1 N is assumed.
        speed_m_s: (n,) speed of the tool, one number, or None: then 0.1 m/s is assumed.
        tangential_force_N: (n,) tangential force, or None: then the swatch has no friction.
        name: of the swatch.
        order: of the AR models, or "auto": chosen on held-out data (`hapscene.capture.order_search`).
        model_count: models over force and speed, or "auto": as many as hold on held-out data.
        interpolation: how the texture blends its models, see `hapscene.surface.texture`.
        depth_m: (n,) depth into the surface, negative above it, or None: then the stiffness is the default.
        domain: frequency axis of the AR models: "plain"; "warped", finer where more is felt, at rates above 3 kHz
            (`hapscene.dsp.warped_prediction`); or "auto": the better one on held-out data, "plain" for an order given.
        contact_angle_rad: (n,) angle of the tool to the surface's normal, one number, or None; its range is noted.
        tool: what the tip was held by, as in "steel probe".
        tip: what touched the surface, as in "3.2 mm ball".

    Returns:
        A swatch with what the recording holds: texture where the tool slides, taps where it strikes, friction,
        stiffness; `intervals` has their 95 % intervals, `absent` says what is not there, and why.

    Raises:
        CaptureError: from such streams nothing can be fitted; the text says why.
    """
    if isinstance(acceleration_m_s2, SurfaceRecording):
        streams = (force_N, speed_m_s, tangential_force_N, depth_m, rate_Hz, contact_angle_rad)
        if any(stream is not None for stream in streams):
            raise CaptureError("a recording has its rate and its streams itself: fit(recording) takes no others")
        part = prepare(acceleration_m_s2)
    elif rate_Hz is None:
        raise CaptureError("rate_Hz is missing: rate_Hz must be a number, of the samples recorded in a second")
    else:
        channels = clean(
            acceleration_m_s2, rate_Hz, force_N, speed_m_s, tangential_force_N, depth_m,
            contact_angle_rad=contact_angle_rad,
        )  # fmt: skip
        part = channels, segment(channels)
    return fit_parts([part], name, order, model_count, interpolation, domain, tool, tip)


def prepare(recording: SurfaceRecording) -> Part:
    """A recording cleaned and cut into states.

    Raises:
        CaptureError: too short, silent, not finite, or streams of different length.
    """
    r = dict(vars(recording))
    del recording  # what the caller does not hold either is let go by `clean`
    channels = clean(
        r.pop("acceleration_m_s2"), r["rate_Hz"], r.pop("force_N"), r.pop("speed_m_s"), r.pop("tangential_force_N"),
        r.pop("depth_m"), torque_Nm=r.pop("torque_Nm"), grip_force_N=r.pop("grip_force_N"),
        contact_angle_rad=r.pop("contact_angle_rad"),
    )  # fmt: skip
    return channels, segment(channels)


def fit_parts(
    parts: Sequence[Part],
    name: str = "unnamed",
    order: int | Literal["auto"] = "auto",
    model_count: int | Literal["auto"] = "auto",
    interpolation: str = "lsf",
    domain: str = "auto",
    tool: str = "",
    tip: str = "",
) -> Swatch:
    """The swatch of recordings of one surface, pooled; as `fit`.

    Raises:
        CaptureError: recordings of different rates, or from which nothing can be fitted.
    """
    rates = {channels.rate_Hz for channels, _ in parts}
    if len(rates) != 1:
        said = ", ".join(f"{rate:g}" for rate in sorted(rates)) or "none"
        raise CaptureError(f"recordings of one surface must have one rate, these have {said} Hz: resample them")
    order, model_count = _whole(order), _whole(model_count)
    if order != "auto" and (type(order) is not int or not 1 <= order <= min(ORDER_MAX, PIECE_S * min(rates) / 2)):
        raise CaptureError(f'order must be "auto" or a whole number from 1 to {ORDER_MAX}, is {order!r}')
    if domain not in DOMAINS:
        raise CaptureError(f"domain must be one of {', '.join(DOMAINS)}, is {domain!r}")
    friction, taps, contact = fit_friction(parts), fit_taps(parts), fit_contact(parts)
    ranges = felt(parts)
    intervals = friction.intervals | taps.intervals | contact.intervals
    absent = friction.absent | taps.absent | contact.absent
    numbers: dict[str, Any] = dict(contact.numbers)
    if "stiffness_N_m" not in numbers:  # a spring that is damped is fitted with its damper
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
        texture, known, missing = _texture(parts, order, model_count, interpolation, domain)
        intervals, absent = intervals | known, absent | missing
    except CaptureError as error:
        wrong = type(model_count) is not str and not isinstance(error, _NoTexture)
        nothing = taps.taps is None and "stiffness_N_m" in absent and friction.dynamic == 0.0
        if wrong or nothing:
            raise
        absent["texture"] = str(error)
    return Swatch(
        name,
        **numbers,
        friction_static=friction.static,
        friction_dynamic=friction.dynamic,
        friction_stribeck_m_s=friction.stribeck_m_s,
        friction_viscous_s_m=friction.viscous_s_m,
        texture=texture,
        taps=taps.taps,
        leaving=contact.leaving,
        provenance=" ".join(filter(None, (friction.note, ranges and f"Recorded with {ranges}."))),
        tool=tool,
        tip=tip,
        intervals=intervals,
        absent=absent,
    )


def felt(parts: Sequence[Part]) -> str:
    """In which ranges the streams beside force and speed were while the tool slid, or at all; "" without any."""
    said = []
    for name, (word, scale, unit) in FELT.items():
        found = []
        for channels, states in parts:
            stream = getattr(channels, name)
            if stream is not None:
                runs = states.runs(InteractionState.SLIDING) or [(0, len(stream))]
                found += [scale * stream[slice(*run)] for run in runs]
        if found:
            low, high = np.quantile(np.concatenate(found), FELT_SHARES)
            ends = dict.fromkeys((f"{low:.3g}", f"{high:.3g}"))
            said.append(f"{word} {' to '.join(ends)} {unit}".replace(" °", "°"))
    return ", ".join(said)


FELT: Final = {
    "grip_force_N": ("grip force", 1.0, "N"),
    "contact_angle_rad": ("contact angle", 180.0 / np.pi, "°"),
    "torque_Nm": ("torque", 1e3, "mN·m"),
}
"""What is told of streams that nothing is fitted to: word, scale and unit."""

FELT_SHARES: Final = (0.05, 0.95)
"""Between which quantiles a range is told [1]."""


class _NoTexture(CaptureError):
    """The recordings hold no sliding to fit a texture to: the rest of the swatch may do without."""


def _texture(
    parts: Sequence[Part],
    order: int | Literal["auto"],
    model_count: int | Literal["auto"],
    interpolation: str,
    domain: str,
) -> tuple[Texture, dict[str, tuple[float, float]], dict[str, str]]:
    """The texture of all that slides, the 95 % intervals of what is in it, and what it lacks, by their names."""
    rate = parts[0][0].rate_Hz
    slid_s = sum(states.seconds(InteractionState.SLIDING) for _, states in parts)
    if slid_s < DURATION_MIN_S:
        _pieces(parts)  # where nothing slides at all, it says why
        raise _NoTexture(f"the tool slides for {slid_s:.2f} s: at least {DURATION_MIN_S:g} s are needed")
    noise, warp = None, warp_at(rate) if domain == "warped" else 0.0
    if order == "auto":
        search = search_domain(_slid(parts), rate, domain)
        order, noise, warp = search.chosen, search.noise, search.warp
    pieces = _pieces(parts)
    if model_count == "auto":
        model_count = choose_model_count(pieces, rate, order, noise, warp)
    elif type(model_count) is not int or not 1 <= model_count <= len(pieces):
        raise CaptureError(f'model_count must be "auto" or a whole number from 1 to {len(pieces)}, is {model_count!r}')
    law = fit_level(pieces)
    ends = zip(law.exponents - 1.96 * law.spread, law.exponents + 1.96 * law.spread, strict=True)
    intervals = {f"texture.exponents[{i}]": (float(low), float(high)) for i, (low, high) in enumerate(ends)}

    texture = fit_texture(pieces, rate, order, model_count, interpolation, noise, warp)
    slid = [(c, run) for c, states in parts for run in states.runs(InteractionState.SLIDING)]
    found = fit_life(texture, [part_of(channels, slice(*run)) for channels, run in slid])
    if found.life is None:
        return texture, intervals, {"texture.life": found.reason}
    names = [*(f"texture.life.spread[{i}]" for i in range(len(found.life.spread))), "texture.life.log_spread"]
    intervals |= zip(names, found.intervals, strict=True)
    return replace(texture, life=found.life), intervals, {}


def _slid(parts: Sequence[Part]) -> Array:
    """The acceleration of all that slides."""
    slid = [(c.acceleration_m_s2, run) for c, states in parts for run in states.runs(InteractionState.SLIDING)]
    found = [acceleration[slice(*run)] for acceleration, run in slid]
    return found[0] if len(found) == 1 else np.concatenate(found)


def _whole(value: Any) -> Any:
    """Whole numbers of NumPy as Python's own; all else as it is."""
    return int(value) if isinstance(value, np.integer) else value


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
