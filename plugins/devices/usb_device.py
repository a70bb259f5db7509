"""USB as the drivers use it: pyusb with a backend that can be chosen, its errors in our words. No driver itself."""

import errno
import importlib
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

from hapscene.device.driver import Found, Option
from hapscene.errors import DeviceError

BACKEND: Final = Option("backend", None, "pyusb's backend: libusb1, libusb0, openusb, or a module with get_backend()")
"""The option of every driver that speaks USB."""

USB_MODULES: Final = ("usb.core", "usb.util", "usb.backend.libusb1")
"""Modules that a driver of a USB device imports when it is opened (`Driver.imports`)."""

_EXTRA: Final = "pip install 'hapscene[usb]'"
_LIBUSB: Final = "install libusb (Debian: apt install libusb-1.0-0; macOS: brew install libusb)"


def _remedy(vendor: int, product: int, error: Exception) -> str:
    """What helps against what was said as it was opened."""
    if getattr(error, "errno", None) == errno.EBUSY:
        return "another program has it: close that"
    if sys.platform == "win32":
        return "give it the driver WinUSB (with Zadig), and plug it in again"
    rule = f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", TAG+="uaccess"'
    return f"put the line {rule} into /etc/udev/rules.d/60-hapscene.rules, and plug it in again"


def _backend(name: str | None) -> Any:
    """The backend of this name; None for pyusb's own choice.

    Raises:
        DeviceError: pyusb is missing, no such backend, or not the library that it needs.
    """
    try:
        importlib.import_module("usb.core")
    except ImportError:
        raise DeviceError(f"USB needs one more package: {_EXTRA}") from None
    if name is None:
        return None
    module = f"usb.backend.{name}" if name in ("libusb0", "libusb1", "openusb") else name
    try:
        backend = importlib.import_module(module).get_backend()
    except (ImportError, AttributeError) as error:
        raise DeviceError(f"backend={name}: is no backend of pyusb ({error}); {BACKEND.meaning}") from None
    if backend is None:
        raise DeviceError(f"backend={name}: the library that it needs is not there; {_LIBUSB}")
    return backend


def _devices(vendor: int, product: int, backend: str | None) -> list[Any]:
    chosen = _backend(backend)
    import usb.core

    try:
        return list(usb.core.find(find_all=True, backend=chosen, idVendor=vendor, idProduct=product))
    except usb.core.NoBackendError:
        raise DeviceError(f"USB: no library to reach it with; {_LIBUSB}") from None
    except usb.core.USBError as error:
        raise DeviceError(f"USB: {error.strerror}") from None


def find_usb(vendor: int, product: int, backend: str | None = None) -> Sequence[Found]:
    """The devices of these numbers that are plugged in; each is opened for a moment to see whether that is allowed."""
    try:
        devices = _devices(vendor, product, backend)
    except DeviceError as error:
        what, _, remedy = str(error).replace(": pip", "; pip").partition("; ")
        return [Found(f"{vendor:04x}:{product:04x}", trouble=what, remedy=remedy)]
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
    """One device that is open. Everything that goes wrong is a `DeviceError` that begins with `name`."""

    def __init__(self, name: str, vendor: int, product: int, backend: str | None) -> None:
        """Opens the first one.

        Raises:
            DeviceError: none is there, or it may not be opened.
        """
        self._name, self._closed = name, False
        try:
            devices = _devices(vendor, product, backend)
        except DeviceError as error:
            raise DeviceError(f"{name}: {error}") from None
        if not devices:
            raise DeviceError(f"{name}: none is plugged in (USB {vendor:04x}:{product:04x})")
        import usb.core
        import usb.util

        self._usb, self._timeout = devices[0], usb.core.USBTimeoutError
        self._let_go = usb.util.dispose_resources
        try:
            try:
                if self._usb.is_kernel_driver_active(0):
                    self._usb.detach_kernel_driver(0)
            except NotImplementedError:
                pass  # only Linux has one to be taken away
            self._usb.set_configuration()
            usb.util.claim_interface(self._usb, 0)
            self.endpoints = tuple(end.bEndpointAddress for end in self._usb.get_active_configuration()[(0, 0)])
        except (OSError, NotImplementedError) as error:  # USBError is the one; the other is Windows without a driver
            self.close()
            raise DeviceError(f"{name}: cannot be opened: {error}; {_remedy(vendor, product, error)}") from None

    def control(self, request: int, value: int) -> None:
        """A vendor's request without data.

        Raises:
            DeviceError: the device is gone.
        """
        try:
            self._usb.ctrl_transfer(0x40, request, value, 0, None, 1000)
        except OSError as error:  # as USBError is
            raise self._gone(error) from None

    def write(self, endpoint: int, data: bytes) -> None:
        """Send.

        Raises:
            DeviceError: the device is gone, or takes nothing for 50 ms.
        """
        try:
            sent = self._usb.write(endpoint, data, 50)
        except OSError as error:  # as USBError is
            raise self._gone(error) from None
        if sent != len(data):
            raise DeviceError(f"{self._name}: took {sent} of {len(data)} bytes; unplug it and plug it in again")

    def read(self, endpoint: int, size: int, wait_ms: int) -> bytes:
        """What it sends within `wait_ms` ≥ 1; nothing where it is silent.

        Raises:
            DeviceError: the device is gone.
        """
        try:
            return bytes(self._usb.read(endpoint, size, wait_ms))
        except self._timeout:
            return b""
        except OSError as error:  # as USBError is
            raise self._gone(error) from None

    def close(self, endpoint: int = 0, last: bytes = b"") -> None:
        """Send a last word, if there is one, and let go of it. Raises nothing; twice does no harm."""
        if self._closed:
            return  # pyusb would open it anew to write
        self._closed = True
        if last:
            with suppress(DeviceError):  # what is gone gives no force
                self.write(endpoint, last)
        with suppress(OSError):
            self._let_go(self._usb)

    def _gone(self, error: BaseException) -> DeviceError:
        return DeviceError(f"{self._name}: is gone ({error}); plug it in again")
