"""Packets of the Novint Falcon, and its compiled reads and writes. Not a driver."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.native import native
from hapscene.device.response_timeout import GONE_S
from hapscene_plugins.devices.compiled_connection import SILENCE, note_poll
from hapscene_plugins.devices.falcon_kinematics import COUNT_RAD, MIDDLE_M, ZERO_RAD, forward, motor_units
from hapscene_plugins.devices.usb_transfers import PACKETS_MAX, UsbLine, clip, discard, receive, send

HOMING, GREEN, RED = 1, 2, 8
HOMED: Final = 0x70

HOMED_COUNT: Final = 20
"""Consecutive packets with the homed bits before force is enabled [count], as protection from bit errors."""

FORCE_N: Final = 8.0

SOONEST_NS, LATEST_NS = 900_000, 1_300_000
"""Times after a packet at which its answer is due [ns]. A tick that begins between them waits for it. At 1 kHz, it
waits only while the latency timer of the FTDI chip expires shortly after the start of the ticks."""

SIZE: Final = 16
"""Bytes of a packet."""

REST: Final = b"<" + b"A" * 12 + bytes((0x41 + (HOMING | RED), 0x41)) + b">"
"""Packet without force."""

BOARD: Final = np.dtype(
    [
        *SILENCE,
        ("homed", "i8"),  # number of consecutive packets with the homed bits
        ("unread", "i8"),  # number of bytes in `Board.data`
        ("p", "f8", (3,)),  # grip position in F
        ("theta", "f8", (3,)),  # angles of the legs [rad]
    ],
    align=True,
)
"""What the compiled driver keeps between ticks."""


class Board(NamedTuple):
    """Argument of the compiled functions."""

    board: Any  # BOARD
    state: Any  # DEVICE_STATE
    line: UsbLine
    data: NDArray[np.uint8]  # (PACKET + SIZE,) received bytes that are not yet processed
    message: NDArray[np.uint8]  # (SIZE,)
    clock: NDArray[np.int64]  # of `new_clock`


@native
def pack(message: NDArray[np.uint8], units: tuple[int, int, int], bits: int) -> None:
    """Write a packet with the commands of three motors, and the bits of LEDs and homing."""
    message[0], message[13], message[14], message[15] = 0x3C, 0x41 + bits, 0x41, 0x3E
    for i in range(3):
        for k in range(4):
            message[1 + 4 * i + k] = 0x41 + (units[i] >> 4 * k & 15)


@native
def is_packet(data: NDArray[np.uint8]) -> bool:
    """Whether 16 bytes are a packet."""
    if data[0] != 0x3C or data[15] != 0x3E or not 0x41 <= data[13] <= 0xC0:
        return False
    for k in range(1, 13):
        if not 0x41 <= data[k] <= 0x50:
            return False
    return True


@native
def encoder_count(data: NDArray[np.uint8], i: int) -> int:
    """Count of encoder `i` in a packet."""
    count = 0
    for k in range(4):
        count |= (int(data[1 + 4 * i + k]) - 0x41) << 4 * k
    return (count ^ 0x8000) - 0x8000


@native
def read_board(given: Board) -> None:
    """Update the state by the packets that have arrived; the newest counts. Wait for an answer that is due."""
    board, line, now = given.board, given.line, now_ns(given.clock)
    if note_poll(board, now):
        discard(line)
    is_due, valid = now - line.state.accepted_ns >= SOONEST_NS, False
    for _ in range(PACKETS_MAX):
        left = line.state.accepted_ns + LATEST_NS - now if is_due and not valid else 0
        if receive(line, max(0, left)):
            if _take(given):
                board.silent_ns = board.paused = 0
                valid = True
        elif left <= 0:
            break
        now = now_ns(given.clock)  # another transfer may have ended the wait
    if board.silent_ns > GONE_S * 1e9 or line.state.problem != 0:
        given.state.ready = 0


@native
def _take(given: Board) -> bool:
    """Update the state by a transfer. Returns whether it contains a valid packet; other bytes are skipped."""
    board, data, packet = given.board, given.data, given.line.packet
    for k in range(2, given.line.state.received):  # two bytes are the status of the FTDI chip
        data[board.unread] = packet[k]
        board.unread += 1
    at, newest = 0, -1
    while at < board.unread and (data[at] != 0x3C or board.unread - at >= SIZE):
        if data[at] == 0x3C and is_packet(data[at : at + SIZE]):
            newest = at
            at += SIZE
        else:
            at += 1
    valid = newest >= 0 and _set_position(given, data[newest : newest + SIZE])
    board.unread -= at
    for k in range(board.unread):
        data[k] = data[at + k]
    return valid


@native
def _set_position(given: Board, packet: NDArray[np.uint8]) -> bool:
    """Update the state by a packet. Returns False if no position of the grip matches its counts."""
    board, state, bits = given.board, given.state, packet[13] - 0x41
    a, b, c = (
        encoder_count(packet, 0) * COUNT_RAD + ZERO_RAD,
        encoder_count(packet, 1) * COUNT_RAD + ZERO_RAD,
        encoder_count(packet, 2) * COUNT_RAD + ZERO_RAD,
    )
    x, y, z = forward((a, b, c), board.p)
    found, homed = not math.isnan(x), bits & HOMED == HOMED
    board.homed = board.homed + 1 if homed and found else 0
    state.ready = int(board.homed >= HOMED_COUNT)
    if not found:
        return False
    board.p[0], board.p[1], board.p[2] = x, y, z
    board.theta[0], board.theta[1], board.theta[2] = a, b, c
    state.p_DT_m[0], state.p_DT_m[1], state.p_DT_m[2] = x, MIDDLE_M - z, y
    state.buttons, state.trouble = bits & 15, 1 - int(homed)
    state.count += 1
    return True


@native
def write_board(given: Board) -> None:
    """Send the motor commands of the force; 0 if the device is not ready."""
    board, state = given.board, given.state
    if state.ready == 1:
        x, y, z = clip((state.f_D_N[0], state.f_D_N[1], state.f_D_N[2]), FORCE_N)
        pack(given.message, motor_units((x, z, -y), board.p, board.theta), HOMING | GREEN)
    else:
        pack(given.message, (0, 0, 0), HOMING | RED)
    send(given.line, given.message, now_ns(given.clock))
