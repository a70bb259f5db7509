"""Functions and error codes of OpenHaptics' device library (HDAPI), called by ctypes. Not a driver."""

import ctypes
import math
import os
import sys
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_double, c_int, c_ubyte, c_uint, c_ulong, c_ushort, c_void_p
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.driver import Found
from hapscene.device.vendor_library import load_library
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.openhaptics_frame import DONE, ERROR_COUNT, FORCE, FORCE_OUTPUT, MODEL, NO_DEVICE, SERIAL

NAMES: Final = (None, "Default Device", "Default PHANToM", "Phantom2", "Phantom3", "Phantom4")
"""Device names that are tried in turn. Which of them is known depends on the version and setup of the vendor's
driver."""

LIBRARIES: Final = ("HD", "libHD.so", "HD.dll")
PRIORITY_MAX: Final = 65535
PRIORITY: Final = PRIORITY_MAX // 2
"""Default priority of the vendor's scheduler."""

WAIT_S: Final = 0.2
"""Longest time until the scheduler calls back [s]."""

STOPPED: Final = "the library's scheduler does not run; reconnect the device"

ERRORS: Final = {
    0x0100: ("HD_INVALID_ENUM", "unknown constant; the version of OpenHaptics may differ"),
    0x0101: ("HD_INVALID_VALUE", "invalid value"),
    0x0102: ("HD_INVALID_OPERATION", "the operation is not possible now"),
    0x0103: ("HD_INVALID_INPUT_TYPE", "invalid type"),
    0x0104: ("HD_BAD_HANDLE", "the device is no longer open; open it again"),
    0x0200: ("HD_WARM_MOTORS", "the motors are too warm; let them cool for some minutes"),
    0x0201: ("HD_EXCEEDED_MAX_FORCE", "the force exceeded the limit of the device"),
    0x0202: ("HD_EXCEEDED_MAX_FORCE_IMPULSE", "the force changed too fast"),
    0x0203: ("HD_EXCEEDED_MAX_VELOCITY", "the stylus moved too fast; hold it still"),
    0x0204: ("HD_FORCE_ERROR", "the device could not give the force"),
    0x0300: ("HD_DEVICE_FAULT", "device fault; reconnect the device"),
    0x0301: ("HD_DEVICE_ALREADY_INITIATED", "the device is in use; close the other program that uses it"),
    0x0302: ("HD_COMM_ERROR", "the device does not answer; check its cable and power"),
    0x0303: ("HD_COMM_CONFIG_ERROR", "the device is not configured; run the vendor's setup program"),
    0x0304: ("HD_TIMER_ERROR", "the library has no timer of sufficient resolution"),
    0x0400: ("HD_ILLEGAL_BEGIN", "a frame was begun twice"),
    0x0401: ("HD_ILLEGAL_END", "a frame was ended that was not begun"),
    0x0402: ("HD_FRAME_ERROR", "call outside of a frame"),
    0x0500: ("HD_INVALID_PRIORITY", f"priority must be 0 to {PRIORITY_MAX}"),
    0x0501: ("HD_SCHEDULER_FULL", "too many scheduled callbacks"),
    0x0600: ("HD_INVALID_LICENSE", "the vendor's licence is missing"),
}


class _ErrorInfo(ctypes.Structure):
    _fields_ = (("code", c_uint), ("internal", c_int), ("device", c_uint))


_FUNCTIONS: Final[dict[str, tuple[Any, ...]]] = {
    "hdInitDevice": (c_uint, c_char_p),
    "hdDisableDevice": (None, c_uint),
    "hdMakeCurrentDevice": (None, c_uint),
    "hdBeginFrame": (None, c_uint),
    "hdEndFrame": (None, c_uint),
    "hdEnable": (None, c_uint),
    "hdIsEnabled": (c_ubyte, c_uint),
    "hdGetIntegerv": (None, c_uint, POINTER(c_int)),
    "hdGetDoublev": (None, c_uint, POINTER(c_double)),
    "hdSetDoublev": (None, c_uint, POINTER(c_double)),
    "hdGetString": (c_char_p, c_uint),
    "hdGetError": (_ErrorInfo,),
    "hdCheckCalibration": (c_uint,),
    "hdUpdateCalibration": (None, c_uint),
    "hdSetSchedulerRate": (None, c_ulong),
    "hdStartScheduler": (None,),
    "hdStopScheduler": (None,),
    "hdScheduleAsynchronous": (c_ulong, c_void_p, c_void_p, c_ushort),
    "hdUnschedule": (None, c_ulong),
}


