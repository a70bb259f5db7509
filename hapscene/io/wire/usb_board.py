"""A backend of pyusb with one device plugged in, in place of libusb: what a board without hardware derives from."""

from types import SimpleNamespace
from typing import Any

__all__ = ["UsbBoard"]

_BASE = "bLength bDescriptorType extra_descriptors "
_DEVICE = "bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 bcdDevice iManufacturer iProduct "
_DEVICE += "iSerialNumber port_number port_numbers speed"


def _descriptor(zeros: str, **fields: Any) -> SimpleNamespace:
    return SimpleNamespace(**(dict.fromkeys((_BASE + zeros).split(), 0) | fields))


class UsbBoard:
    """One configuration, one interface, and its endpoints.

    Attributes:
        ids: vendor's and product's number.
        kind: of its endpoints: 2 bulk, 3 interrupt.
        ends: their addresses; bit 7 is set of one that the board sends by.
    """

    ids: tuple[int, int]
    kind = 2
    ends: tuple[int, ...] = (0x81, 0x02)

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Take all of `data`, and say how much that is."""
        raise NotImplementedError

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Fill the beginning of `buff` within `timeout` [ms], and say how much.

        Raises:
            USBTimeoutError: nothing came.
        """
        raise NotImplementedError

    def intr_write(self, *told: Any) -> int:
        return self.bulk_write(*told)

    def intr_read(self, *told: Any) -> int:
        return self.bulk_read(*told)

    iso_write, iso_read = intr_write, intr_read  # pyusb looks them all up, whatever the endpoint

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
        told = {"bEndpointAddress": self.ends[ep], "bmAttributes": self.kind, "wMaxPacketSize": 64}
        return _descriptor("bInterval bRefresh bSynchAddress", **told)

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
