"""Messages of the Haply 2DIY's board, and its compiled reads and writes. Not a driver."""

import math
import struct
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.native import native
from hapscene.device.response_timeout import GONE_S
from hapscene.device.serial_port import SerialLine, discard, receive, send
from hapscene_plugins.devices.compiled_connection import SILENCE, note_poll
from hapscene_plugins.devices.haply2diy_kinematics import arm_torques, forward

__all__ = [
    "ANSWER",
    "BOARD",
    "HARDWARE",
    "ID",
    "MIDDLE_M",
    "SETUP",
    "TORQUES",
    "Board",
    "read_board",
    "run_message",
    "setup_message",
    "write_board",
]

ID: Final = 5
"""Device id that the board is given; each answer starts with it."""

SETUP, RUN = 1, 2
CW, CCW = 0, 1

ANSWER: Final = struct.Struct("<B2f")
"""An answer: the id, and the angles of the second and the first arm [°]."""

ANSWER_SIZE: Final = ANSWER.size

TORQUES: Final = struct.Struct("<BB2f")

MIDDLE_M: Final = 0.09
"""y in H of the origin of D."""

JUMP_RAD: Final = math.radians(20.0)
"""Largest plausible rotation of an arm between two answers [rad]. A hand needs tens of milliseconds for it."""


class Hardware(NamedTuple):
    """Parameters of a hardware version. Pairs are by port: second arm, then first arm."""

    direction: tuple[int, int]  # of motors and encoders
    zero_deg: tuple[float, float]  # offsets of the encoders
    counts: float  # per turn of an encoder
    base_m: float  # distance between the axes of the arms


HARDWARE = {
    "v3": Hardware((CCW, CCW), (12.0, 168.0), 4880.0, 0.038),
    "v2": Hardware((CW, CCW), (-61.0, 241.0), 10752.0, 0.0),
}
"""Hardware versions by name. The second arm is connected to port 1, the first arm to port 2."""


def setup_message(hardware: Hardware) -> bytes:
    """Setup message: two motors, two encoders, no sensors, no PWM pins."""
    head = bytes((SETUP, ID, 0b11, *hardware.direction, 0b11, *hardware.direction, 0, 0))
    return head + struct.pack("<4f", hardware.zero_deg[0], hardware.counts, hardware.zero_deg[1], hardware.counts)


def run_message(torques: tuple[float, float]) -> bytes:
    """Message with the torques of the first and the second arm [N·m]."""
    return TORQUES.pack(RUN, ID, torques[1], torques[0])


BOARD: Final = np.dtype(
    [
        *SILENCE,
        ("homed", "i8"),  # 1: the arms were at their marks at the last setup message
        ("known", "i8"),  # 1: the angles are from the last answer, so that a jump can be detected
        ("garbled", "i8"),  # 1: synchronisation is lost; the next answer starts afresh
        ("base_m", "f8"),  # of the hardware
        ("theta", "f8", (2,)),  # angles of the first and the second arm [rad]
        ("p", "f8", (2,)),  # handle position in H [m]
    ],
    align=True,
)
"""What the compiled driver keeps between ticks."""


class Board(NamedTuple):
    """Argument of the compiled `read_board` and `write_board`."""

    board: Any  # BOARD
    state: Any  # DEVICE_STATE
    line: SerialLine
    pair: NDArray[np.float32]  # (2,) two numbers of a message, second arm first,
    octets: NDArray[np.uint8]  # (8,) in the same memory
    message: NDArray[np.uint8]  # (10,) torques
    clock: NDArray[np.int64]  # of `new_clock`


@native
def read_board(given: Board) -> None:
    """Update the state by the answers that have arrived; the newest counts.

    A starved board or computer delivers many answers at once, which is no error.
    """
    board, line = given.board, given.line
    note_poll(board, now_ns(given.clock))
    if board.known == 1 and board.paused == 1:  # buffered answers are from before a pause
        discard(line)
        board.known = 0
    receive(line)
    at, count = 0, line.state.received
    while count - at >= ANSWER_SIZE and board.garbled == 0:
        for k in range(8):
            given.octets[k] = line.input[at + 1 + k]
        if line.input[at] == ID and _take(given):
            board.silent_ns = board.paused = 0
        else:
            board.garbled = 1
        at += ANSWER_SIZE
    for k in range(count - at):
        line.input[k] = line.input[at + k]
    line.state.received = 0 if board.garbled == 1 else count - at
    if board.silent_ns > GONE_S * 1e9 or line.state.problem != 0:
        given.state.ready = 0


@native
def _take(given: Board) -> bool:
    """Update the state by the angles of an answer. Returns False if they are implausible."""
    board, state = given.board, given.state
    first, second = math.radians(given.pair[1]), math.radians(given.pair[0])
    if not (abs(first) < 4.0 * math.pi and abs(second) < 4.0 * math.pi):
        return False
    if board.known == 1 and max(abs(first - board.theta[0]), abs(second - board.theta[1])) > JUMP_RAD:
        return False
    x, y = forward((first, second), board.base_m)
    if math.isnan(x):
        return False
    board.theta[0], board.theta[1], board.p[0], board.p[1], board.known = first, second, x, y, 1
    state.p_DT_m[0], state.p_DT_m[1], state.p_DT_m[2] = 0.5 * board.base_m - x, MIDDLE_M - y, 0.0
    state.ready, state.trouble = board.homed, 1 - board.homed
    state.count += 1
    return True


@native
def write_board(given: Board) -> None:
    """Send the torques of the force; 0 if the device is not ready."""
    board, state, line = given.board, given.state, given.line
    x, y = -state.f_D_N[0], -state.f_D_N[1]
    first = second = 0.0
    if state.ready == 1 and math.isfinite(x) and math.isfinite(y):
        first, second = arm_torques((x, y), board.p, board.theta, board.base_m)
    given.pair[0], given.pair[1] = second, first
    for k in range(8):
        given.message[2 + k] = given.octets[k]
    if board.garbled == 1:
        discard(line)
        board.garbled = 0
    send(line, given.message, now_ns(given.clock))