def load(path: str | None) -> Any:
    """Load the library at `path`, or by default that on the system's path.

    Raises:
        DeviceError: the library is not found, does not load, or lacks a function.
    """
    return load_library("openhaptics", path, LIBRARIES, _FUNCTIONS, remedy())


def remedy() -> str:
    """Remedy where no device can be opened."""
    text = "install OpenHaptics and the device's drivers, or name the library: --option library=PATH"
    if sys.platform.startswith("linux") and "GTDD_HOME" not in os.environ:
        text += "; GTDD_HOME, which the drivers of the Touch need, is not set: log in again after the installation"
    return text


def pop_errors(hd: Any) -> list[int]:
    """Take all errors from the library's stack, newest first."""
    errors: list[int] = []
    while len(errors) < ERROR_COUNT and (code := int(hd.hdGetError().code)):
        errors.append(code)
    return errors


def error_text(code: int) -> str:
    """Name and meaning of an error code of the library."""
    name, meaning = ERRORS.get(code, ("unknown error", "see the vendor's documentation"))
    return f"{name} (0x{code:04X}): {meaning}"


def check(hd: Any, operation: str) -> None:
    """Raise the oldest error on the library's stack as a `DeviceError`; `operation` describes what failed."""
    if errors := pop_errors(hd):
        raise DeviceError(f"openhaptics: {operation}: {error_text(errors[-1])}")


def numbers_of(hd: Any, what: int, count: int) -> NDArray[np.float64]:
    """Query `count` numbers of a device; NaN if it does not provide them."""
    values = (c_double * 16)(*[math.nan] * 16)
    hd.hdGetDoublev(what, values)
    return np.array(values[:count]) if not pop_errors(hd) else np.full(count, math.nan)


def initiate(hd: Any, name: str | None) -> int:
    """Open a device by its name, or by the first usual name that works. Returns its handle.

    Raises:
        DeviceError: no device can be opened.
    """
    refused = []
    for tried in NAMES if name is None else (name,):
        device = int(hd.hdInitDevice(None if tried is None else tried.encode()))
        errors = pop_errors(hd)
        if device != NO_DEVICE and not errors:
            return device
        if device != NO_DEVICE:
            hd.hdDisableDevice(device)
        refused.append(f"{tried or 'NULL'}: {error_text(errors[-1]) if errors else 'refused without an error'}")
    raise DeviceError(f"openhaptics: no device can be opened ({'; '.join(refused)}); {remedy()}")


def wait_until(over: Callable[[], bool], clock: Clock = CLOCK) -> bool:
    """Wait up to `WAIT_S` for a condition. Returns whether it occurred.

    On a busy machine this thread may not run for longer than that: the condition is looked at once more afterwards.
    """
    end_s = clock.now_s() + WAIT_S
    while not over():
        if clock.now_s() > end_s:
            return over()
        clock.sleep_s(2e-4)
    return True


def find(library: str | None = None, name: str | None = None, **options: Any) -> Sequence[Found]:
    """The connected device, or the reason why none can be opened."""
    try:
        hd = load(library)
        device = initiate(hd, name)
    except DeviceError as error:
        return [Found("", trouble=str(error).removeprefix("openhaptics: "), remedy=remedy())]
    texts = [hd.hdGetString(what) or b"" for what in (MODEL, SERIAL)]
    hd.hdDisableDevice(device)
    pop_errors(hd)
    return [Found(" ".join(text.decode(errors="replace") for text in texts).strip() or "unnamed")]


def release(library: str | None = None, name: str | None = None, **options: Any) -> None:
    """Open the device again and set zero force, without compiled code, which could take long to load."""
    hd = load(library)
    device, zero, calls = initiate(hd, name), (c_double * 3)(), []

    def set_zero(context: Any) -> int:
        hd.hdBeginFrame(device)
        hd.hdSetDoublev(int(FORCE), zero)
        hd.hdEndFrame(device)
        calls.append(True)
        return int(DONE)

    callback = CFUNCTYPE(c_uint, c_void_p)(set_zero)
    hd.hdEnable(int(FORCE_OUTPUT))
    hd.hdStartScheduler()
    handle = hd.hdScheduleAsynchronous(callback, None, PRIORITY)
    wait_until(lambda: bool(calls))
    hd.hdUnschedule(handle)
    hd.hdStopScheduler()
    hd.hdDisableDevice(device)
    pop_errors(hd)
    if not calls:
        raise DeviceError(f"openhaptics: {STOPPED}")
