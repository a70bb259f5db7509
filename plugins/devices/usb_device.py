"""USB devices for drivers: pyusb with a selectable backend, and errors that name a remedy. Not a driver."""

import errno
import importlib
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

from hapscene.device.driver import Found, Option
from hapscene.errors import DeviceError
from hapscene_plugins.devices.usb_transfers import Transfers

BACKEND: Final = Option("backend", None, "pyusb backend: libusb1, or a module with get_backend()")
"""Option of every USB driver."""

ENDPOINT_IN: Final = 0x80
"""Bit in the address of an endpoint from the device to the computer."""

USB_MODULES: Final = ("usb.core", "usb.util", "usb.backend.libusb1")
"""Modules that a driver of a USB device imports when it is opened (`Driver.imports`)."""

_EXTRA: Final = "pip install 'hapscene[usb]'"
_LIBUSB: Final = "install libusb (Debian: apt install libusb-1.0-0; macOS: brew install libusb)"


def _remedy(vendor: int, product: int, error: Exception) -> str:
    """Remedy for an error on opening a device."""
    if getattr(error, "errno", None) == errno.EBUSY:
        return "close the other program that uses it"
    if sys.platform == "win32":
        return "install the driver WinUSB for it (with Zadig), and reconnect it"
    rule = f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", TAG+="uaccess"'
    return f"add the line {rule} to /etc/udev/rules.d/60-hapscene.rules, and reconnect the device"


def _backend(name: str | None) -> Any:
    """The backend with the given name; None for the default of pyusb.

    Raises:
        DeviceError: pyusb, the backend, or the library of the backend is not installed.
    """
    try:
        importlib.import_module("usb.core")
    except ImportError:
        raise DeviceError(f"USB: pyusb is not installed; {_EXTRA}") from None
    if name is None:
        return None
    module = "usb.backend.libusb1" if name == "libusb1" else name
    try:
        backend = importlib.import_module(module).get_backend()
    except (ImportError, AttributeError) as error:
        raise DeviceError(f"option backend={name}: {error}; expected a {BACKEND.meaning}") from None
    if backend is None:
        raise DeviceError(f"option backend={name}: its library is not installed; {_LIBUSB}")
    return backend


def _devices(vendor: int, product: int, backend: str | None) -> list[Any]:
    chosen = _backend(backend)
    import usb.core

    try:
        return list(usb.core.find(find_all=True, backend=chosen, idVendor=vendor, idProduct=product))
    except usb.core.NoBackendError:
        raise DeviceError(f"USB: no USB library found; {_LIBUSB}") from None
    except usb.core.USBError as error:
        raise DeviceError(f"USB: {error.strerror}") from None


def find_usb(vendor: int, product: int, backend: str | None = None) -> Sequence[Found]:
    """The connected devices with these ids. Opens each for a moment, to check the permission."""
    try:
        devices = _devices(vendor, product, backend)
    except DeviceError as error:
        trouble, _, remedy = str(error).partition("; ")
        return [Found(f"{vendor:04x}:{product:04x}", trouble=trouble, remedy=remedy)]
    import usb.core
    import usb.util

    found = []
    for device in devices:
        where, trouble, remedy = f"USB {device.bus}:{device.address}", "", ""
        try:
            device.get_active_configuration()
        except (usb.core.USBError, NotImplementedError) as error:
            trouble, remedy = f"{where}: cannot be opened: {error}", _remedy(vendor, product, error)
        usb.util.dispose_resources(device)
        found.append(Found(where, trouble=trouble, remedy=remedy))
    return found


