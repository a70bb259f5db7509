"""What the twin's hand felt: the recording of the ticks, and beside it what no encoder sees."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.recording import Recording

FELT: Final = np.dtype(
    [
        ("p_W_m", "f8", (3,)),  # tool, true
        ("v_W_m_s", "f8", (3,)),
        ("f_motor_W_N", "f8", (3,)),  # held over the tick: what was asked for `delay_ticks` ago
        ("f_hand_W_N", "f8", (3,)),  # of the hand on the tool, at the tick's start
        ("work_J", "f8"),  # of the motors on the tool in the tick
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
    """

    recording: Recording
    p_W_m: NDArray[np.float64]
    v_W_m_s: NDArray[np.float64]
    target_W_m: NDArray[np.float64]
    f_motor_W_N: NDArray[np.float64]
    f_hand_W_N: NDArray[np.float64]
    work_J: NDArray[np.float64]
    a_handle_m_s2: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.recording)
