"""Fig. 8: two taps and five drags on wood by teleoperation, and the error of the acceleration that the hand receives.

A follower Omni touches a plate with a swatch; a leader Omni, held by a hand, is coupled to it. The desired acceleration
is that of the follower's accelerometer. The rendered one is that of the leader's tip, made by the base motors alone or
with the handle. The paper's reference, 100 %, is the error with the base motors alone. Errors here are relative to the
same reference.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hapscene.constants import ACCELERATION_BAND_HZ, ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.compensator import COMPENSATORS
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.jitter_buffer import SAMPLE_COUNT
from hapscene.teleoperation.operation import Operation, OperationResult
from hapscene.teleoperation.plate import START_M, explore, plate

from .result import SETTING, Array, FigureResult, Number, Plot, spectrogram_panels, trace_panels

TAPS, DRAGS = 2, 5
"""Taps and drags of the paper's experiment [count]."""

PAPER_ERROR: Final = 48.0
"""Spectrogram error with the paper's handle [%], that of the base motors alone being 100 %."""

PLACE: Final = "Section 4, Teleoperation Testing"

PARTS: Final = {"all": "whole run", "tap": "taps", "stroke": "drags"}

LIKE_PAPER: Final = "inverse"
"""The compensator of the paper's handle: the inverse of the approximate model."""

LOW_HZ: Final = 60.0
"""Frequency [Hz] below which mostly the hand and the base motors move the handle."""

ABOVE: Final = "above"


@dataclass(frozen=True, eq=False)
class Rendering:
    """Desired and rendered acceleration of a run.

    Attributes:
        compensator: compensator of the handle; "none" for the base motors alone.
        desired_m_s2, rendered_m_s2: accelerations (n,) at 10 kHz, aligned in time.
        errors: spectrogram error by part ("all", "tap", "stroke"), and above `LOW_HZ` [% of the desired signal].
    """

    compensator: str
    desired_m_s2: Array
    rendered_m_s2: Array
    errors: dict[str, float]


def compare_handles(
    compensators: tuple[str, ...], grip: str = DEFAULT_GRIP, taps: int = TAPS, strokes: int = DRAGS
) -> list[Rendering]:
    """Run the experiment on wood for each compensator: taps, a press, strokes, without delay of the line."""
    coupling, band_Hz, renderings = Coupling("position"), (LOW_HZ, ACCELERATION_BAND_HZ[1]), []
    gesture = explore(grip, coupling.stiffness_N_m, taps, strokes)
    for compensator in compensators:
        operated = Operation(plate("wood"), START_M, coupling=coupling, compensator=compensator).run(gesture.intent)
        desired, rendered = align(operated)
        errors = {"all": spectrogram_error(desired, rendered, ACCELERATION_RATE_HZ)}
        for part, spans in gesture.parts.items():
            within = np.zeros(len(desired), bool)
            for first, last in spans:
                within[first * SAMPLE_COUNT : last * SAMPLE_COUNT] = True
            errors[part] = spectrogram_error(desired[within], rendered[within], ACCELERATION_RATE_HZ)
        errors[ABOVE] = spectrogram_error(desired, rendered, ACCELERATION_RATE_HZ, band_Hz=band_Hz)
        percent = {part: 100.0 * error for part, error in errors.items()}
        renderings.append(Rendering(compensator, desired, rendered, percent))
    return renderings


def align(operated: OperationResult) -> tuple[Array, Array]:
    """Return desired and rendered acceleration (n,), the rendered one advanced by the latency."""
    delay = round(operated.latency_s * ACCELERATION_RATE_HZ)
    desired = operated.a_follower_m_s2.ravel()
    rendered = (operated.a_tip_m_s2 + operated.a_handle_m_s2).ravel()
    return desired[: len(desired) - delay], rendered[delay:]


def remote_numbers(renderings: list[Rendering]) -> list[Number]:
    """Return the errors with each compensator, relative to the base motors alone, which are the first rendering."""
    base, *rest = renderings
    note = (
        f"the reference: {base.errors['all']:.1f} % of the desired spectrogram; both Omnis and the hand are simulated"
    )
    numbers = [
        Number("taps", TAPS, "1", 2, PLACE, SETTING),
        Number("drags", DRAGS, "1", 5, PLACE, SETTING),
        Number("error with the base motors alone", 100.0, "%", 100.0, PLACE, note),
    ]
    for one in rest:
        relative = {part: 100.0 * error / base.errors[part] for part, error in one.errors.items()}
        what = f"error with the handle, compensator {one.compensator}"
        if one.compensator == LIKE_PAPER:
            note = f"{one.errors['all']:.1f} % of the desired spectrogram; handle and latency are known exactly"
            numbers.append(Number(what, relative["all"], "%", PAPER_ERROR, PLACE, note))
            numbers.append(Number(f"{what}, above {LOW_HZ:g} Hz", relative[ABOVE], "%"))
        else:
            numbers.append(Number(what, relative["all"], "%"))
        numbers += [Number(f"{what}, {words}", relative[part], "%") for part, words in list(PARTS.items())[1:]]
    return numbers


def teleoperated_wood() -> FigureResult:
    """Reproduce Fig. 8."""
    renderings = compare_handles(tuple(COMPENSATORS))
    numbers, base = remote_numbers(renderings), renderings[0].errors
    count = min(len(rendering.desired_m_s2) for rendering in renderings)
    signals = {"desired: accelerometer of the follower": renderings[0].desired_m_s2[:count]}
    names = {"none": "base motors", LIKE_PAPER: f"handle, {LIKE_PAPER}", "adaptive": "handle, adaptive"}
    for rendering in renderings:
        if name := names.get(rendering.compensator):
            relative = 100.0 * rendering.errors["all"] / base["all"]
            signals[f"{name}: error {relative:.0f} %"] = rendering.rendered_m_s2[:count]

    t_s = np.arange(count) / ACCELERATION_RATE_HZ
    caption = "Acceleration of the follower's tool, and of the leader's handle."
    plots = [
        Plot("Time domain", caption, trace_panels("fig8-time", t_s, signals, "[m/s²]")),
        Plot("Spectrograms", caption, spectrogram_panels("fig8-spectrogram", signals, ACCELERATION_RATE_HZ)),
    ]
    text = (
        f"Simulated: a leader Omni in a hand with a {DEFAULT_GRIP} grip, and a follower Omni on a plate with the "
        "shipped swatch of wood, coupled position to position without delay. The paper uses unfinished plywood. Here "
        "a press lies between taps and drags. Hand and base motors move the handle below 60 Hz, where most of the "
        "remaining error lies."
    )
    return FigureResult("Fig. 8: teleoperation", text, numbers, plots)
