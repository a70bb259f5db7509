"""The Novint Falcon over USB.

The Falcon loses its firmware when it loses power. The user provides the firmware file, which this driver loads. The
protocol follows libnifalcon's sources (BSD; src/comm/FalconCommLibUSB.cpp, src/core/FalconFirmware.cpp,
src/firmware/FalconFirmwareNovintSDK.cpp).
"""

from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Driver, Option
from hapscene.device.model import Device, Limits
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.records import records
from hapscene.wall_clock import CLOCK
from hapscene_plugins.devices.falcon_board import BOARD, FORCE_N, REST, SIZE, Board, read_board, write_board
from hapscene_plugins.devices.falcon_kinematics import MIDDLE_M, ZERO_RAD
from hapscene_plugins.devices.usb_connection import UsbConnection
from hapscene_plugins.devices.usb_device import BACKEND, USB_MODULES, UsbDevice, find_usb
from hapscene_plugins.devices.usb_transfers import PACKET

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


class FalconConnection(UsbConnection):
    """An open Falcon that runs its firmware. It answers each packet by one packet."""

    _name, _remedy = "falcon", "check the cable and the power"

    def __init__(self, firmware: str | None = None, backend: str | None = None) -> None:
        usb = UsbDevice("falcon", VENDOR, PRODUCT, backend)
        super().__init__(usb, records(1, BOARD)[0], read_board, write_board)
        self._board.p, self._board.theta = (0.0, 0.0, MIDDLE_M), (ZERO_RAD, ZERO_RAD, ZERO_RAD)
        try:
            self._set(RUN)
            if not self._answers():
                self._load(firmware)
        except BaseException:
            self._usb.close()
            raise

    def _argument(self) -> tuple[Any, ...]:
        buffers = np.zeros(PACKET + SIZE, np.uint8), np.zeros(SIZE, np.uint8)
        return Board(self._board, self.state[0], self._transfers.line, *buffers, self._clock)

    def _set(self, requests: tuple[tuple[int, int], ...]) -> None:
        for request, value in requests:
            self._usb.control(request, value)

    def _answers(self) -> bool:
        """Whether the device runs its firmware. If so, transfers for compiled code have started."""
        self._submit((IN, OUT))
        for _ in range(20):
            self._board.silent_ns = 0
            self.write()
            for _ in range(10):
                CLOCK.sleep_s(1e-3)
                self._calls()[0]()
                self.check()
                if self.state.count[0] > 0:
                    return True
        self._usb.end_transfers()
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
        data, end_s = b"", CLOCK.now_s() + wait_s
        while len(data) < count and CLOCK.now_s() < end_s:
            data += self._usb.read(IN, 64, 20)[2:]
        return data

    def close(self) -> None:
        self._usb.close(OUT, REST)

    def reason(self, trouble: int) -> str:
        return "it is not homed: pull the grip out completely, then push it in" if trouble else ""


def release(backend: str | None = None, **options: Any) -> None:
    """Send zero force after the driver process has died. Does not load the firmware."""
    usb = UsbDevice("falcon", VENDOR, PRODUCT, backend)
    try:
        with suppress(DeviceError):  # at once, as the driver has usually set the chip
            usb.write(OUT, REST)
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
