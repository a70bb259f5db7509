"""What a servo reports: the state of its newest tick, and a log of ticks."""

import math
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.device.driver import BUTTON_ROOM
from hapscene.flags import Flag, flag_of
from hapscene.records import ROW, Record, Records

__all__ = ["STOPS", "ButtonEvent", "Mode", "ServoState", "TickLog", "button_events_of", "state_of"]

_AT: Final = {name: int(place[1]) // 8 for name, place in dict(ROW.fields or {}).items()}
"""Offset of each field of a row, in numbers of 8 bytes."""

_VECTORS: Final = [(name, _AT[name]) for name in ("p_WT_m", "p_WP_m", "nhat_W", "f_W_N")]


class ServoState(NamedTuple):
    """The newest tick of a servo.

    Attributes:
        tick: number of the tick, from 0; −1 before the first.
        p_WT_m, p_WP_m, nhat_W, f_W_N: (3,) device position, proxy, normal and force on the hand.
        depth_m, slip_m_s: penetration depth and slip speed, as in `Recording`.
        touching: whether the device is inside a surface.
        body, face, swatch: indices of what is touched; −1 without contact.
        flags: errors and limits that were reached.
        age_s: time since the tick was complete, which grows during a pause; infinite before the first tick. If it is
            much longer than a tick while the servo runs, its process hangs or is stopped.
    """

    tick: int
    p_WT_m: NDArray[np.float64]
    p_WP_m: NDArray[np.float64]
    nhat_W: NDArray[np.float64]
    f_W_N: NDArray[np.float64]
    depth_m: float
    slip_m_s: float
    touching: bool
    body: int
    face: int
    swatch: int
    flags: Flag
    age_s: float = 0.0

    def __repr__(self) -> str:
        place, force = (", ".join(f"{v:.4g}" for v in vector) for vector in (self.p_WT_m, self.f_W_N))
        where = f"touching body {self.body}" if self.touching else "no contact"
        return f"<ServoState: tick {self.tick}, {where}; tool ({place}) m, force ({force}) N>"


def state_of(row: bytearray, tick: int, age_s: float) -> ServoState:
    """Return the state from the bytes of a row; before the first tick (−1) its age is infinite."""
    real, integer = np.frombuffer(row), np.frombuffer(row, np.int64)
    vectors = {name: real[at : at + 3] for name, at in _VECTORS}
    return ServoState(
        tick=tick,
        **vectors,
        depth_m=float(real[_AT["depth_m"]]),
        slip_m_s=float(real[_AT["slip_m_s"]]),
        touching=bool(integer[_AT["touching"]]),
        body=int(integer[_AT["body"]]),
        face=int(integer[_AT["face"]]),
        swatch=int(integer[_AT["swatch"]]),
        flags=flag_of(int(integer[_AT["flags"]])),
        age_s=age_s if tick >= 0 else math.inf,
    )


Mode = Literal["running", "stopped", "paused", "error", "ended"]
"""State of a servo: `Servo.mode`."""

STOPS: Final = (
    Flag.OUT_OF_WORKSPACE
    | Flag.TOO_FAST
    | Flag.FORCE_NOT_FINITE
    | Flag.APPLICATION_SILENT
    | Flag.DEVICE_NOT_READY
    | Flag.STALLED
)
"""Causes of a safety stop."""


class ButtonEvent(NamedTuple):
    """A button of a device was pressed or released.

    Attributes:
        tick: number of the tick.
        time_s: time at which the tick began, on the clock of `hapscene.clock.now_here_ns`.
        button: number of the button, from 0.
        pressed: False if it was released.
    """

    tick: int
    time_s: float
    button: int
    pressed: bool


def button_events_of(state: Record, since: int) -> tuple[list[ButtonEvent], int]:
    """Return the events from change `since` on in the log of a DEVICE_STATE, and the number of all changes."""
    count = int(state.button_count)
    first, found = max(since, count - BUTTON_ROOM + 1, 0), []
    before = int(state.button_log[(first - 1) % BUTTON_ROOM, 2]) if first > 0 else 0
    for number in range(first, count):
        tick, time_ns, buttons = state.button_log[number % BUTTON_ROOM].tolist()
        changed = before ^ buttons
        found += [
            ButtonEvent(tick, 1e-9 * time_ns, k, bool(buttons >> k & 1))
            for k in range(changed.bit_length())
            if changed >> k & 1
        ]
        before = buttons
    return found, count


class TickLog(NamedTuple):
    """Consecutive ticks of a tool.

    Attributes:
        first: number of the first tick.
        rows: (n,) ROW, a copy.
        a_m_s2, a_handle_m_s2: (n, block) desired acceleration, and acceleration of the handle.
    """

    first: int
    rows: Records
    a_m_s2: NDArray[np.float64]
    a_handle_m_s2: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"<TickLog: ticks {self.first} to {self.first + len(self.rows) - 1}>"
