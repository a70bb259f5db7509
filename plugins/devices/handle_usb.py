"""A handle of one's own on USB's bulk endpoints: the lines of docs/handle-protocol.md, no serial port between."""

from collections.abc import Sequence
from typing import Any, Final

from hapscene.device.driver import Driver, Found, Option
from hapscene.errors import DeviceError, HandleError
from hapscene.handle.live_board import LiveBoard
from hapscene.io.wire.port import LUMP_S, POLL_S, DrainedPort
from hapscene_plugins.devices.handle_serial import BOARD, UNTRIED
from hapscene_plugins.devices.usb_device import BACKEND, UsbDevice, find_usb

ID: Final = "16c0:05dc"
"""What devices of no class may share that are told apart by their names (Objective Development's free ids)."""

PACKET: Final = 1 << 10
"""Bytes that are asked for at once: 2 ms of a board at 10 kHz take 600. A board whose packets are all full has a read
wait until there are so many: 8 ms at 5 kHz."""

ENDPOINT_IN: Final = 0x80
"""Bit of the address of an endpoint that the board sends by."""


class UsbWire(DrainedPort):
    """The first interface's two bulk endpoints, drained as a port is."""

    def __init__(self, vendor: int, product: int, backend: str | None) -> None:
        try:
            self._device = UsbDevice("usb", vendor, product, backend)
        except DeviceError as error:
            raise HandleError(str(error)) from None
        ends = self._device.endpoints
        try:
            self._in = next(end for end in ends if end & ENDPOINT_IN)
            self._out = next(end for end in ends if not end & ENDPOINT_IN)
        except StopIteration:
            self._device.close()
            raise HandleError("usb: the board's first interface has not an endpoint each way") from None
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
        raise HandleError(f"option id={id}: is VENDOR:PRODUCT in hexadecimal digits, as {ID}") from None
    return vendor, product


def open_handle(id: str, backend: str | None, **board: Any) -> LiveBoard:
    """Opens the device and waits for the board.

    Raises:
        HandleError: no such device, silence, or something else than a handle that plays live.
    """
    return LiveBoard(f"usb {id}", UsbWire(*_numbers(id), backend), **board)


def find(id: str = ID, backend: str | None = None, **options: Any) -> Sequence[Found]:
    """Those that are plugged in."""
    found: Sequence[Found] = find_usb(*_numbers(id), backend)
    return found


DRIVER = Driver(
    name="usb",
    summary="A board with a current amplifier on USB's bulk endpoints (a handle).",
    open_handle=open_handle,
    find=find,
    force=False,
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission",
    options=(Option("id", ID, "vendor's and product's numbers"), BACKEND, *BOARD),
    watchdog_s=0.02,
    assumptions=(*UNTRIED, f"A board that says no other id has {ID}."),
)
