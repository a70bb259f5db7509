"""Phantom Omni and Touch, through the vendor's own library (OpenHaptics, HDAPI), which the user installs.

The vendor's scheduler has a thread of its own; in it, once a period and compiled:

    calibrate   where the device asks for it
    read        position, transform, buttons, warmth; what the library has to complain of
    tick        the servo's
    write       the force; none where anything above is not as it must be

The library's axes are x to the right, y up, z towards the user, in mm; transforms are column by column.
"""

import ctypes
import math
import os
import sys
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_double, c_int, c_ubyte, c_uint, c_ulong, c_ushort, c_void_p
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Driver, Found, Option, VendorConnection
from hapscene.device.model import DEVICES
from hapscene.device.vendor_library import address_of, load_library
from hapscene.errors import DeviceError
from hapscene.native import INTERPRETED
from hapscene.records import records
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.openhaptics_frame import (
    AUTO,
    BAD_FRAMES,
    CALLED,
    DONE,
    END,
    ERROR_COUNT,
    FORCE,
    FORCE_CLAMPING,
    FORCE_OUTPUT,
    INKWELL,
    LINK,
    MODEL,
    MOST_FORCE,
    NO_DEVICE,
    ONCE,
    RESET,
    SERIAL,
    SERVE,
    STYLE,
    TEMPERATURE,
    TROUBLES,
    WORKSPACE,
    callback,
)

NAMES: Final = (None, "Default Device", "Default PHANToM", "Phantom2", "Phantom3", "Phantom4")
"""What a device is asked for by, in turn: which of them a system knows differs with its drivers' version and setup."""

LIBRARIES: Final = ("HD", "libHD.so", "HD.dll")
PRIORITY_MAX: Final = 65535
PRIORITY: Final = PRIORITY_MAX // 2
"""The vendor's default."""

ERRORS: Final = {
    0x0100: ("HD_INVALID_ENUM", "the library does not know what it was asked; another version of OpenHaptics may"),
    0x0101: ("HD_INVALID_VALUE", "the library does not take this value"),
    0x0102: ("HD_INVALID_OPERATION", "this cannot be done now"),
    0x0103: ("HD_INVALID_INPUT_TYPE", "the library wants another type"),
    0x0104: ("HD_BAD_HANDLE", "there is no such device any more; open it again"),
    0x0200: ("HD_WARM_MOTORS", "the motors are too warm; let them cool for some minutes"),
    0x0201: ("HD_EXCEEDED_MAX_FORCE", "the force was over what the device gives"),
    0x0202: ("HD_EXCEEDED_MAX_FORCE_IMPULSE", "the force changed too fast"),
    0x0203: ("HD_EXCEEDED_MAX_VELOCITY", "the stylus moved too fast; let it rest"),
    0x0204: ("HD_FORCE_ERROR", "the device could not give the force"),
    0x0300: ("HD_DEVICE_FAULT", "the device has failed; unplug it, plug it in again"),
    0x0301: ("HD_DEVICE_ALREADY_INITIATED", "another program has the device; close that"),
    0x0302: ("HD_COMM_ERROR", "the device does not answer; see to its cable and power"),
    0x0303: ("HD_COMM_CONFIG_ERROR", "the device is not set up; run the vendor's setup program"),
    0x0304: ("HD_TIMER_ERROR", "the library has no timer that is good enough"),
    0x0400: ("HD_ILLEGAL_BEGIN", "a frame was begun twice"),
    0x0401: ("HD_ILLEGAL_END", "a frame was ended that was not begun"),
    0x0402: ("HD_FRAME_ERROR", "asked outside of a frame"),
    0x0500: ("HD_INVALID_PRIORITY", f"priority is 0 to {PRIORITY_MAX}"),
    0x0501: ("HD_SCHEDULER_FULL", "too much is scheduled"),
    0x0600: ("HD_INVALID_LICENSE", "the vendor's licence is missing"),
}

_WAIT_S: Final = 0.2  # what the scheduler has not begun by then, it does not
_STILL: Final = "the library's scheduler stands still; unplug the device, plug it in again"


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


def _pop(hd: Any) -> list[int]:
    """The errors there are, newest first."""
    errors: list[int] = []
    while len(errors) < ERROR_COUNT and (code := int(hd.hdGetError().code)):
        errors.append(code)
    return errors


def error_text(code: int) -> str:
    """An error of the library by name, and what it means; by number where it is not known."""
    name, meaning = ERRORS.get(code, ("an unknown error", "see the vendor's documents"))
    return f"{name} (0x{code:04X}): {meaning}"


def _remedy() -> str:
    text = "install OpenHaptics and the device's drivers, or say where the library is: library=PATH"
    if sys.platform.startswith("linux") and "GTDD_HOME" not in os.environ:
        text += "; GTDD_HOME is not set, and the Touch's drivers find nothing without: log in again after installing"
    return text