class UsbDevice:
    """An open USB device. Every error is a `DeviceError` that starts with `name`."""

    def __init__(self, name: str, vendor: int, product: int, backend: str | None) -> None:
        """Open the first device with these ids.

        Raises:
            DeviceError: not connected, or no permission.
        """
        self._name, self._closed = name, False
        self._transfers: Transfers | None = None
        try:
            devices = _devices(vendor, product, backend)
        except DeviceError as error:
            raise DeviceError(f"{name}: {error}") from None
        if not devices:
            raise DeviceError(f"{name}: not connected (no USB device {vendor:04x}:{product:04x})")
        import usb.core
        import usb.util

        self._usb, self._timeout = devices[0], usb.core.USBTimeoutError
        self._dispose = usb.util.dispose_resources
        try:
            try:
                if self._usb.is_kernel_driver_active(0):
                    self._usb.detach_kernel_driver(0)
            except NotImplementedError:
                pass  # only Linux has a kernel driver to detach
            self._usb.set_configuration()
            usb.util.claim_interface(self._usb, 0)
            self.endpoints = tuple(end.bEndpointAddress for end in self._usb.get_active_configuration()[(0, 0)])
        except (OSError, NotImplementedError) as error:  # USBError is an OSError; Windows without a driver: the other
            self.close()
            raise DeviceError(f"{name}: cannot be opened: {error}; {_remedy(vendor, product, error)}") from None

    def endpoint_pair(self, expected: str) -> tuple[int, int]:
        """Addresses of the first IN and the first OUT endpoint. `expected` names the device in the error.

        Raises:
            DeviceError: an endpoint is missing. The device is then closed.
        """
        inputs = [end for end in self.endpoints if end & ENDPOINT_IN]
        outputs = [end for end in self.endpoints if not end & ENDPOINT_IN]
        if not inputs or not outputs:
            self.close()
            raise DeviceError(f"{self._name}: no IN and OUT endpoint in the first interface; it is not {expected}")
        return inputs[0], outputs[0]

    def control(self, request: int, value: int) -> None:
        """Send a vendor request without data.

        Raises:
            DeviceError: the device was disconnected.
        """
        try:
            self._usb.ctrl_transfer(0x40, request, value, 0, None, 1000)
        except OSError as error:  # includes USBError
            raise self._gone(error) from None

    def write(self, endpoint: int, data: bytes) -> None:
        """Send bytes.

        Raises:
            DeviceError: the device was disconnected, or did not accept the data within 50 ms.
        """
        try:
            sent = self._usb.write(endpoint, data, 50)
        except OSError as error:  # includes USBError
            raise self._gone(error) from None
        if sent != len(data):
            raise DeviceError(f"{self._name}: accepted only {sent} of {len(data)} bytes; reconnect it")

    def read(self, endpoint: int, size: int, wait_ms: int) -> bytes:
        """Receive up to `size` bytes within `wait_ms` ≥ 1; b"" on a timeout.

        Raises:
            DeviceError: the device was disconnected.
        """
        try:
            return bytes(self._usb.read(endpoint, size, wait_ms))
        except self._timeout:
            return b""
        except OSError as error:  # includes USBError
            raise self._gone(error) from None

    def transfers(self, ends: tuple[int, int]) -> Transfers:
        """Start transfers for compiled code at an IN and an OUT endpoint. `close` ends them.

        Raises:
            DeviceError: the backend has no such transfers. The device is then closed.
        """
        try:
            self._transfers = Transfers(self._usb, ends)
        except DeviceError as error:
            self.close()
            raise DeviceError(f"{self._name}: {error}") from None
        return self._transfers

    def end_transfers(self) -> None:
        """End the transfers for compiled code."""
        if self._transfers is not None:
            self._transfers.close()
        self._transfers = None

    def close(self, endpoint: int = 0, last: bytes = b"") -> None:
        """Send `last` if not empty, and release the device. Raises nothing; may be called twice."""
        if self._closed:
            return  # pyusb would open the device again for a write
        self._closed = True
        self.end_transfers()
        if last:
            with suppress(DeviceError):  # a disconnected device gives no force
                self.write(endpoint, last)
        with suppress(OSError):
            self._dispose(self._usb)

    def _gone(self, error: BaseException) -> DeviceError:
        return DeviceError(f"{self._name}: disconnected ({error}); reconnect it")
