"""What the twin's hand felt: the recording of the ticks, and beside it what no encoder sees."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording

__all__ = ["FELT", "Feel", "summarise_feel"]

REST_S: Final = 0.3
"""End of a gesture in which the tool is expected to be at rest [s]."""

FELT: Final = np.dtype(
    [
        ("read_W_m", "f8", (3,)),  # tool, as the tick was given it
        ("p_W_m", "f8", (3,)),  # tool, true
        ("v_W_m_s", "f8", (3,)),
        ("f_motor_W_N", "f8", (3,)),  # held over the tick: what was asked for `delay_ticks` ago
        ("f_hand_W_N", "f8", (3,)),  # of the hand on the tool, at the tick's start
        ("work_J", "f8"),  # of the motors on the tool in the tick
        ("f_coil_N", "f8"),  # largest force of the handle's actuator in the tick
        ("heat", "f8"),  # of the warmest motor, 1 where it can only give its continuous torque
        ("trouble", "i8"),  # bits of the device's own flags
    ],
    align=True,
)


@dataclass(frozen=True, eq=False)
class Feel:
    """n ticks of a closed loop.

    Attributes:
        recording: of the ticks: what the renderer saw through the encoders, and what it asked for.
        p_W_m: (n, 3) the tool, truly, at the start of each tick.
        v_W_m_s: (n, 3) its velocity.
        target_W_m: (n, 3) where the hand meant it to be.
        f_motor_W_N: (n, 3) force of the motors, held over the tick.
        f_hand_W_N: (n, 3) force of the hand on the tool at the tick's start.
        work_J: (n,) work of the motors on the tool in each tick. Over a contact it is at most 0 in a passive world;
            what it sums up to is the energy that the rendering gave out of nothing.
        a_handle_m_s2: (n, block) acceleration of the handle along its axis, as its actuator makes it.
        latency_s: how much later than `recording.a_m_s2` the handle plays it.
        f_coil_N: (n,) largest force of the handle's actuator in each tick.
        heat: (n,) warmth of the warmest motor, 1 where it can only give its continuous torque.
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
        return f"<Feel: {len(self):,} ticks in closed loop; motors gave {self.work_J.sum():.3g} J; {self.recording!r}>"

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def rest_m_s(self) -> float:
        """Root mean square of the tool's speed in the last `REST_S`: what still moves there buzzes."""
        last = self.v_W_m_s[self.recording.t_s > self.recording.t_s[-1] - REST_S]
        return float(np.sqrt((last**2).sum(axis=1).mean()))

    def save(self, path: str | Path) -> None:
        """Write all but the recording, which has a file of its own, as npz.

        Raises:
            OSError: the folder is missing or cannot be written.
        """
        arrays: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "recording"}
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(file, t_s=self.recording.t_s, format_version=1, **arrays)


def summarise_feel(feel: Feel) -> dict[str, float | None]:
    """The figures of a closed loop that are looked at first."""
    from hapscene.dsp.spectrogram import spectrogram_error

    desired, played = feel.recording.a_m_s2.ravel(), feel.a_handle_m_s2.ravel()
    late = round(feel.latency_s * feel.recording.a_rate_Hz)
    desired, played = desired[: len(desired) - late], played[late:]
    sounds = bool(np.any(desired)) and feel.recording.a_rate_Hz >= 2.0 * ACCELERATION_BAND_HZ[1]
    return {
        "force_motor_max_N": float(np.linalg.norm(feel.f_motor_W_N, axis=1).max(initial=0.0)),
        "force_coil_max_N": float(feel.f_coil_N.max(initial=0.0)),
        "work_of_motors_mJ": float(feel.work_J.sum() * 1e3),
        "speed_at_rest_mm_s": feel.rest_m_s * 1e3,
        "motor_warmth_max": float(feel.heat.max(initial=0.0)),
        "handle_spectrogram_error": spectrogram_error(desired, played, feel.recording.a_rate_Hz) if sounds else None,
        "handle_latency_s": feel.latency_s,
    }
