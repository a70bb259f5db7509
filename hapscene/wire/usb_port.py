"""A board on USB without a serial port between: one bulk endpoint each way, drained as a port is."""

import time
from importlib import import_module
from typing import Any, Final

from hapscene.errors import CaptureError
from hapscene.wire.port import LUMP_S, POLL_S, DrainedPort

PACKET: Final = 1 << 12
"""Bytes that are asked for at once: 2 ms of a board at 10 kHz take 600."""

WRITE_MS: Final = 500
"""How long a board may take nothing [ms]."""

VENDOR_CLASS: Final = 0xFF
"""Class of an interface that is nobody's standard."""


class UsbPort(DrainedPort):
    """The first interface of the vendor's own class with a bulk endpoint each way."""

    def __init__(self, vendor: int, product: int, serial: str = "", backend: str = "") -> None:
        """Opens it.

        Args:
            vendor, product: of the device.
            serial: number of the device; "" for the first that is there.
            backend: module with `get_backend()`, as those of pyusb have; "" for libusb.

        Raises:
            CaptureError: no pyusb, no libusb, no such device or interface, or no permission.
        """
        try:
            import usb.core
            import usb.util
        except ImportError:
            raise CaptureError("a handle on USB needs pyusb: pip install 'hapscene[usb]'") from None
        self._usb: Any = usb
        try:
            found = usb.core.find(
                idVendor=vendor,
                idProduct=product,
                backend=import_module(backend).get_backend() if backend else None,
                custom_match=lambda device: not serial or device.serial_number == serial,
            )
        except ImportError as error:
            raise CaptureError(f"backend {backend}: {error}") from None
        except (usb.core.NoBackendError, AttributeError):
            wanted = f"{backend}.get_backend()" if backend else "libusb: sudo apt-get install libusb-1.0-0"
            raise CaptureError(f"a handle on USB needs {wanted}") from None
        if found is None:
            raise CaptureError(f"no USB device {vendor:04x}:{product:04x} {serial}".rstrip())
        self._device: Any = found
        try:
            self._device.set_configuration()
            self._in, self._out = self._endpoints()
        except usb.core.USBError as error:
            raise CaptureError(
                f"the USB device {vendor:04x}:{product:04x} cannot be opened: {error.strerror or error}; on Linux a "
                "udev rule gives permission, on Windows the driver WinUSB (Zadig)"
            ) from None
        super().__init__()

    def _endpoints(self) -> tuple[Any, Any]:
        util = self._usb.util
        for interface in self._device.get_active_configuration():
            if interface.bInterfaceClass != VENDOR_CLASS:
                continue
            ways: dict[int, Any] = {}
            for endpoint in interface:
                if util.endpoint_type(endpoint.bmAttributes) == util.ENDPOINT_TYPE_BULK:
                    ways.setdefault(util.endpoint_direction(endpoint.bEndpointAddress), endpoint)
            if len(ways) == 2:
                util.claim_interface(self._device, interface.bInterfaceNumber)
                return ways[util.ENDPOINT_IN], ways[util.ENDPOINT_OUT]
        raise CaptureError("the USB device has no interface of the vendor's class with a bulk endpoint each way")

    def _drain(self) -> None:
        try:
            while not self._closing.is_set():
                try:
                    data = bytes(self._in.read(PACKET, timeout=round(1e3 * POLL_S)))
                except self._usb.core.USBTimeoutError:
                    continue
                if data:
                    self._pieces.put((data, time.monotonic()))
                self._closing.wait(LUMP_S)
        except self._usb.core.USBError as error:
            self._pieces.put(error.strerror or str(error))

    def write(self, data: bytes) -> None:
        """Send that.

        Raises:
            CaptureError: it is not taken.
        """
        try:
            self._out.write(data, timeout=WRITE_MS)
        except self._usb.core.USBError as error:
            raise CaptureError(f"the board takes nothing: {error.strerror or error}") from None

    def close(self) -> None:
        """Stops the thread, then lets go of the device."""
        super().close()
        self._usb.util.dispose_resources(self._device)
