"""Fig. 8: two taps and five drags on wood, felt through a leader: how far what is felt is from what was measured."""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.constants import ACCELERATION_BAND_HZ, ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.compensator import COMPENSATORS
from hapscene.view.palette import INK

from ..bench.teleoperation import Rendering, compare_handles
from .finding import (
    COLOURS,
    PUBLISHED,
    REMEMBERED,
    Finding,
    Number,
    Plot,
    drawn,
    spectrogram_panels,
    trace_panels,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TAPS, DRAGS = 2, 5
"""Taps and drags of the paper's experiment on wood [count]."""

PAPER_ERROR: Final = 48.0
"""Spectrogram error that the paper's handle left [%]."""

PARTS: Final = {"all": "all of it", "tap": "taps", "stroke": "drags"}

LIKE_PAPER: Final = "inverse"
"""The compensator that the paper's handle had: the inverse of the approximate model."""

LOW_HZ: Final = 60.0
"""Below it hands and base motors move [Hz]; what the handle does is seen above."""


def remote_numbers(renderings: list[Rendering]) -> list[Number]:
    """Errors of what is felt [%]: silence, base motors alone, then with each compensator of the handle."""

    def error(rendering: Rendering, felt: float = 1.0, low_Hz: float = ACCELERATION_BAND_HZ[0]) -> float:
        pair, band_Hz = (rendering.desired_m_s2, felt * rendering.rendered_m_s2), (low_Hz, ACCELERATION_BAND_HZ[1])
        return 100.0 * spectrogram_error(*pair, ACCELERATION_RATE_HZ, band_Hz=band_Hz)

    silence = Number("error of no output", error(renderings[0], 0.0), "%", 100.0, PUBLISHED, "so by the measure")
    numbers = [Number("taps", TAPS, "1", 2, REMEMBERED), Number("drags", DRAGS, "1", 5, REMEMBERED), silence]
    why = "ours is simulated, and its compensator knows it; a real one is known less well"
    for rendering in renderings:
        for part, words in PARTS.items():
            what, value = f"error, {_name(rendering)}, {words}", 100.0 * rendering.errors[part]
            paper = (PAPER_ERROR, PUBLISHED, why) if (rendering.compensator, part) == (LIKE_PAPER, "all") else ()
            numbers.append(Number(what, value, "%", *paper))
        if rendering.compensator == LIKE_PAPER:
            above = error(rendering, low_Hz=LOW_HZ)
            numbers.append(Number(f"error, {_name(rendering)}, above {LOW_HZ:g} Hz", above, "%"))
    return numbers


def _name(rendering: Rendering) -> str:
    return "base motors alone" if rendering.compensator == "none" else f"handle, {rendering.compensator}"


def felt_through_a_leader() -> Finding:
    """Fig. 8."""
    renderings = compare_handles("wood", tuple(COMPENSATORS), DEFAULT_GRIP, taps=TAPS, strokes=DRAGS)
    count = min(len(rendering.desired_m_s2) for rendering in renderings)
    signals = {"the follower's accelerometer": renderings[0].desired_m_s2[:count]}
    for rendering in renderings:
        if rendering.compensator in ("none", LIKE_PAPER, "adaptive"):
            title = f"{_name(rendering)}: error {100.0 * rendering.errors['all']:.0f} %"
            signals[title] = rendering.rendered_m_s2[:count]

    def draw(axes: "Axes") -> None:
        at = np.arange(len(renderings))
        for k, (part, words) in enumerate(PARTS.items()):
            errors = [100.0 * rendering.errors[part] for rendering in renderings]
            axes.bar(at + 0.27 * (k - 1), errors, 0.25, color=COLOURS[k], label=words)
        axes.axhline(PAPER_ERROR, color=INK, linewidth=1.0, linestyle=(0, (4, 3)), label="the paper's handle, 48 %")
        axes.set_xticks(
            at, [_name(rendering).split(", ")[-1].replace(" motors alone", "\nmotors") for rendering in renderings]
        )
        axes.set(ylabel="spectrogram error [%]", ylim=(0.0, 105.0))
        axes.grid(visible=False, axis="x")

    told = "What the follower's accelerometer read, and what the leader's hand felt."
    t_s = np.arange(count) / ACCELERATION_RATE_HZ
    plots = [
        Plot("In time", told, trace_panels("fig8-time", t_s, signals, "[m/s²]")),
        Plot("In spectrogram", "", spectrogram_panels("fig8-spectrogram", signals, ACCELERATION_RATE_HZ)),
        Plot("Error by compensator", "", drawn("fig8-error", draw, 3.0)),
    ]
    text = (
        f"Simulated: a leader Omni in a hand of {DEFAULT_GRIP} grip, a follower Omni on a plate of the shipped swatch "
        "of wood, a line without delay. What is left lies mostly below 60 Hz, where hands and base motors move."
    )
    return Finding("Fig. 8: felt through a leader", text, remote_numbers(renderings), plots)
