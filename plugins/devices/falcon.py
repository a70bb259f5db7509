"""The Novint Falcon over USB.

The Falcon loses its firmware when it loses power. The user provides the firmware file, which this driver loads. The
protocol follows libnifalcon's sources (BSD; src/comm/FalconCommLibUSB.cpp, src/core/FalconFirmware.cpp,
src/firmware/FalconFirmwareNovintSDK.cpp).
"""

from pathlib import Path
from typing import Any, Final

from hapscene.device.driver import Connection, Driver, Option, clip_force
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import Vector
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.falcon_kinematics import COUNT_RAD, MIDDLE_M, ZERO_RAD, forward, motor_units
from hapscene_plugins.devices.usb_device import BACKEND, USB_MODULES, UsbDevice, find_usb

VENDOR, PRODUCT = 0x0403, 0xCB48
OUT, IN = 0x02, 0x81

# control requests of the FTDI chip
RESET, MODEM, FLOW, BAUD, DATA, LATENCY = 0, 1, 2, 3, 4, 9
BOOT = (
    *((RESET, 1), (RESET, 2), (LATENCY, 16), (BAUD, 0x4138), (DATA, 8), (FLOW, 0)),
    *((MODEM, 0x0200), (MODEM, 0x0100), (MODEM, 0x0101)),
)
UPLOAD = ((MODEM, 0x0100), (BAUD, 0x0015))
RUN = ((LATENCY, 1), (BAUD, 0x0002), (RESET, 1), (RESET, 2))

CHUNK: Final = 62
"""Bytes of firmware in one transfer. The device echoes each transfer."""

HOMING, GREEN, RED = 1, 2, 8
HOMED: Final = 0x70

HOMED_COUNT: Final = 20
"""Consecutive packets with the homed bits before force is enabled [count], as protection from bit errors."""

FORCE_N: Final = 8.0


def pack(units: tuple[int, int, int], bits: int) -> bytes:
    """Packet with the commands of three motors, and the bits of LEDs and homing."""
    nibbles = bytes(0x41 + (unit >> shift & 15) for unit in units for shift in (0, 4, 8, 12))
    return b"<" + nibbles + bytes((0x41 + bits, 0x41)) + b">"


REST: Final = pack((0, 0, 0), HOMING | RED)
"""Packet without force."""


def unpack(packet: bytes) -> tuple[tuple[int, int, int], int] | None:
    """Three encoder counts, and the bits of buttons and homing, of a packet of 16 bytes; None if it is invalid."""
    if packet[0] != 0x3C or packet[15] != 0x3E or not 0 <= packet[13] - 0x41 <= 0x7F:
        return None
    if not all(0x41 <= byte <= 0x50 for byte in packet[1:13]):
        return None
    counts = [sum(packet[at + k] - 0x41 << 4 * k for k in range(4)) for at in (1, 5, 9)]
    a, b, c = ((count ^ 0x8000) - 0x8000 for count in counts)
    return (a, b, c), packet[13] - 0x41


