"""The result of a closed loop: the recording of its ticks, and the true state that no encoder measures."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording

__all__ = ["LOOP_ROW", "ClosedLoopResult", "summarise_result"]

REST_S: Final = 0.3
"""Final part of a gesture in which the tool is expected to be at rest [s]."""

LOOP_ROW: Final = np.dtype(
    [
        ("read_W_m", "f8", (3,)),  # device position that the tick received
        ("p_W_m", "f8", (3,)),  # true position
        ("v_W_m_s", "f8", (3,)),
        ("f_motor_W_N", "f8", (3,)),  # motor force held over the tick, computed `delay_ticks` earlier
        ("f_hand_W_N", "f8", (3,)),  # force of the hand on the tool at the start of the tick
        ("work_J", "f8"),  # work of the motors on the tool in the tick
        ("f_coil_N", "f8"),  # largest force of the actuator of the handle in the tick
        ("heat", "f8"),  # load of the warmest motor, 1 when it is limited to its continuous torque
        ("trouble", "i8"),  # flags of the device
        ("R_WT", "f8", (3, 3)),  # orientation that the tick received; zeros for a simulated device, which has none
    ],
    align=True,
)


@dataclass(frozen=True, eq=False)
class ClosedLoopResult:
    """n ticks of a closed loop.

    Attributes:
        recording: recording of the ticks: what the renderer measured and computed.
        p_W_m: (n, 3) true position of the tool at the start of each tick.
        v_W_m_s: (n, 3) true velocity of the tool.
        target_W_m: (n, 3) target position of the hand.
        f_motor_W_N: (n, 3) motor force held over the tick.
        f_hand_W_N: (n, 3) force of the hand on the tool at the start of the tick.
        work_J: (n,) work of the motors on the tool in each tick. Its sum over a contact is at most 0 if the rendering
            is passive; a positive sum is energy that the rendering generated.
        a_handle_m_s2: (n, block) acceleration of the handle along its axis.
        latency_s: delay of the handle behind `recording.a_m_s2`.
        f_coil_N: (n,) largest force of the actuator of the handle in each tick.
        heat: (n,) load of the warmest motor, 1 when it is limited to its continuous torque.
        trouble: (n,) bits of `hapscene.device.sim.omni_record.OmniFlag`.
    """

    recording: Recording
    p_W_m: NDArray[np.float64]
    v_W_m_s: NDArray[np.float64]
    target_W_m: NDArray[np.float64]
    f_motor_W_N: NDArray[np.float64]
    f_hand_W_N: NDArray[np.float64]
    work_J: NDArray[np.float64]
    a_handle_m_s2: NDArray[np.float64]
    latency_s: float
    f_coil_N: NDArray[np.float64]
    heat: NDArray[np.float64]
    trouble: NDArray[np.int64]

    def __repr__(self) -> str:
        work_J = self.work_J.sum()
        return f"<ClosedLoopResult: {len(self):,} ticks, work of motors {work_J:.3g} J; {self.recording!r}>"

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def rest_m_s(self) -> float:
        """Root mean square of the tool's speed in the last `REST_S`; a residual speed is vibration."""
        last = self.v_W_m_s[self.recording.t_s > self.recording.t_s[-1] - REST_S]
        return float(np.sqrt((last**2).sum(axis=1).mean()))

    def save(self, path: str | Path) -> None:
        """Write all fields but the recording, which has a separate file, as npz.

        Raises:
            OSError: the folder is missing or cannot be written.
        """
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "recording"}
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(file, t_s=self.recording.t_s, format_version=1, **arrays)


def summarise_result(result: ClosedLoopResult) -> dict[str, float | None]:
    """Return the key figures of a closed loop."""
    from hapscene.dsp.spectrogram import spectrogram_error

    desired, played = result.recording.a_m_s2.ravel(), result.a_handle_m_s2.ravel()
    late = round(result.latency_s * result.recording.a_rate_Hz)
    desired, played = desired[: len(desired) - late], played[late:]
    sounds = bool(np.any(desired)) and result.recording.a_rate_Hz >= 2.0 * ACCELERATION_BAND_HZ[1]
    return {
        "force_motor_max_N": float(np.linalg.norm(result.f_motor_W_N, axis=1).max(initial=0.0)),
        "force_coil_max_N": float(result.f_coil_N.max(initial=0.0)),
        "work_of_motors_mJ": float(result.work_J.sum() * 1e3),
        "speed_at_rest_mm_s": result.rest_m_s * 1e3,
        "motor_warmth_max": float(result.heat.max(initial=0.0)),
        "handle_spectrogram_error": spectrogram_error(desired, played, result.recording.a_rate_Hz) if sounds else None,
        "handle_latency_s": result.latency_s,
    }
