"""A pyusb backend with one emulated device; it replaces libusb in tests."""

from types import SimpleNamespace
from typing import Any

__all__ = ["UsbDevice"]

_BASE = "bLength bDescriptorType extra_descriptors "
_DEVICE = "bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 bcdDevice iManufacturer iProduct "
_DEVICE += "iSerialNumber port_number port_numbers speed"


def _descriptor(zeros: str, **fields: Any) -> SimpleNamespace:
    return SimpleNamespace(**(dict.fromkeys((_BASE + zeros).split(), 0) | fields))


class UsbDevice:
    """A device with one configuration and one interface.

    Attributes:
        ids: vendor and product number.
        kind: type of the endpoints: 2 bulk, 3 interrupt.
        ends: addresses of the endpoints; bit 7 is set for those that the device sends on.
    """

    ids: tuple[int, int]
    kind = 2
    ends: tuple[int, ...] = (0x81, 0x02)

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Accept all of `data`; return its length."""
        raise NotImplementedError

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Write received data to the start of `buff` within `timeout` [ms]; return its length.

        Raises:
            USBTimeoutError: no data arrived.
        """
        raise NotImplementedError

    def intr_write(self, *arguments: Any) -> int:
        return self.bulk_write(*arguments)

    def intr_read(self, *arguments: Any) -> int:
        return self.bulk_read(*arguments)

    iso_write, iso_read = intr_write, intr_read  # pyusb looks up all of them for any endpoint

    def ctrl_transfer(self, handle: Any, kind: int, request: int, value: int, index: int, data: Any, wait: int) -> int:
        return 0

    def enumerate_devices(self) -> list[Any]:
        return [self]

    def get_device_descriptor(self, dev: Any) -> Any:
        vendor, product = self.ids
        return _descriptor(_DEVICE, idVendor=vendor, idProduct=product, bNumConfigurations=1, bus=1, address=1)

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        zeros = "wTotalLength iConfiguration bmAttributes bMaxPower"
        return _only(_descriptor(zeros, bNumInterfaces=1, bConfigurationValue=1), config)

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        zeros = "bInterfaceNumber bAlternateSetting bInterfaceClass bInterfaceSubClass bInterfaceProtocol iInterface"
        return _only(_descriptor(zeros, bNumEndpoints=len(self.ends)), intf + alt)

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> Any:
        fields = {"bEndpointAddress": self.ends[ep], "bmAttributes": self.kind, "wMaxPacketSize": 64}
        return _descriptor("bInterval bRefresh bSynchAddress", **fields)

    def open_device(self, dev: Any) -> Any:
        return dev

    def close_device(self, dev_handle: Any) -> None:
        pass

    def get_configuration(self, dev_handle: Any) -> int:
        return 1

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        pass

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        return False

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        pass

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        pass


def _only(descriptor: Any, index: int) -> Any:
    if index:
        raise IndexError
    return descriptor
