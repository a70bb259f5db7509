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
from functools import cache
from typing import Any, Final

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]  # numba forgets to say that it exports carray

from hapscene.c_call import c_caller
from hapscene.device.driver import DEVICE_STATE, Driver, Found, Option, VendorConnection
from hapscene.device.model import DEVICES
from hapscene.device.vendor_library import address_of, load_library
from hapscene.errors import DeviceError
from hapscene.native import INTERPRETED, CFunction, native
from hapscene.records import records
from hapscene.wall_clock import CLOCK, Clock

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

# what the library knows of no error for
_NOT_IN_INKWELL, _NOT_RESET, _NOT_FINITE, _FORCE_OFF, _NO_CALIBRATION = 1, 2, 3, 4, 5
_TROUBLES: Final = {
    _NOT_IN_INKWELL: "the device is not calibrated; put the stylus into the inkwell",
    _NOT_RESET: "the device is not calibrated; put the arm into its reset position, and open it with reset=yes",
    _NOT_FINITE: "the device gives positions that cannot be; unplug it, plug it in again",
    _FORCE_OFF: "the library has switched the forces off; open the device again",
    _NO_CALIBRATION: "the device does not say whether it is calibrated; open it again",
}

_BUTTONS, _POSITION, _TRANSFORM, _FORCE = (np.uint32(code) for code in (0x2000, 0x2050, 0x2052, 0x2700))
_MODEL, _SERIAL, _WORKSPACE, _STYLE, _MOST_FORCE = 0x2501, 0x2504, 0x2551, 0x2555, 0x2603
_TEMPERATURE, _FORCE_OUTPUT, _FORCE_CLAMPING = np.uint32(0x2605), np.uint32(0x4000), 0x4001
_CALIBRATED, _NEEDS_UPDATE, _NEEDS_HAND = 0x5000, 0x5001, 0x5002
_RESET, _AUTO, _INKWELL = 1, 2, 4
_NO_DEVICE: Final = 0xFFFFFFFF
_DONE, _CONTINUE = 0, 1

_SERVE, _ONCE, _END = 0, 1, 2  # what a callback is for: the servo's tick; a frame; a last one, without force
_FAR_MM: Final = 10_000.0  # no arm reaches there
_ERROR_COUNT: Final = 16  # of a frame's errors so many are looked at
_WARMTH_FRAMES: Final = 64  # warmth is asked for every so many
_BAD_FRAMES: Final = 20  # so many bad frames in turn are more than a moment
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

_CALLED: Final = (
    *("hdMakeCurrentDevice", "hdBeginFrame", "hdEndFrame", "hdIsEnabled", "hdCheckCalibration", "hdUpdateCalibration"),
    *("hdGetIntegerv", "hdGetDoublev", "hdSetDoublev", "hdGetError"),
)
"""The functions that compiled code calls."""

LINK: Final = np.dtype(
    [
        *[(name, "u8") for name in _CALLED],  # addresses
        ("tick", "u8"),
        ("context", "u8"),
        ("doubles", "f8", (16,)),  # what the library fills and reads
        ("integers", "i4", (4,)),
        ("doubles_at", "u8"),
        ("integers_at", "u8"),
        ("middle_mm", "f8", (3,)),  # of the workspace, in the library's axes
        ("force_N", "f8"),  # most that is sent
        ("device", "u4"),
        ("style", "u4"),  # calibration: AUTO or INKWELL, 0 for neither
        ("purpose", "i8"),  # SERVE, ONCE, END
        ("ended", "i8"),  # 1: the last frame is over
        ("frames", "i8"),  # so far
        ("bad", "i8"),  # frames in turn whose numbers cannot be
        ("tells_warmth", "i8"),
    ],
    align=True,
)
"""What the callback is called with, beside the state."""

_with_device = c_caller(types.void, types.uint32)
_with_values = c_caller(types.void, types.uint32, types.uintp)
_is_enabled = c_caller(types.uint8, types.uint32)
_check_calibration = c_caller(types.uint32)
_tick = c_caller(types.void, types.uintp)

_get_error = c_caller(types.uint64, types.uintp)
"""Of HDErrorInfo, 12 bytes by value, the first 8: the code, and the internal one. System V on x86-64 and AArch64 give
these in the register of an integer, and leave aside an argument that nobody asked for; Windows on x86-64 wants to be
told a place, as its first argument, and fills that."""

