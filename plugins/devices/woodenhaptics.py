"""WoodenHaptics, an open-hardware device, over USB HID.

Reports of eight bytes in both directions, as in firmware 1.5 (WoodenHaptics/woody-experimental,
mbed-code/WoodenHapticsHID/main.cpp): counts of three encoders, currents in mA.

Geometry and signs of encoders and motors follow the published plans and the makers' library (Forsslund Systems:
`default_woody`, `computePosition`). The device's axes are those of CHAI3D: x towards the hand, y to the right, z up.
The amplifiers switch off half a second after the last report.
"""

import math
import struct
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.native import native
from hapscene.device.driver import Driver, Option
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import GONE_S
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import Vector
from hapscene.records import records
from hapscene_plugins.devices.compiled_connection import SILENCE, note_poll
from hapscene_plugins.devices.usb_connection import UsbConnection
from hapscene_plugins.devices.usb_device import BACKEND, USB_MODULES, UsbDevice, find_usb
from hapscene_plugins.devices.usb_transfers import PACKETS_MAX, UsbLine, clip, discard, receive, send

VENDOR, PRODUCT = 0x1234, 0x0006
"""Default USB ids of mbed's USBHID."""

HOME: Final = "hold the upper arm upright, the lower arm horizontal, both straight ahead"

REPORT: Final = struct.Struct("<3hH")
"""Three counts or currents, and a number that is not used."""

COLUMN_M, UPPER_M, LOWER_M = 0.080, 0.205, 0.245
MIDDLE_M: Final = (0.220, 0.000, 0.080)
"""Origin of D in the device's axes."""

GEAR: Final = (0.010 / 0.160, 0.010 / 0.120, 0.010 / 0.120)
"""Gear ratios: diameter of each capstan over that of the body it drives."""

COUNTS: Final = 2000.0
"""Encoder counts per turn of a motor."""

TORQUE_N_m_A: Final = 0.0259
"""Torque constant of a motor."""

CURRENT_MAX_mA: Final = 3000
"""Current limit of the firmware."""

FORCE_N: Final = 5.0

JUMP: Final = 1000
"""Largest plausible change of an encoder between two reports [counts]: 20 ms of the fastest hand."""


BOARD: Final = np.dtype(
    [
        *SILENCE,
        ("homed", "i8"),  # 1: `zero` is known
        ("known", "i8"),  # 1: `counts` are from the last report, so that a jump can be detected
        ("stale", "i8"),  # number of reports from before a pause that the device still has to send
        ("counts", "i8", (3,)),
        ("zero", "i8", (3,)),  # counts in the home position
        ("angles", "f8", (3,)),  # of column, upper arm and lower arm [rad]
        ("signs", "f8", (3,)),  # directions of the motors
    ],
    align=True,
)
"""What the compiled driver keeps between ticks."""


class Board(NamedTuple):
    """Argument of the compiled functions."""

    board: Any  # BOARD
    state: Any  # DEVICE_STATE
    line: UsbLine
    words: NDArray[np.int16]  # (4,) a report
    octets: NDArray[np.uint8]  # (8,) in the same memory
    clock: NDArray[np.int64]  # of `new_clock`


@native
def body_angles(counts: Any) -> tuple[float, float, float]:
    """Angles of column, upper arm (0: upright), lower arm (0: hanging) [rad]. At count 0 the lower arm is
    horizontal."""
    a = -2.0 * math.pi * counts[0] / COUNTS * GEAR[0]
    b = -2.0 * math.pi * counts[1] / COUNTS * GEAR[1]
    return a, b, -2.0 * math.pi * counts[2] / COUNTS * GEAR[2] + 0.5 * math.pi


@native
def forward(angles: Any) -> Vector:
    """Tool position in the device's axes, relative to `MIDDLE_M` [m]."""
    a, b, c = angles[0], angles[1], angles[2]
    reach = UPPER_M * math.sin(b) + LOWER_M * math.sin(c)
    height = COLUMN_M + UPPER_M * math.cos(b) - LOWER_M * math.cos(c)
    return math.cos(a) * reach - MIDDLE_M[0], math.sin(a) * reach - MIDDLE_M[1], height - MIDDLE_M[2]


@native
def currents(force: Vector, angles: Any, signs: Any) -> tuple[int, int, int]:
    """Currents [mA] for a force in the device's axes, Jᵀ f. Scaled down together if one exceeds the limit."""
    a, b, c = angles[0], angles[1], angles[2]
    out = math.cos(a) * force[0] + math.sin(a) * force[1]
    around = -math.sin(a) * force[0] + math.cos(a) * force[1]
    unit = 1000.0 / TORQUE_N_m_A
    x = unit * signs[0] * GEAR[0] * around * (UPPER_M * math.sin(b) + LOWER_M * math.sin(c))
    y = unit * signs[1] * GEAR[1] * UPPER_M * (math.cos(b) * out - math.sin(b) * force[2])
    z = unit * signs[2] * GEAR[2] * LOWER_M * (math.cos(c) * out + math.sin(c) * force[2])
    share = min(1.0, CURRENT_MAX_mA / max(abs(x), abs(y), abs(z), 1.0))
    return round(share * x), round(share * y), round(share * z)


