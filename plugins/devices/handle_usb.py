"""A handle on USB bulk endpoints: the lines of docs/reference/handle-protocol.md, without a serial port."""

from collections.abc import Sequence
from typing import Any, Final

from hapscene.device.driver import Driver, Found, Option
from hapscene.errors import DeviceError, HandleError
from hapscene.handle.board import LiveBoard
from hapscene.io.probe_port import LUMP_S, POLL_S, DrainedPort
from hapscene_plugins.devices.handle_serial import BOARD, UNTRIED
from hapscene_plugins.devices.usb_device import BACKEND, UsbDevice, find_usb

ID: Final = "16c0:05dc"
"""Free USB ids of Objective Development for vendor-class devices, which are distinguished by their names."""

PACKET: Final = 1 << 10
"""Bytes of a read request. 2 ms of a board at 10 kHz take 600. If all packets of a board are full, a read waits until
the request is complete: 8 ms at 5 kHz."""


class UsbWire(DrainedPort):
    """The two bulk endpoints of the first interface, read by a thread."""

    def __init__(self, vendor: int, product: int, backend: str | None) -> None:
        try:
            self._device = UsbDevice("usb", vendor, product, backend)
            self._in, self._out = self._device.endpoint_pair("a handle's board")
        except DeviceError as error:
            raise HandleError(str(error)) from None
        super().__init__()

    def _drain(self) -> None:
        try:
            while not self._closing.is_set():
                if data := self._device.read(self._in, PACKET, round(1e3 * POLL_S)):
                    self._pieces.put((data, self._clock.now_s()))
                    self._closing.wait(LUMP_S)
        except DeviceError as error:
            self._pieces.put(str(error))

    def write(self, data: bytes) -> None:
        try:
            self._device.write(self._out, data)
        except DeviceError as error:
            raise HandleError(str(error)) from None

    def close(self) -> None:
        super().close()
        self._device.close()


def _numbers(id: str) -> tuple[int, int]:
    try:
        vendor, product = (int(part, 16) for part in id.split(":"))
    except ValueError:
        raise HandleError(f"option id={id}: expected VENDOR:PRODUCT in hexadecimal digits, such as {ID}") from None
    return vendor, product


def open_handle(id: str, backend: str | None, **board: Any) -> LiveBoard:
    """Open the USB device and wait for the board.

    Raises:
        HandleError: no such device, no answer, or the device is not a handle that plays live.
    """
    return LiveBoard(f"usb {id}", UsbWire(*_numbers(id), backend), **board)


def find(id: str = ID, backend: str | None = None, **options: Any) -> Sequence[Found]:
    """The connected boards."""
    found: Sequence[Found] = find_usb(*_numbers(id), backend)
    return found


DRIVER = Driver(
    name="usb",
    summary="Handle: a board with a current amplifier on USB bulk endpoints.",
    open_handle=open_handle,
    find=find,
    force=False,
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission for the device",
    options=(Option("id", ID, "USB ids, VENDOR:PRODUCT in hexadecimal digits"), BACKEND, *BOARD),
    watchdog_s=0.02,
    assumptions=(*UNTRIED, f"The board has the USB ids {ID}, unless option id names others."),
)
