"""Fig. 8: two taps and five drags on wood, felt through a leader: how far what is felt is from what was measured."""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.capture.report_plots import Plot, drawn
from hapscene.constants import ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.compensator import COMPENSATORS
from hapscene.teleoperation.experiment import Rendering, compare_handles
from hapscene_benchmarks.handle import DRAGS, TAPS

from .finding import COLOURS, PUBLISHED, REMEMBERED, UNKNOWN, Finding, Number, spectrogram_panels, trace_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_ERROR: Final = 48.0
"""Spectrogram error that the paper's handle left [%]."""

PARTS: Final = {"all": "all of it", "tap": "taps", "stroke": "drags"}

SHOWN: Final = ("none", "inverse", "adaptive")
"""Compensators whose signals are drawn; of all of them the errors are."""

LIKE_PAPER: Final = "inverse"
"""The compensator that the paper's handle had: the inverse of the approximate model."""


def silence_error(renderings: list[Rendering]) -> float:
    """Spectrogram error of no output at all [1]."""
    desired = renderings[0].desired_m_s2
    return spectrogram_error(desired, np.zeros_like(desired), ACCELERATION_RATE_HZ)


def remote_numbers(renderings: list[Rendering]) -> list[Number]:
    """Errors of what is felt [%]: silence, base motors alone, then with each compensator of the handle."""
    numbers = [
        Number("taps", TAPS, "1", 2, REMEMBERED),
        Number("drags", DRAGS, "1", 5, REMEMBERED),
        Number("error of no output", 100.0 * silence_error(renderings), "%", 100.0, PUBLISHED, "so by the measure"),
    ]
    for rendering in renderings:
        name = rendering.compensator
        who = "base motors alone" if name == "none" else f"handle, {name}"
        paper = PAPER_ERROR if name == LIKE_PAPER else None
        for part, words in PARTS.items():
            why = "ours is simulated, and its compensator knows it; a real one is known less well"
            fits = part == "all" and paper is not None
            numbers.append(
                Number(
                    f"error, {who}, {words}", 100.0 * rendering.errors[part], "%",
                    paper if fits else None, PUBLISHED if fits else UNKNOWN, why if fits else "",
                )
            )  # fmt: skip
    return numbers


def felt_through_a_leader() -> Finding:
    """Fig. 8."""
    renderings = compare_handles("wood", tuple(COMPENSATORS), DEFAULT_GRIP, taps=TAPS, strokes=DRAGS)
    signals = {"the follower's accelerometer": renderings[0].desired_m_s2}
    for rendering in renderings:
        if rendering.compensator in SHOWN:
            who = "base motors alone" if rendering.compensator == "none" else f"handle, {rendering.compensator}"
            signals[f"{who}: error {100.0 * rendering.errors['all']:.0f} %"] = rendering.rendered_m_s2
    count = min(map(len, signals.values()))
    signals = {name: signal[:count] for name, signal in signals.items()}

    def draw(axes: "Axes") -> None:
        names = [rendering.compensator for rendering in renderings]
        for k, (part, words) in enumerate(PARTS.items()):
            errors = [100.0 * rendering.errors[part] for rendering in renderings]
            axes.bar(np.arange(len(names)) + 0.27 * (k - 1), errors, 0.25, color=COLOURS[k], label=words)
        axes.axhline(
            PAPER_ERROR, color="#222222", linewidth=1.0, linestyle=(0, (4, 3)), label="the paper's handle, 48 %"
        )
        axes.set_xticks(range(len(names)), ["base\nmotors" if name == "none" else name for name in names])
        axes.set(ylabel="spectrogram error [%]", ylim=(0.0, 105.0))
        axes.grid(visible=False, axis="x")

    t_s = np.arange(count) / ACCELERATION_RATE_HZ
    told = "what the follower's accelerometer read, and what the leader's hand felt"
    plots = (
        Plot("In time", f"{told[0].upper()}{told[1:]}.", trace_panels("fig8-time", t_s, signals, "[m/s²]"), told),
        Plot("In spectrogram", "", spectrogram_panels("fig8-spectrogram", signals, ACCELERATION_RATE_HZ), told),
        Plot("Error by compensator", "", drawn("fig8-error", draw, 3.0), "Bars of the errors of each compensator."),
    )
    text = (
        "Simulated: a leader Omni in a hand of medium grip, a follower Omni on a plate of the shipped swatch of wood, "
        "a line without delay. An error of 100 % is that of no output. The drags come through nearly whole; what "
        "is left is the taps, whose low frequencies ask for more stroke than a coil has."
    )
    return Finding("Fig. 8: felt through a leader", text, tuple(remote_numbers(renderings)), plots)