_FILLS_PLACE: Final = os.name == "nt"


@native
def _pop_error(link: Any) -> Any:
    """The gravest of the errors since last asked, of those the oldest: the cause. 0 for none."""
    found: Any = 0
    for _ in range(_ERROR_COUNT):
        told = _get_error(link.hdGetError, (link.integers_at,))
        code: Any = np.int64(link.integers[0]) if _FILLS_PLACE else np.int64(told & np.uint64(0xFFFFFFFF))
        if code == 0:
            break
        if code >> 8 != 2 or found == 0 or found >> 8 == 2:
            found = code
    return found


@native
def _read_frame(link: Any, state: Any) -> Any:
    """Fill the state, or leave it and say why: what went wrong since the last frame was read."""
    doubles = link.doubles
    doubles[0] = doubles[1] = doubles[2] = math.nan
    _with_values(link.hdGetDoublev, (_POSITION, link.doubles_at))
    p = (doubles[0], doubles[1], doubles[2])
    for i in range(16):
        doubles[i] = math.nan
    _with_values(link.hdGetDoublev, (_TRANSFORM, link.doubles_at))
    link.integers[0] = 0
    _with_values(link.hdGetIntegerv, (_BUTTONS, link.integers_at))
    buttons = np.int64(link.integers[0]) & 15
    error = _pop_error(link)
    if error != 0:
        return error
    whole = abs(p[0]) < _FAR_MM and abs(p[1]) < _FAR_MM and abs(p[2]) < _FAR_MM
    for j in range(3):
        for i in range(3):
            whole = whole and abs(doubles[4 * j + i]) < 1.01
    if not whole:
        return _NOT_FINITE
    middle, p_m, R = link.middle_mm, state.p_DT_m, state.R_DT
    p_m[0], p_m[1], p_m[2] = 1e-3 * (p[0] - middle[0]), -1e-3 * (p[2] - middle[2]), 1e-3 * (p[1] - middle[1])
    for j in range(3):
        R[0, j], R[1, j], R[2, j] = doubles[4 * j], -doubles[4 * j + 2], doubles[4 * j + 1]
    state.buttons = buttons
    state.count += 1
    if link.tells_warmth == 1 and link.frames % _WARMTH_FRAMES == 0:
        for i in range(6):
            doubles[i] = 0.0
        _with_values(link.hdGetDoublev, (_TEMPERATURE, link.doubles_at))
        state.heat = 0.0
        for i in range(6):
            state.heat = max(state.heat, doubles[i])
    return 0


@native
def _unready(link: Any, calibration: Any) -> int:
    """What stands in the way of forces on a device that answers."""
    if calibration == _CALIBRATED:
        return 0 if _is_enabled(link.hdIsEnabled, (_FORCE_OUTPUT,)) != 0 else _FORCE_OFF
    if calibration in (_NEEDS_HAND, _NEEDS_UPDATE):
        return _NOT_RESET if link.style == 0 else _NOT_IN_INKWELL
    return _NO_CALIBRATION


@native
def _write_frame(link: Any, state: Any) -> None:
    """Give the force, in the library's axes."""
    f, doubles = state.f_D_N, link.doubles
    square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
    share = 0.0
    if state.ready == 1 and link.purpose != _END and square < math.inf:
        share = 1.0 if square <= link.force_N * link.force_N else link.force_N / math.sqrt(square)
    doubles[0], doubles[1], doubles[2] = 0.0, 0.0, 0.0
    if share > 0.0:
        doubles[0], doubles[1], doubles[2] = share * f[0], share * f[2], -share * f[1]
    _with_values(link.hdSetDoublev, (_FORCE, link.doubles_at))


