"""The Novint Falcon over USB. The firmware that it forgets when it loses power is the user's own file.

The wire is as libnifalcon's sources have it (BSD; src/comm/FalconCommLibUSB.cpp, src/core/FalconFirmware.cpp,
src/firmware/FalconFirmwareNovintSDK.cpp), the geometry too (include/falcon/core/FalconGeometry.h). Its axes F: x to the
right, y up, z out of the machine, towards the hand.
"""

import math
from pathlib import Path
from typing import Any, Final

from hapscene.device.driver import Connection, Driver, Option
from hapscene.device.model import Device, Limits
from hapscene.device.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import Vector
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.silence import Silence
from hapscene_plugins.devices.usb_device import BACKEND, UsbDevice, find_usb

VENDOR, PRODUCT = 0x0403, 0xCB48
OUT, IN = 0x02, 0x81

# requests of the FTDI chip
RESET, MODEM, FLOW, BAUD, DATA, LATENCY = 0, 1, 2, 3, 4, 9
BOOT = (
    *((RESET, 1), (RESET, 2), (LATENCY, 16), (BAUD, 0x4138), (DATA, 8), (FLOW, 0)),
    *((MODEM, 0x0200), (MODEM, 0x0100), (MODEM, 0x0101)),
)
UPLOAD = ((MODEM, 0x0100), (BAUD, 0x0015))
RUN = ((LATENCY, 1), (BAUD, 0x0002), (RESET, 1), (RESET, 2))

CHUNK: Final = 62
"""Piece of firmware that is sent, and comes back, at once [bytes]."""

HOMING, GREEN, RED = 1, 2, 8
HOMED: Final = 0x70

HOMED_COUNT: Final = 20
"""Packets in a row that must say homed before a force is given [count]: one bit turned on the wire is no homing."""

MIDDLE_M: Final = 0.125
"""z in F of D's origin: where each axis has some 5 cm of way."""

LEG = (0.060, 0.1025, 0.01443, 0.0225, -0.025, 0.0400, -0.02309)
"""a, b, c, d + e, f, r, s of libnifalcon's FalconGeometry.h [m]."""

TURN = tuple((math.cos(angle), math.sin(angle)) for angle in (math.radians(degrees) for degrees in (105, -15, -135)))
"""Where the three legs stand around z: from the top clockwise, as the hand sees it."""

COUNT_RAD: Final = math.radians(360.0 * 0.01425 / (4 * 320 * 0.110))
ZERO_RAD: Final = math.radians(35.0)
"""Angle of a leg at the count 0."""

UNIT_N_m: Final = -1.0e-4
"""Torque at a leg of one unit of a motor's command."""

UNIT_MAX: Final = 4000
"""Most units that are sent: 8 N take 2,000 in the middle of the workspace and up to 8,000 in its corners, where less is
given. The wire wraps at 32,768 into the other sign."""

FORCE_N: Final = 8.0
STEP_M: Final = 1e-8
"""The forward kinematics end when a step of Newton's is shorter."""


def pack(units: tuple[int, int, int], bits: int) -> bytes:
    """The packet of three motors' commands, and the bits of lamps and homing."""
    nibbles = bytes(0x41 + (unit >> shift & 15) for unit in units for shift in (0, 4, 8, 12))
    return b"<" + nibbles + bytes((0x41 + bits, 0x41)) + b">"


REST: Final = pack((0, 0, 0), HOMING | RED)
"""No force."""


def unpack(packet: bytes) -> tuple[tuple[int, int, int], int] | None:
    """Three counts, and the bits of buttons and homing, of a packet of 16 bytes; None where it is none."""
    if packet[0] != 0x3C or packet[15] != 0x3E or not 0 <= packet[13] - 0x41 <= 0x7F:
        return None
    if not all(0x41 <= byte <= 0x50 for byte in packet[1:13]):
        return None
    counts = [sum(packet[at + k] - 0x41 << 4 * k for k in range(4)) for at in (1, 5, 9)]
    a, b, c = ((count ^ 0x8000) - 0x8000 for count in counts)
    return (a, b, c), packet[13] - 0x41


def solve(A: list[tuple[float, float, float]], b: tuple[float, float, float]) -> Vector | None:
    """x of A x = b, by Cramer's rule; None where A is singular. Three numbers: NumPy would take longer."""
    (a, d, g), (p, q, r), (u, v, w) = A
    m0, m1, m2 = q * w - r * v, r * u - p * w, p * v - q * u
    det = a * m0 + d * m1 + g * m2
    size = (abs(a) + abs(d) + abs(g)) * (abs(p) + abs(q) + abs(r)) * (abs(u) + abs(v) + abs(w))
    if not abs(det) > 1e-9 * size:
        return None
    b0, b1, b2 = b
    x = b0 * m0 + d * (r * b2 - b1 * w) + g * (b1 * v - q * b2)
    y = a * (b1 * w - r * b2) + b0 * m1 + g * (p * b2 - b1 * u)
    z = a * (q * b2 - b1 * v) + d * (b1 * u - p * b2) + b0 * m2
    return x / det, y / det, z / det


