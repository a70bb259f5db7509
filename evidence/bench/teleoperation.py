"""The teleoperation experiment of the haptography paper (Section 4, Teleoperation Testing), in simulation.

A follower Omni touches a plate with a swatch; a leader Omni, held by a hand, is coupled to it. The desired acceleration
is that of the follower's accelerometer. The rendered acceleration is that of the leader's tip, produced by the base
motors alone or by the base motors and the handle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.message import SAMPLE_COUNT
from hapscene.teleoperation.operation import Operation, OperationResult
from hapscene.teleoperation.plate import START_M, Gesture, explore, plate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rendering:
    """Desired and rendered acceleration of a run.

    Attributes:
        compensator: compensator of the handle; "none" for the base motors alone.
        desired_m_s2, rendered_m_s2: accelerations (n,) at 10 kHz, aligned in time.
        latency_s: latency from the follower to the leader's handle.
        errors: spectrogram error by part ("all", "tap", "stroke"), relative to the desired spectrogram.
    """

    compensator: str
    desired_m_s2: Array
    rendered_m_s2: Array
    latency_s: float
    errors: dict[str, float]


def compare_handles(
    swatch: str | Swatch,
    compensators: tuple[str, ...],
    grip: str = DEFAULT_GRIP,
    seed: int = 0,
    taps: int = 3,
    strokes: int = 4,
) -> list[Rendering]:
    """Run the experiment for each compensator: taps, a press, strokes, without delay of the line."""
    coupling = Coupling("position")
    gesture = explore(grip, coupling.stiffness_N_m, taps, strokes)
    return [_render(swatch, compensator, coupling, gesture, seed) for compensator in compensators]


def _render(swatch: str | Swatch, compensator: str, coupling: Coupling, gesture: Gesture, seed: int) -> Rendering:
    operation = Operation(plate(swatch), START_M, coupling=coupling, compensator=compensator, seed=seed)
    operated = operation.run(gesture.intent)
    desired, rendered = align(operated)
    errors = {"all": spectrogram_error(desired, rendered, ACCELERATION_RATE_HZ)}
    for part, spans in gesture.parts.items():
        within = _within(spans, len(desired))
        errors[part] = spectrogram_error(desired[within], rendered[within], ACCELERATION_RATE_HZ)
    return Rendering(compensator, desired, rendered, operated.latency_s, errors)


def align(operated: OperationResult) -> tuple[Array, Array]:
    """Return desired and rendered acceleration (n,), the rendered one advanced by the latency."""
    delay = round(operated.latency_s * ACCELERATION_RATE_HZ)
    desired = operated.a_follower_m_s2.ravel()
    rendered = (operated.a_tip_m_s2 + operated.a_handle_m_s2).ravel()
    return desired[: len(desired) - delay], rendered[delay:]


def _within(spans: list[tuple[int, int]], count: int) -> NDArray[np.bool_]:
    """Return which of `count` samples lie in spans of ticks."""
    within = np.zeros(count, bool)
    for first, last in spans:
        within[first * SAMPLE_COUNT : last * SAMPLE_COUNT] = True
    return within
