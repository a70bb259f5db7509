"""An emulated handle on USB: a backend of pyusb, in place of libusb, for `option backend=…` of the handle `usb`.

The board behind it is that of `serial_board`, in real time.
"""

import time
from typing import Any, Final

from hapscene.handle.force_source import SimulatedSource
from hapscene.handle.plant import Plant
from tests.handle.serial_board import Peer
from tests.nightly.plugins.devices.emulators.usb_device import UsbDevice

RATE_HZ: Final = 5000.0


class Backend(UsbDevice):
    """One board, plugged in."""

    ids = (0x16C0, 0x05DC)

    def __init__(self) -> None:
        self.peer = Peer(SimulatedSource(Plant(), RATE_HZ))
        self.peer.give(1)  # compiled before anybody waits
        self.unplugged = False
        self._begun_s = time.monotonic()
        self._given = 0
        self._rest = b""

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        self._check()
        self.peer.take(bytes(data))
        return len(data)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        self._check()
        due = int((time.monotonic() - self._begun_s) * RATE_HZ) - self._given
        if not self._rest and due <= 0:
            import usb.core

            time.sleep(1e-3)
            raise usb.core.USBTimeoutError("nothing came in time")
        self._given += max(0, due)
        self._rest += self.peer.give(max(0, min(due, 512)))
        part, self._rest = self._rest[: len(buff)], self._rest[len(buff) :]
        memoryview(buff).cast("B")[: len(part)] = part
        return len(part)

    def _check(self) -> None:
        if self.unplugged:
            import usb.core

            raise usb.core.USBError("no such device (it may have been disconnected)", errno=19)


_BACKEND: Final = Backend()


def get_backend() -> Backend:
    """The backend, as pyusb's own modules give theirs."""
    return _BACKEND
