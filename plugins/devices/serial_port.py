"""Search for serial ports, for drivers. Not a driver."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hapscene.device.driver import Found

PERMISSION: Final = "run: sudo usermod -aG dialout $USER, and log in again"


def find_ports(port: str | None = None) -> Sequence[Found]:
    """The given port, or all ports on USB. Does not open them, so what is connected to a port remains unknown."""
    if port:
        return [_found(port, port)]
    from serial.tools.list_ports import comports

    on_usb = sorted(each for each in comports() if each.vid is not None)  # ports on the mainboard have no device
    return [_found(each.device, f"{each.device} ({each.description})") for each in on_usb]


def _found(port: str, where: str) -> Found:
    trouble = remedy = ""
    if os.name == "posix" and not Path(port).exists():
        trouble, remedy = f"{port}: no such port", "connect the device, or name another port: --option port=NAME"
    elif os.name == "posix" and not os.access(port, os.R_OK | os.W_OK):
        trouble, remedy = f"{port}: no permission", PERMISSION
    return Found(where, {"port": port}, trouble, remedy)
