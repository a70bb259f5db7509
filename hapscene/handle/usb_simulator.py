"""A handle on USB without hardware: a backend of pyusb, in place of libusb, for `option backend=…` of the handle `usb`.

The board behind it is that of `port_simulator`. It keeps time: what is due by the clock can be read.
"""

import time
from types import SimpleNamespace
from typing import Any, Final

from hapscene.handle.force_source import SimulatedSource
from hapscene.handle.plant import Plant
from hapscene.handle.port_simulator import Peer

RATE_HZ: Final = 5000.0

_DEVICE: Final = SimpleNamespace(
    bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
    bMaxPacketSize0=64, idVendor=0x16C0, idProduct=0x05DC, bcdDevice=0x100, iManufacturer=0, iProduct=0,
    iSerialNumber=0, bNumConfigurations=1, bus=1, address=1, port_number=1, port_numbers=(1,), speed=3,
)  # fmt: skip
_CONFIGURATION: Final = SimpleNamespace(
    bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
    bmAttributes=0x80, bMaxPower=250, extra_descriptors=[],
)  # fmt: skip
_INTERFACE: Final = SimpleNamespace(
    bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2, bInterfaceClass=0xFF,
    bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=[],
)  # fmt: skip


class Backend:
    """One board, plugged in."""

    def __init__(self) -> None:
        self.peer = Peer(SimulatedSource(Plant(), RATE_HZ))
        self.peer.give(1)  # compiled before anybody waits
        self.unplugged = False
        self._begun_s = time.monotonic()
        self._given = 0
        self._rest = b""

    def enumerate_devices(self) -> list[Any]:
        return [self]

    def get_device_descriptor(self, dev: Any) -> Any:
        return _DEVICE

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        return _only(_CONFIGURATION, config)

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        return _only(_INTERFACE, intf + alt)

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> Any:
        address = (0x81, 0x02)[ep]
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=address, bmAttributes=2, wMaxPacketSize=512, bInterval=0,
            bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: Any) -> Any:
        return dev

    def close_device(self, dev_handle: Any) -> None:
        pass

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        pass

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        return False

    def get_configuration(self, dev_handle: Any) -> int:
        return 1

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        pass

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        pass

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

    intr_write = iso_write = bulk_write  # pyusb looks them all up, whatever the endpoint
    intr_read = iso_read = bulk_read

    def _check(self) -> None:
        if self.unplugged:
            import usb.core

            raise usb.core.USBError("no such device (it may have been disconnected)", errno=19)


def _only(descriptor: Any, index: int) -> Any:
    if index:
        raise IndexError
    return descriptor


_BACKEND: Final = Backend()


def get_backend() -> Backend:
    """The backend, as pyusb's own modules give theirs."""
    return _BACKEND
