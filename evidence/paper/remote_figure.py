"""Fig. 8: two taps and five drags on wood by teleoperation, and the error of the acceleration that the hand receives.

The paper's reference, 100 %, is the error with the base motors alone. Errors here are relative to the same reference.
"""

from typing import Final

import numpy as np

from hapscene.constants import ACCELERATION_BAND_HZ, ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.compensator import COMPENSATORS

from ..bench.teleoperation import Rendering, compare_handles
from .result import SETTING, FigureResult, Number, Plot, spectrogram_panels, trace_panels

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


def errors_of(rendering: Rendering) -> dict[str, float]:
    """Return the spectrogram errors of a run [% of the desired signal] by part, and above `LOW_HZ`."""
    pair, band_Hz = (rendering.desired_m_s2, rendering.rendered_m_s2), (LOW_HZ, ACCELERATION_BAND_HZ[1])
    above = spectrogram_error(*pair, ACCELERATION_RATE_HZ, band_Hz=band_Hz)
    return {part: 100.0 * error for part, error in {**rendering.errors, ABOVE: above}.items()}


def remote_numbers(renderings: list[Rendering]) -> list[Number]:
    """Return the errors with each compensator, relative to the base motors alone, which are the first rendering."""
    base, *rest = [(rendering.compensator, errors_of(rendering)) for rendering in renderings]
    note = f"the reference: {base[1]['all']:.1f} % of the desired spectrogram; both Omnis and the hand are simulated"
    numbers = [
        Number("taps", TAPS, "1", 2, PLACE, SETTING),
        Number("drags", DRAGS, "1", 5, PLACE, SETTING),
        Number("error with the base motors alone", 100.0, "%", 100.0, PLACE, note),
    ]
    for compensator, errors in rest:
        relative = {part: 100.0 * errors[part] / base[1][part] for part in errors}
        what = f"error with the handle, compensator {compensator}"
        if compensator == LIKE_PAPER:
            note = f"{errors['all']:.1f} % of the desired spectrogram; handle and latency are known exactly"
            numbers.append(Number(what, relative["all"], "%", PAPER_ERROR, PLACE, note))
            numbers.append(Number(f"{what}, above {LOW_HZ:g} Hz", relative[ABOVE], "%"))
        else:
            numbers.append(Number(what, relative["all"], "%"))
        numbers += [Number(f"{what}, {words}", relative[part], "%") for part, words in list(PARTS.items())[1:]]
    return numbers


def teleoperated_wood() -> FigureResult:
    """Reproduce Fig. 8."""
    renderings = compare_handles("wood", tuple(COMPENSATORS), DEFAULT_GRIP, taps=TAPS, strokes=DRAGS)
    numbers, base = remote_numbers(renderings), errors_of(renderings[0])
    count = min(len(rendering.desired_m_s2) for rendering in renderings)
    signals = {"desired: accelerometer of the follower": renderings[0].desired_m_s2[:count]}
    names = {"none": "base motors", LIKE_PAPER: f"handle, {LIKE_PAPER}", "adaptive": "handle, adaptive"}
    for rendering in renderings:
        if name := names.get(rendering.compensator):
            relative = 100.0 * errors_of(rendering)["all"] / base["all"]
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
