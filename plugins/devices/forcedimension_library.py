"""Functions, trouble codes and error texts of Force Dimension's library (DHD), called by ctypes. Not a driver."""

import sys
from ctypes import POINTER, c_byte, c_char_p, c_double, c_int, c_ubyte, c_uint
from typing import Any, Final

from hapscene.device.vendor_library import load_library

LIBRARIES: Final = ("dhd", "drd", "libdhd.so", "libdrd.so", "dhd64.dll", "drd64.dll")
# trouble codes: of the device; causes of a disabled force, from 20; errors of the library, from 100
MOTORS_SATURATED, NO_POWER, NOT_CONNECTED, NOT_CALIBRATED, FAULT, BRAKED, NOT_FINITE = range(1, 8)
OFF, CALL = 20, 100
TROUBLES: Final = {
    MOTORS_SATURATED: "the motors are saturated: the force is less than commanded",
    NO_POWER: "the device has no power: switch it on",
    NOT_CONNECTED: "the device is not connected: check the cable",
    NOT_CALIBRATED: "the device is not calibrated: move it as described in its manual (Falcon: out and in)",
    FAULT: "the device reports a fault: switch it off and on",
    BRAKED: "the device brakes, for example after a fast movement: press its force button",
    NOT_FINITE: "the device sends invalid positions: switch it off and on",
    OFF + 0: "the force is being enabled",
    OFF + 1: "the force was disabled by its button: press it again",
    OFF + 2: "the force was disabled after a fast movement: press the force button",
    OFF + 3: "the force was disabled by the watchdog; it is being enabled",
    OFF + 4: "the force was disabled by a program; it is being enabled",
    OFF + 5: "the force was disabled by a USB error: check the cable, and press the force button",
    OFF + 6: "the force is disabled until the handle is held",
}

NUMBER = POINTER(c_double)
FUNCTIONS: Final[dict[str, tuple[Any, ...]]] = {
    "dhdGetDeviceCount": (c_int,),
    "dhdOpenID": (c_int, c_byte),
    "dhdClose": (c_int, c_byte),
    "dhdStop": (c_int, c_byte),
    "dhdEnableExpertMode": (c_int,),
    "dhdGetStatus": (c_int, POINTER(c_int), c_byte),
    "dhdGetPosition": (c_int, NUMBER, NUMBER, NUMBER, c_byte),
    "dhdGetLinearVelocity": (c_int, NUMBER, NUMBER, NUMBER, c_byte),
    "dhdHasWrist": (c_int, c_byte),
    "dhdGetOrientationFrame": (c_int, NUMBER, c_byte),
    "dhdHasGripper": (c_int, c_byte),
    "dhdGetGripperAngleRad": (c_int, NUMBER, c_byte),
    "dhdGetButtonMask": (c_uint, c_byte),
    "dhdSetForce": (c_int, c_double, c_double, c_double, c_byte),
    "dhdEnableForce": (c_int, c_ubyte, c_byte),
    "dhdSetGravityCompensation": (c_int, c_int, c_byte),
    "dhdSetWatchdog": (c_int, c_ubyte, c_byte),
    "dhdSetMaxForce": (c_int, c_double, c_byte),
    "dhdSetTimeGuard": (c_int, c_int, c_byte),
    "dhdErrorGetLast": (c_int,),
    "dhdErrorGetStr": (c_char_p, c_int),
}


def remedy() -> str:
    text = "install the Force Dimension SDK, or name its library: --option library=PATH"
    if sys.platform.startswith("linux"):
        text += "; its USB device needs write permission (a udev rule)"
    return text


def load(path: str | None) -> Any:
    """Load the library at `path`, or by default that on the system's path.

    Raises:
        DeviceError: the library is not found, does not load, or lacks a function.
    """
    return load_library("forcedimension", path, LIBRARIES, FUNCTIONS, remedy())


def error_text(dhd: Any, code: int) -> str:
    """Text of an error of the library."""
    text = (dhd.dhdErrorGetStr(code) or b"unknown").decode(errors="replace")
    return f"error {code} of the library: {text}"