@native
def read_board(given: Board) -> None:
    """Update the state by the reports that have arrived; the newest counts."""
    board, line = given.board, given.line
    if note_poll(board, now_ns(given.clock)):
        discard(line)
        board.stale = 1  # the device prepares a report when it has sent the one before
    for _ in range(PACKETS_MAX):
        if not receive(line, 0):
            break
        if board.stale > 0:
            board.stale -= 1
        elif line.state.received == 8 and _take(given):
            board.silent_ns = board.paused = 0
    if board.silent_ns > GONE_S * 1e9 or line.state.problem != 0:
        given.state.ready = 0


@native
def _take(given: Board) -> bool:
    """Update the state by a report. Returns False if it is implausible."""
    board, state = given.board, given.state
    for k in range(8):
        given.octets[k] = given.line.packet[k]
    if board.known == 1 and board.paused == 0:
        for i in range(3):
            if abs(given.words[i] - board.counts[i]) > JUMP:
                return False
    counts, zero, angles = board.counts, board.zero, board.angles
    for i in range(3):
        counts[i] = given.words[i]
    board.known = 1
    angles[0], angles[1], angles[2] = body_angles((counts[0] - zero[0], counts[1] - zero[1], counts[2] - zero[2]))
    x, y, z = forward(angles)
    state.p_DT_m[0], state.p_DT_m[1], state.p_DT_m[2] = y, -x, z
    state.ready, state.trouble = board.homed, 1 - board.homed
    state.count += 1
    return True


@native
def write_board(given: Board) -> None:
    """Send the currents of the force; 0 if the device is not ready."""
    board, state, words = given.board, given.state, given.words
    words[0] = words[1] = words[2] = words[3] = 0
    if state.ready == 1:
        x, y, z = clip((state.f_D_N[0], state.f_D_N[1], state.f_D_N[2]), FORCE_N)
        words[0], words[1], words[2] = currents((-y, x, z), board.angles, board.signs)
    send(given.line, given.octets, now_ns(given.clock))


class WoodenHapticsConnection(UsbConnection):
    """An open WoodenHaptics. The device sends a report in each USB frame of 1 ms, and receives one."""

    _name, _remedy = "woodenhaptics", "check the cable"

    def __init__(self, homed: bool = False, signs: str = "+--", backend: str | None = None) -> None:
        if len(signs) != 3 or set(signs) - {"+", "-"}:
            raise DeviceError(f"woodenhaptics: option signs={signs}: expected three characters + or -, such as +--")
        usb = UsbDevice("woodenhaptics", VENDOR, PRODUCT, backend)
        super().__init__(usb, records(1, BOARD)[0], read_board, write_board)
        self._board.homed, self._board.signs = int(homed), [-1.0 if sign == "-" else 1.0 for sign in signs]
        self._board.angles = body_angles((0, 0, 0))
        self._ends = self._usb.endpoint_pair("the firmware WoodenHapticsHID")
        self._submit(self._ends)

    def _argument(self) -> tuple[Any, ...]:
        words = np.zeros(4, np.int16)
        return Board(self._board, self.state[0], self._transfers.line, words, words.view(np.uint8), self._clock)

    def home(self) -> None:
        if self._board.known:
            self._board.homed, self._board.zero, self._board.known = 1, self._board.counts, 0

    def close(self) -> None:
        self._usb.close(self._ends[1], REPORT.pack(0, 0, 0, 0))

    def reason(self, trouble: int) -> str:
        return f"the arm position is not calibrated: {HOME}, and press h" if trouble else ""


def release(backend: str | None = None, **options: Any) -> None:
    """Send zero current after the driver process has died, before the amplifiers switch off by themselves."""
    usb = UsbDevice("woodenhaptics", VENDOR, PRODUCT, backend)
    usb.close(next(end for end in usb.endpoints if end < 0x80), REPORT.pack(0, 0, 0, 0))


DRIVER = Driver(
    name="woodenhaptics",
    summary="WoodenHaptics (open hardware) with the USB HID firmware.",
    open=WoodenHapticsConnection,
    find=lambda backend=None, **options: find_usb(VENDOR, PRODUCT, backend),
    model=Device(
        "woodenhaptics",
        PointMass(0.2, 0.1, 0.3, 50e-6),
        Limits(FORCE_N, 1000.0 * FORCE_N, stiffness_N_m=1000.0, damping_Ns_m=8.0),
    ),
    continuous_N=2.0,
    low_D_m=(-0.1, -0.1, -0.1),
    high_D_m=(0.1, 0.1, 0.1),
    rate_Hz=1000.0,
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission for the device",
    home=HOME,
    imports=USB_MODULES,
    options=(
        Option("homed", False, "whether it was connected in its home position"),
        Option("signs", "+--", "direction of each motor for a positive current, three characters + or -"),
        BACKEND,
    ),
    watchdog_s=0.5,
    release=release,
    assumptions=(
        "Built to the published plans: lengths, capstans, encoders of 2,000 counts, motors of 25.9 mN·m/A.",
        "Reports wait for the next USB frame: a position is 1 to 2 ms old, and a force arrives within 1 ms.",
        "Mass, friction and continuous force are estimates.",
        "The directions of the motors are those of the makers' library. With wrong --option signs the force has the "
        "wrong direction: test with 0.5 N first.",
    ),
)