class FalconConnection(Connection):
    """An open Falcon that runs its firmware. It answers each packet by one packet."""

    def __init__(self, firmware: str | None = None, backend: str | None = None, clock: Clock = CLOCK) -> None:
        super().__init__()
        self._clock = clock
        self._usb = UsbDevice("falcon", VENDOR, PRODUCT, backend)
        self._tail, self._homed, self._timeout = b"", 0, ResponseTimeout(clock)
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
        """Whether the device runs its firmware."""
        for _ in range(20):
            self._usb.write(OUT, REST)
            for _ in range(5):
                if self._take(self._usb.read(IN, 64, 10)):
                    return True
        return False

    def _load(self, firmware: str | None) -> None:
        """Load the firmware.

        Raises:
            DeviceError: no firmware file was given, it is invalid, or the device does not answer as expected.
        """
        if firmware is None:
            raise DeviceError("falcon: no firmware loaded; name the firmware file: --option firmware=FILE")
        try:
            data = Path(firmware).read_bytes()
        except OSError as error:
            raise DeviceError(f"falcon: option firmware={firmware}: cannot be read: {error.strerror}") from None
        if not 1_000 <= len(data) <= 65_536:
            raise DeviceError(f"falcon: option firmware={firmware}: {len(data):,} bytes; expected about 8,000 bytes")
        self._set(BOOT)
        self._shake_hands(b"\x0a\x43\x0d", b"\x0a\x44\x2c\x0d")
        self._set(UPLOAD)
        self._shake_hands(b"A", b"A")
        for at in range(0, len(data), CHUNK):
            chunk = data[at : at + CHUNK]
            self._usb.write(OUT, chunk)
            if self._receive(len(chunk), 1.0) != chunk:
                raise DeviceError(
                    f"falcon: transmission error at byte {at} of the firmware; disconnect its power and try again"
                )
        self._set(RUN)
        if not self._answers():
            raise DeviceError(f"falcon: does not start {firmware}; expected firmware of the Novint Falcon")

    def _shake_hands(self, sent: bytes, expected: bytes) -> None:
        for _ in range(100):
            self._usb.write(OUT, sent)
            if self._receive(len(expected), 0.05).removeprefix(b"\0") == expected:  # on macOS a 0 comes first
                return
        raise DeviceError("falcon: no answer from the boot loader; disconnect its power and try again")

    def _receive(self, count: int, wait_s: float) -> bytes:
        """Receive `count` bytes, or fewer on a timeout, without the status bytes of the FTDI chip."""
        data, end_s = b"", self._clock.now_s() + wait_s
        while len(data) < count and self._clock.now_s() < end_s:
            data += self._usb.read(IN, 64, 20)[2:]
        return data

    def _take(self, transfer: bytes) -> int:
        """Update the state by a transfer. Returns the number of valid packets; other bytes are skipped."""
        data, valid, newest = self._tail + transfer[2:], 0, None
        at = data.find(b"<")
        while 0 <= at <= len(data) - 16:
            packet = unpack(data[at : at + 16])
            if packet is not None:
                newest, valid = packet, valid + 1
            at = data.find(b"<", at + (1 if packet is None else 16))
        self._tail = data[at:] if at >= 0 else b""
        return valid if newest is not None and self._set_position(*newest) else 0

    def _set_position(self, counts: tuple[int, int, int], bits: int) -> bool:
        """Update the state by encoder counts. Returns False if no position of the grip matches them."""
        state = self.state[0]
        a, b, c = (count * COUNT_RAD + ZERO_RAD for count in counts)
        theta = (a, b, c)
        p = forward(theta, self._p)
        self._homed = self._homed + 1 if bits & HOMED == HOMED and p is not None else 0
        state.ready = int(self._homed >= HOMED_COUNT)
        if p is None:
            return False
        self._p, self._theta = p, theta
        self._timeout.received()
        state.p_DT_m = (p[0], MIDDLE_M - p[2], p[1])
        state.buttons, state.trouble = bits & 15, 0 if bits & HOMED == HOMED else 1
        state.count += 1
        return True

    def read(self) -> None:
        for _ in range(2):  # the first transfer may contain only the status of the FTDI chip
            if self._take(self._usb.read(IN, 64, 1)):
                return
        self._timeout.check(self, "falcon", "check the cable and the power")

    def write(self) -> None:
        state = self.state[0]
        units, bits = (0, 0, 0), HOMING | RED
        if state.ready == 1:
            x, y, z = clip_force(state.f_D_N, FORCE_N)
            units, bits = motor_units((x, z, -y), self._p, self._theta), HOMING | GREEN
        self._usb.write(OUT, pack(units, bits))

    def close(self) -> None:
        self._usb.close(OUT, REST)

    def reason(self, trouble: int) -> str:
        return "it is not homed: pull the grip out completely, then push it in" if trouble else ""


def release(backend: str | None = None, **options: Any) -> None:
    """Send zero force after the driver process has died. Does not load the firmware."""
    usb = UsbDevice("falcon", VENDOR, PRODUCT, backend)
    try:
        for request, value in RUN:
            usb.control(request, value)
        usb.write(OUT, REST)
    finally:
        usb.close()


DRIVER = Driver(
    name="falcon",
    summary="Novint Falcon over USB; needs the firmware file of the device.",
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
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission, and after power-up the firmware file",
    imports=USB_MODULES,
    options=(Option("firmware", None, "firmware file, loaded if the device has none"), BACKEND),
    release=release,
    assumptions=(
        "It answers each packet within 1 ms, the latency timer of the FTDI chip, so the loop runs at 1 kHz.",
        "Mass, damping, friction and continuous force are estimates; no published values are known.",
        "The firmware has no watchdog: it holds the last force until the next packet.",
    ),
)
