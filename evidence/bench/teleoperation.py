"""The haptography paper's teleoperation experiment, in simulation.

A follower Omni touches a surface (a swatch that was fitted to a recording); a leader Omni, held by a hand, is tied to
it. What its accelerometer reads is what the hand should feel; what the hand feels is the acceleration of the leader's
tip, by the base motors alone, or by them and the handle. After Kuchenbecker, Romano & McMahan, "Haptography".
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.datagram import SAMPLE_COUNT
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.operation import OperationResult, Operation
from hapscene.teleoperation.plate import START_M, Gesture, explore, plate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a leader's hand felt of what the follower's accelerometer read.

    Attributes:
        compensator: of the handle; "none" for the base motors alone.
        desired_m_s2, rendered_m_s2: (n,) at 10 kHz, the latency taken out.
        latency_s: from the follower to the leader's handle.
        errors: spectrogram error by part: "all", "tap", "stroke"; 1.0 is that of silence.
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
    """The experiment once for each compensator: taps, a press, strokes, over a line without delay."""
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
    """Desired and rendered acceleration (n,), the rendered one moved back by the latency."""
    late = round(operated.latency_s * ACCELERATION_RATE_HZ)
    desired = operated.a_follower_m_s2.ravel()
    rendered = (operated.a_tip_m_s2 + operated.a_handle_m_s2).ravel()
    return desired[: len(desired) - late], rendered[late:]


def _within(spans: list[tuple[int, int]], count: int) -> NDArray[np.bool_]:
    """(count,) which samples lie in spans of ticks."""
    within = np.zeros(count, bool)
    for first, last in spans:
        within[first * SAMPLE_COUNT : last * SAMPLE_COUNT] = True
    return within