def closure(p: Vector, theta: tuple[float, float, float]) -> tuple[Any, Any, Any]:
    """How far the three shins are from closing, its gradient by p, a row a leg, and its derivative by each angle.

    A shin is a parallelogram of side b with links d and e at its ends: seen along its leg's axis v the knee is
    ρ = d + e + √(b² − v²) from the plate.
    """
    a, b, c, links, f, r, s = LEG
    gaps, rows, turns = [], [], []
    for (cos, sin), angle in zip(TURN, theta, strict=True):
        u = cos * p[0] + sin * p[1] - r + c - a * math.cos(angle)
        v = -sin * p[0] + cos * p[1] - s + f
        w = p[2] - a * math.sin(angle)
        rho = math.sqrt(u * u + w * w)
        share = (rho - links) / rho if rho > 0.0 else 0.0
        gaps.append(0.5 * ((rho - links) ** 2 + v * v - b * b))
        rows.append((share * u * cos - v * sin, share * u * sin + v * cos, share * w))
        turns.append(share * a * (u * math.sin(angle) - w * math.cos(angle)))
    return gaps, rows, turns


def forward(theta: tuple[float, float, float], start: Vector = (0.0, 0.0, MIDDLE_M)) -> Vector | None:
    """The grip in F [m] at three legs' angles [rad], by Newton's method from `start`; None where there is no such."""
    p = start
    for _ in range(20):
        gaps, rows, _turns = closure(p, theta)
        step = solve(rows, (-gaps[0], -gaps[1], -gaps[2]))
        if step is None:
            return None
        size = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        share = min(1.0, 0.02 / size) if size > 0.0 else 1.0
        p = (p[0] + share * step[0], p[1] + share * step[1], p[2] + share * step[2])
        if size < STEP_M:
            inside = abs(p[0]) < 0.12 and abs(p[1]) < 0.12 and 0.04 < p[2] < 0.2  # the other solution is behind
            return p if inside else None
    return None


def motor_units(force: Vector, p: Vector, theta: tuple[float, float, float]) -> tuple[int, int, int]:
    """The motors' commands for a force in F [N]: Jᵀ f, the direction kept where they would be too large."""
    _, rows, turns = closure(p, theta)
    columns = [(rows[0][i], rows[1][i], rows[2][i]) for i in range(3)]
    weights = solve(columns, force)
    if weights is None:
        return 0, 0, 0
    units = [-turn * weight / UNIT_N_m for turn, weight in zip(turns, weights, strict=True)]
    most = max(map(abs, units))
    share = min(1.0, UNIT_MAX / most) if most > 0.0 else 1.0
    x, y, z = (round(share * unit) for unit in units)
    return x, y, z