def _initiate(hd: Any, name: str | None) -> int:
    """Handle of a device, asked for by its name, or by all that are usual."""
    refused = []
    for asked in NAMES if name is None else (name,):
        device = int(hd.hdInitDevice(None if asked is None else asked.encode()))
        errors = _pop(hd)
        if device != NO_DEVICE and not errors:
            return device
        if device != NO_DEVICE:
            hd.hdDisableDevice(device)
        refused.append(f"{asked or 'NULL'}: {error_text(errors[-1]) if errors else 'refused without an error'}")
    raise DeviceError(f"openhaptics: no device can be opened ({'; '.join(refused)}); {_remedy()}")


class OpenHapticsConnection(VendorConnection):
    """An Omni or Touch that is open. See `DRIVER.options`.

    Raises:
        DeviceError: the library is missing, or no device can be used.
    """

    def __init__(
        self, library: str | None, name: str | None, rate: int, priority: int, reset: bool, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        self._clock = clock
        if INTERPRETED:
            raise DeviceError("openhaptics: the callback is compiled: it does not work with NUMBA_DISABLE_JIT=1")
        if not 0 <= priority <= PRIORITY_MAX:
            raise DeviceError(f"openhaptics: option priority={priority}: it is a whole number from 0 to {PRIORITY_MAX}")
        self._hd = load_library("openhaptics", library, LIBRARIES, _FUNCTIONS, _remedy())
        self._handle: int | None = None
        self._priority = priority
        self._link = records(1, LINK)
        self._places = np.zeros(2, np.uint64)
        self._moved_s, self._moved = 0.0, 0
        self._address = int(callback().address)
        self._device: int | None = _initiate(self._hd, name)
        try:
            self._set_up(rate, reset)
        except BaseException:
            self.close()
            raise

    def _set_up(self, rate: int, reset: bool) -> None:
        hd, link = self._hd, self._link
        for function in CALLED:
            link[function] = address_of(getattr(hd, function))
        link.doubles_at, link.integers_at = link.doubles.ctypes.data, link.integers.ctypes.data
        link.device = self._device
        style = (c_int * 1)(0)
        hd.hdGetIntegerv(STYLE, style)
        self._check("calibration style")
        link.style = AUTO if style[0] & AUTO else style[0] & INKWELL
        box = self._ask(WORKSPACE, 6)
        if np.all(np.isfinite(box)):
            link.middle_mm = (box[:3] + box[3:]) / 2.0
        known = DEVICES["omni"].limits.force_N
        told = float(self._ask(MOST_FORCE, 1)[0])
        link.force_N = min(known, told) if told > 0.0 else known
        link.tells_warmth = int(np.all(np.isfinite(self._ask(int(TEMPERATURE), 3))))
        if reset:
            hd.hdUpdateCalibration(RESET)
            self._check("calibration of the encoders")
        for capability in (int(FORCE_OUTPUT), FORCE_CLAMPING):
            hd.hdEnable(capability)
            self._check(f"enabling 0x{capability:04X}")
        hd.hdSetSchedulerRate(rate)
        self._check(f"rate={rate}")
        hd.hdStartScheduler()
        self._check("start of the scheduler")

    def _ask(self, what: int, count: int) -> Any:
        """(count,) numbers that not every device tells: NaN then."""
        values = (c_double * 16)(*[math.nan] * 16)
        self._hd.hdGetDoublev(what, values)
        return np.array(values[:count]) if not _pop(self._hd) else np.full(count, math.nan)

    def _check(self, doing: str) -> None:
        if errors := _pop(self._hd):
            raise DeviceError(f"openhaptics: {doing}: {error_text(errors[-1])}")

    def read(self) -> None:
        self._frame()

    def write(self) -> None:
        self._frame()

    def _frame(self) -> None:
        """Read, and send the force that is wanted, in a frame of the scheduler's."""
        self._link.purpose = ONCE
        self._hand_over()
        self._see()

    def _hand_over(self) -> int:
        """Have the scheduler call back, and wait until it has; the handle of that."""
        if self._device is None:
            raise DeviceError("openhaptics: the device is closed")
        before = int(self._link.frames[0])
        handle = int(self._hd.hdScheduleAsynchronous(self._address, self._context(), self._priority))
        if not _wait(lambda: int(self._link.frames[0]) > before, self._clock):
            errors = _pop(self._hd)
            self._hd.hdUnschedule(handle)
            raise DeviceError(f"openhaptics: {error_text(errors[-1]) if errors else _STILL}")
        return handle

    def _see(self) -> None:
        trouble = int(self.state.trouble[0])
        if trouble >> 8 == 3 or self._link.bad[0] >= BAD_FRAMES:
            raise DeviceError(f"openhaptics: {self.reason(trouble)}")

    def check(self) -> None:
        self._see()
        frames, now_s = int(self._link.frames[0]), self._clock.now_s()
        if frames != self._moved:
            self._moved, self._moved_s = frames, now_s
        elif now_s - self._moved_s > _WAIT_S:
            raise DeviceError(f"openhaptics: {_STILL}")

    def _context(self) -> int:
        """What the callback is called with; the state may have been put elsewhere."""
        self._places[:] = self._link.ctypes.data, self.state.ctypes.data
        return int(self._places.ctypes.data)

    def schedule(self, tick: int, context: int) -> None:
        self.unschedule()
        link = self._link
        link.tick, link.context, link.purpose = tick, context, SERVE
        self._moved, self._moved_s = -1, 0.0
        self._handle = self._hand_over()

    def unschedule(self) -> None:
        if self._handle is not None:
            self._end()

    def _end(self) -> None:
        """A last frame without force; from then on no call."""
        link = self._link
        link.ended, link.purpose = 0, END
        if self._handle is None:
            self._handle = self._hd.hdScheduleAsynchronous(self._address, self._context(), self._priority)
        _wait(lambda: int(link.ended[0]) == 1, self._clock)
        self._hd.hdUnschedule(self._handle)
        self._handle = None
        _pop(self._hd)
        self.state.f_D_N = 0.0

    def close(self) -> None:
        if self._device is None:
            return
        self._end()
        self._hd.hdStopScheduler()
        self._hd.hdDisableDevice(self._device)
        _pop(self._hd)
        self._device = None

    def reason(self, trouble: int) -> str:
        return TROUBLES.get(trouble) or (error_text(trouble) if trouble else "")


def _wait(over: Callable[[], bool], clock: Clock = CLOCK) -> bool:
    """Whether it is over before the scheduler counts as dead."""
    end_s = clock.now_s() + _WAIT_S
    while not over():
        if clock.now_s() > end_s:
            return False
        clock.sleep_s(2e-4)
    return True


def find(library: str | None = None, name: str | None = None, **options: Any) -> Sequence[Found]:
    """The device that answers, or why none does."""
    try:
        hd = load_library("openhaptics", library, LIBRARIES, _FUNCTIONS, _remedy())
        device = _initiate(hd, name)
    except DeviceError as error:
        return [Found("", trouble=str(error), remedy=_remedy())]
    words = [hd.hdGetString(what) or b"" for what in (MODEL, SERIAL)]
    hd.hdDisableDevice(device)
    _pop(hd)
    return [Found(" ".join(word.decode(errors="replace") for word in words).strip() or "unnamed")]


def release(library: str | None = None, name: str | None = None, **options: Any) -> None:
    """Open it anew, and give zero: at once, with nothing to be compiled."""
    hd = load_library("openhaptics", library, LIBRARIES, _FUNCTIONS, _remedy())
    device, nothing, given = _initiate(hd, name), (c_double * 3)(), []

    def give(context: Any) -> int:
        hd.hdBeginFrame(device)
        hd.hdSetDoublev(int(FORCE), nothing)
        hd.hdEndFrame(device)
        given.append(True)
        return int(DONE)

    callback = CFUNCTYPE(c_uint, c_void_p)(give)
    hd.hdEnable(int(FORCE_OUTPUT))
    hd.hdStartScheduler()
    handle = hd.hdScheduleAsynchronous(callback, None, PRIORITY)
    _wait(lambda: bool(given))
    hd.hdUnschedule(handle)
    hd.hdStopScheduler()
    hd.hdDisableDevice(device)
    _pop(hd)
    if not given:
        raise DeviceError(f"openhaptics: {_STILL}")


DRIVER = Driver(
    name="openhaptics",
    summary="Phantom Omni, Touch, and others that OpenHaptics drives.",
    open=OpenHapticsConnection,
    find=find,
    model=DEVICES["omni"],
    continuous_N=0.88,
    low_D_m=(-0.21, -0.13, -0.11),
    high_D_m=(0.21, 0.085, 0.205),
    orientation=True,
    button_count=2,
    rate_Hz=1000.0,
    needs="the vendor's library (libHD.so, HD.dll: OpenHaptics), its drivers, and on Linux GTDD_HOME",
    options=(
        Option("library", None, "path of the vendor's library; without, the system is asked for HD"),
        Option("name", None, "the device's name in the vendor's setup; without, the usual ones are tried"),
        Option("rate", 1000, "rate of the vendor's scheduler [Hz]: one tick of the servo each, which lasts 1 ms"),
        Option("priority", PRIORITY, f"of the tick among what the vendor's scheduler calls, 0 to {PRIORITY_MAX}"),
        Option("reset", False, "whether the arm stands in its reset position now, to be calibrated so"),
    ),
    release=release,
    assumptions=(
        "What the device does when its process dies is not known: it is taken to hold its last force, until it is "
        "opened anew and given zero.",
        "0.88 N for long and 3.3 N at most are taken for the Omni's and Touch's; the library's own maximum counts "
        "where it is less.",
        "Walls to 700 N/m are what CHAI3D names for the Omni; for the Touch it names 400.",
        "The workspace is the whole reach that the library names for an Omni, about the middle of the usable one.",
        "The library's transform has z along the stylus, towards the hand.",
        "Warmth is 0 to 1, where the library speaks of warm motors.",
        "Any error of the library ends the force; what it switched off by itself stays off until it is opened anew.",
        "On Windows and AArch64, how a structure of 12 bytes is returned follows the platforms' documents; only Linux "
        "on x86-64 was tried.",
    ),
)
