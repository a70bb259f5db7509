"""Serial ports as the drivers find them. No driver itself."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hapscene.device.driver import Found

PERMISSION: Final = "sudo usermod -aG dialout $USER, and log in anew"


def find_ports(port: str | None = None) -> Sequence[Found]:
    """The ports on USB, or the one that was told; none is opened, and none says what is behind it."""
    if port:
        return [_found(port, port)]
    from serial.tools.list_ports import comports

    plugged = sorted(there for there in comports() if there.vid is not None)  # not what every board has built in
    return [_found(there.device, f"{there.device} ({there.description})") for there in plugged]


def _found(port: str, where: str) -> Found:
    trouble = remedy = ""
    if os.name == "posix" and not Path(port).exists():
        trouble, remedy = f"{port}: no such port", "plug it in, or say another: --option port=NAME"
    elif os.name == "posix" and not os.access(port, os.R_OK | os.W_OK):
        trouble, remedy = f"{port}: no permission", PERMISSION
    return Found(where, {"port": port}, trouble, remedy)
