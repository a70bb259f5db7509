"""A handle of one's own on USB's bulk endpoints: the lines of docs/handle-protocol.md, no serial port between."""

from typing import Final

from hapscene.errors import HandleError
from hapscene.files import refusing
from hapscene.handle.live_board import LiveBoard
from hapscene.wire.usb_port import UsbPort

ID: Final = "16c0:05dc"
"""What devices of the vendor's class may share that are told apart by their names (Objective Development's free ids).
Assumed of a board unless it is told otherwise."""


class UsbWire(UsbPort):
    """The port, its errors those of a handle."""

    def write(self, data: bytes) -> None:
        with refusing(HandleError):
            super().write(data)


class UsbHandle(LiveBoard):
    """Plays on a board with a current amplifier, as a `HandleOutput`."""

    def __init__(
        self,
        id: str = ID,
        serial: str = "",
        backend: str = "",
        limit_N: float = 3.0,
        ahead_s: float = 0.015,
        watchdog_s: float = 0.02,
        highpass_Hz: float = 15.0,
        lag_s: float = 0.005,
    ) -> None:
        """Opens the device and waits for the board; `id` is VENDOR:PRODUCT, the first three are `UsbPort`'s.

        Raises:
            HandleError: no such device, silence, or something else than a handle that plays live.
        """
        try:
            vendor, product = (int(part, 16) for part in id.split(":"))
        except ValueError:
            raise HandleError(f"option id={id}: is VENDOR:PRODUCT in hexadecimal digits, as {ID}") from None
        with refusing(HandleError):
            wire = UsbWire(vendor, product, serial, backend)
        super().__init__(f"usb {id}", wire, limit_N, ahead_s, watchdog_s, highpass_Hz, lag_s)