@native
def _serve(link: Any, state: Any) -> int:
    """A frame; whether the scheduler is to call again."""
    purpose = link.purpose
    _with_device(link.hdMakeCurrentDevice, (link.device,))
    calibration: Any = np.int64(_check_calibration(link.hdCheckCalibration, ()))
    if calibration == _NEEDS_UPDATE and link.style != 0:
        _with_device(link.hdUpdateCalibration, (link.style,))
    _with_device(link.hdBeginFrame, (link.device,))
    trouble = _read_frame(link, state)
    link.bad = link.bad + 1 if trouble == _NOT_FINITE else 0
    if trouble == 0:
        trouble = _unready(link, calibration)
    state.trouble, state.ready = trouble, 1 if trouble == 0 else 0
    if purpose == _SERVE:
        _tick(link.tick, (link.context,))
    _write_frame(link, state)
    _with_device(link.hdEndFrame, (link.device,))
    link.frames += 1
    if purpose == _END:
        link.ended = 1
    return _CONTINUE if purpose == _SERVE else _DONE


def _served(places: Any) -> Any:
    return np.uint32(_serve(carray(places[0], 1, LINK)[0], carray(places[1], 1, DEVICE_STATE)[0]))


@cache
def _callback() -> Any:
    """The scheduler's callback: a C function `unsigned int callback(void *places[2])`, of link and state."""
    pointer: Any = types.CPointer
    return CFunction(types.uint32(pointer(types.voidptr)), _served, uses_carray=True)


def _pop(hd: Any) -> list[int]:
    """The errors there are, newest first."""
    errors: list[int] = []
    while len(errors) < _ERROR_COUNT and (code := int(hd.hdGetError().code)):
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
        if device != _NO_DEVICE and not errors:
            return device
        if device != _NO_DEVICE:
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
        self._address = int(_callback().address)
        self._device: int | None = _initiate(self._hd, name)
        try:
            self._set_up(rate, reset)
        except BaseException:
            self.close()
            raise

    def _set_up(self, rate: int, reset: bool) -> None:
        hd, link = self._hd, self._link
        for function in _CALLED:
            link[function] = address_of(getattr(hd, function))
        link.doubles_at, link.integers_at = link.doubles.ctypes.data, link.integers.ctypes.data
        link.device = self._device
        style = (c_int * 1)(0)
        hd.hdGetIntegerv(_STYLE, style)
        self._check("calibration style")
        link.style = _AUTO if style[0] & _AUTO else style[0] & _INKWELL
        box = self._ask(_WORKSPACE, 6)
        if np.all(np.isfinite(box)):
            link.middle_mm = (box[:3] + box[3:]) / 2.0
        known = DEVICES["omni"].limits.force_N
        told = float(self._ask(_MOST_FORCE, 1)[0])
        link.force_N = min(known, told) if told > 0.0 else known
        link.tells_warmth = int(np.all(np.isfinite(self._ask(int(_TEMPERATURE), 3))))
        if reset:
            hd.hdUpdateCalibration(_RESET)
            self._check("calibration of the encoders")
        for capability in (int(_FORCE_OUTPUT), _FORCE_CLAMPING):
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
        self._link.purpose = _ONCE
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
        if trouble >> 8 == 3 or self._link.bad[0] >= _BAD_FRAMES:
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
        link.tick, link.context, link.purpose = tick, context, _SERVE
        self._moved, self._moved_s = -1, 0.0
        self._handle = self._hand_over()

    def unschedule(self) -> None:
        if self._handle is not None:
            self._end()

    def _end(self) -> None:
        """A last frame without force; from then on no call."""
        link = self._link
        link.ended, link.purpose = 0, _END
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
        return _TROUBLES.get(trouble) or (error_text(trouble) if trouble else "")


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
    words = [hd.hdGetString(what) or b"" for what in (_MODEL, _SERIAL)]
    hd.hdDisableDevice(device)
    _pop(hd)
    return [Found(" ".join(word.decode(errors="replace") for word in words).strip() or "unnamed")]


def release(library: str | None = None, name: str | None = None, **options: Any) -> None:
    """Open it anew, and give zero: at once, with nothing to be compiled."""
    hd = load_library("openhaptics", library, LIBRARIES, _FUNCTIONS, _remedy())
    device, nothing, given = _initiate(hd, name), (c_double * 3)(), []

    def give(context: Any) -> int:
        hd.hdBeginFrame(device)
        hd.hdSetDoublev(int(_FORCE), nothing)
        hd.hdEndFrame(device)
        given.append(True)
        return _DONE

    callback = CFUNCTYPE(c_uint, c_void_p)(give)
    hd.hdEnable(int(_FORCE_OUTPUT))
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