class FalconConnection(Connection):
    """A Falcon that runs its firmware. A packet goes out each tick, and one comes back."""

    def __init__(self, firmware: str | None = None, backend: str | None = None, clock: Clock = CLOCK) -> None:
        super().__init__()
        self._clock = clock
        self._usb = UsbDevice("falcon", VENDOR, PRODUCT, backend)
        self._tail, self._homed, self._silence = b"", 0, Silence(clock)
        self._p: Vector = (0.0, 0.0, MIDDLE_M)
        self._theta = (ZERO_RAD, ZERO_RAD, ZERO_RAD)
        try:
            self._set(RUN)
            if not self._answers():
                self._load(firmware)
        except BaseException:
            self._usb.close()
            raise

    def _set(self, requests: tuple[tuple[int, int], ...]) -> None:
        for request, value in requests:
            self._usb.control(request, value)

    def _answers(self) -> bool:
        """Whether it runs its firmware."""
        for _ in range(20):
            self._usb.write(OUT, REST)
            for _ in range(5):
                if self._take(self._usb.read(IN, 64, 10)):
                    return True
        return False

    def _load(self, firmware: str | None) -> None:
        """Give it its firmware.

        Raises:
            DeviceError: no file was told, or it is none; the device does not answer, or not with what it was sent.
        """
        if firmware is None:
            raise DeviceError("falcon: runs no firmware; tell the file that came with yours: --option firmware=FILE")
        try:
            data = Path(firmware).read_bytes()
        except OSError as error:
            raise DeviceError(f"falcon: firmware={firmware}: cannot be read: {error.strerror}") from None
        if not 1_000 <= len(data) <= 65_536:
            raise DeviceError(f"falcon: firmware={firmware}: has {len(data):,} bytes; a Falcon's has some 8,000")
        self._set(BOOT)
        self._shake(b"\x0a\x43\x0d", b"\x0a\x44\x2c\x0d")
        self._set(UPLOAD)
        self._shake(b"A", b"A")
        for at in range(0, len(data), CHUNK):
            piece = data[at : at + CHUNK]
            self._usb.write(OUT, piece)
            back = self._receive(len(piece), 1.0)
            if back != piece:
                raise DeviceError(f"falcon: firmware was garbled at byte {at}; unplug its power, plug it in, try again")
        self._set(RUN)
        if not self._answers():
            raise DeviceError(f"falcon: does not run {firmware}: is it a Falcon's firmware?")

    def _shake(self, said: bytes, expected: bytes) -> None:
        for _ in range(100):
            self._usb.write(OUT, said)
            if self._receive(len(expected), 0.05).removeprefix(b"\0") == expected:  # macOS puts a 0 before
                return
        raise DeviceError("falcon: does not answer as it starts; unplug its power, plug it in, and try again")

    def _receive(self, count: int, wait_s: float) -> bytes:
        """So many bytes, or what came in time, without FTDI's status."""
        data, end_s = b"", self._clock.now_s() + wait_s
        while len(data) < count and self._clock.now_s() < end_s:
            data += self._usb.read(IN, 64, 20)[2:]
        return data

    def _take(self, transfer: bytes) -> int:
        """Read a transfer into the state; gives how many good packets it ended. What is no packet is passed over."""
        data, good, newest = self._tail + transfer[2:], 0, None
        at = data.find(b"<")
        while 0 <= at <= len(data) - 16:
            packet = unpack(data[at : at + 16])
            if packet is not None:
                newest, good = packet, good + 1
            at = data.find(b"<", at + (1 if packet is None else 16))
        self._tail = data[at:] if at >= 0 else b""
        return good if newest is not None and self._place(*newest) else 0

    def _place(self, counts: tuple[int, int, int], bits: int) -> bool:
        """Whether the counts are a place that the grip can be in; then it is there."""
        state = self.state[0]
        theta = tuple(count * COUNT_RAD + ZERO_RAD for count in counts)
        p = forward(theta, self._p)  # type: ignore[arg-type]
        self._homed = self._homed + 1 if bits & HOMED == HOMED and p is not None else 0
        state.ready = int(self._homed >= HOMED_COUNT)
        if p is None:
            return False
        self._p, self._theta = p, theta  # type: ignore[assignment]
        self._silence.end()
        state.p_DT_m = (p[0], MIDDLE_M - p[2], p[1])
        state.buttons, state.trouble = bits & 15, 0 if bits & HOMED == HOMED else 1
        state.count += 1
        return True

    def read(self) -> None:
        for _ in range(2):  # the first transfer may be FTDI's status alone
            if self._take(self._usb.read(IN, 64, 1)):
                return
        if self._silence.is_over():
            self.state.ready = 0
            raise DeviceError("falcon: has said nothing of sense for half a second; check its cable and its power")

    def write(self) -> None:
        state = self.state[0]
        units, bits = (0, 0, 0), HOMING | RED
        if state.ready == 1:
            x, y, z = state.f_D_N.tolist()
            size = math.sqrt(x * x + y * y + z * z)
            if size > FORCE_N:
                x, y, z = (FORCE_N / size * part for part in (x, y, z))
            if math.isfinite(size):
                units = motor_units((x, z, -y), self._p, self._theta)
            bits = HOMING | GREEN
        self._usb.write(OUT, pack(units, bits))

    def close(self) -> None:
        self._usb.close(OUT, REST)

    def reason(self, trouble: int) -> str:
        return "it is not homed: pull its grip all the way out, then push it in" if trouble else ""


def release(backend: str | None = None, **options: Any) -> None:
    """Write zero to a Falcon whose driver has died. Nothing is loaded."""
    usb = UsbDevice("falcon", VENDOR, PRODUCT, backend)
    try:
        for request, value in RUN:
            usb.control(request, value)
        usb.write(OUT, REST)
    finally:
        usb.close()


DRIVER = Driver(
    name="falcon",
    summary="A Novint Falcon, over USB; its firmware is a file of yours.",
    open=FalconConnection,
    find=lambda backend=None, **options: find_usb(VENDOR, PRODUCT, backend),
    model=Device(
        "falcon",
        PointMass(0.1, 0.2, 0.3, 57e-6),
        Limits(FORCE_N, 1000.0 * FORCE_N, stiffness_N_m=3000.0, damping_Ns_m=20.0),
    ),
    continuous_N=3.0,
    low_D_m=(-0.055, -0.055, -0.055),
    high_D_m=(0.055, 0.055, 0.055),
    button_count=4,
    rate_Hz=1000.0,
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission, and the firmware's file until it has been loaded",
    options=(Option("firmware", None, "file of the firmware, loaded where the device runs none"), BACKEND),
    release=release,
    assumptions=(
        "It runs at 1 kHz in lock-step, as the chip's latency timer of 1 ms allows.",
        "Mass, damping, friction and the force that it bears for ever are guessed; nobody publishes them.",
        "Its firmware has no watchdog: it holds the last force until it is told another.",
    ),
)
