"""One frame of OpenHaptics' scheduler, in the vendor's thread. Compiled. Not a driver."""

import math
import os
from functools import cache
from typing import Any, Final

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]  # numba does not declare the export

from hapscene.compiled.entry import c_caller
from hapscene.compiled.native import CFunction, native
from hapscene.device.driver import DEVICE_STATE

# trouble codes without an error of the library
NOT_IN_INKWELL, NOT_RESET, NOT_FINITE, FORCE_OFF, NO_CALIBRATION = 1, 2, 3, 4, 5
TROUBLES: Final = {
    NOT_IN_INKWELL: "the device is not calibrated: put the stylus into the inkwell",
    NOT_RESET: "the device is not calibrated: move the arm to its reset position, and use --option reset=yes",
    NOT_FINITE: "the device sends invalid positions: reconnect it",
    FORCE_OFF: "the library has disabled the force: open the device again",
    NO_CALIBRATION: "the device does not report its calibration: open it again",
}

BUTTONS, POSITION, VELOCITY, TRANSFORM, FORCE = map(np.uint32, (0x2000, 0x2050, 0x2051, 0x2052, 0x2700))
MODEL, SERIAL, WORKSPACE, STYLE, MOST_FORCE = 0x2501, 0x2504, 0x2551, 0x2555, 0x2603
TEMPERATURE, FORCE_OUTPUT, FORCE_CLAMPING = np.uint32(0x2605), np.uint32(0x4000), 0x4001
_CALIBRATED, _NEEDS_UPDATE, _NEEDS_HAND = 0x5000, 0x5001, 0x5002
RESET, AUTO, INKWELL = 1, 2, 4
NO_DEVICE: Final = 0xFFFFFFFF
DONE, CONTINUE = 0, 1

SERVE, ONCE, END = 0, 1, 2  # purpose of a callback: ticks of the servo; one frame; the last frame, without force
_FAR_MM: Final = 10_000.0  # beyond the reach of all devices
ERROR_COUNT: Final = 16  # most errors that are read in a frame
_WARMTH_FRAMES: Final = 64  # frames between two readings of the motor temperature
BAD_FRAMES: Final = 20  # consecutive invalid frames before an error

CALLED: Final = (
    *("hdMakeCurrentDevice", "hdBeginFrame", "hdEndFrame", "hdIsEnabled", "hdCheckCalibration", "hdUpdateCalibration"),
    *("hdGetIntegerv", "hdGetDoublev", "hdSetDoublev", "hdGetError"),
)
"""Functions of the library that compiled code calls."""

LINK: Final = np.dtype(
    [
        *[(name, "u8") for name in CALLED],  # addresses
        ("tick", "u8"),
        ("context", "u8"),
        ("doubles", "f8", (16,)),  # buffers of the library calls
        ("integers", "i4", (4,)),
        ("doubles_at", "u8"),
        ("integers_at", "u8"),
        ("middle_mm", "f8", (3,)),  # middle of the workspace, in the library's axes
        ("force_N", "f8"),  # force limit
        ("device", "u4"),
        ("style", "u4"),  # calibration style: AUTO, INKWELL, or 0
        ("purpose", "i8"),  # SERVE, ONCE, END
        ("ended", "i8"),  # 1: the last frame is complete
        ("frames", "i8"),  # number of frames
        ("bad", "i8"),  # consecutive frames with invalid numbers
        ("has_temperature", "i8"),
    ],
    align=True,
)
"""Argument of the callback, in addition to the state."""

_with_device = c_caller(types.void, types.uint32)
_with_values = c_caller(types.void, types.uint32, types.uintp)
_is_enabled = c_caller(types.uint8, types.uint32)
_check_calibration = c_caller(types.uint32)
_tick = c_caller(types.void, types.uintp)

_get_error = c_caller(types.uint64, types.uintp)
"""hdGetError as a function that returns the first 8 of the 12 bytes of HDErrorInfo: code and internal code. System V on
x86-64 and AArch64 return them in an integer register, and ignore the extra argument. Windows on x86-64 expects the
address of the structure as first argument, and fills it."""

_FILLS_PLACE: Final = os.name == "nt"


@native
def _pop_error(link: Any) -> Any:
    """The most severe error since the last call, the oldest if there are several; 0 without an error."""
    found: Any = 0
    for _ in range(ERROR_COUNT):
        result = _get_error(link.hdGetError, (link.integers_at,))
        code: Any = np.int64(link.integers[0]) if _FILLS_PLACE else np.int64(result & np.uint64(0xFFFFFFFF))
        if code == 0:
            break
        if code >> 8 != 2 or found == 0 or found >> 8 == 2:
            found = code
    return found


@native
def _read_frame(link: Any, state: Any) -> Any:
    """Update the state. Returns 0, or the trouble code since the last frame; the state is then unchanged."""
    doubles = link.doubles
    doubles[0] = doubles[1] = doubles[2] = math.nan
    _with_values(link.hdGetDoublev, (POSITION, link.doubles_at))
    p = (doubles[0], doubles[1], doubles[2])
    _with_values(link.hdGetDoublev, (VELOCITY, link.doubles_at))
    v = (doubles[0], doubles[1], doubles[2])
    for i in range(16):
        doubles[i] = math.nan
    _with_values(link.hdGetDoublev, (TRANSFORM, link.doubles_at))
    link.integers[0] = 0
    _with_values(link.hdGetIntegerv, (BUTTONS, link.integers_at))
    buttons = np.int64(link.integers[0]) & 15
    error = _pop_error(link)
    if error != 0:
        return error
    whole = abs(p[0]) < _FAR_MM and abs(p[1]) < _FAR_MM and abs(p[2]) < _FAR_MM
    for j in range(3):
        for i in range(3):
            whole = whole and abs(doubles[4 * j + i]) < 1.01
    if not whole:
        return NOT_FINITE
    middle, p_m, R = link.middle_mm, state.p_DT_m, state.R_DT
    p_m[0], p_m[1], p_m[2] = 1e-3 * (p[0] - middle[0]), -1e-3 * (p[2] - middle[2]), 1e-3 * (p[1] - middle[1])
    for j in range(3):
        R[0, j], R[1, j], R[2, j] = doubles[4 * j], -doubles[4 * j + 2], doubles[4 * j + 1]
    state.v_DT_m_s[0], state.v_DT_m_s[1], state.v_DT_m_s[2] = 1e-3 * v[0], -1e-3 * v[2], 1e-3 * v[1]
    state.buttons = buttons
    state.count += 1
    if link.has_temperature == 1 and link.frames % _WARMTH_FRAMES == 0:
        for i in range(6):
            doubles[i] = 0.0
        _with_values(link.hdGetDoublev, (TEMPERATURE, link.doubles_at))
        state.heat = 0.0
        for i in range(6):
            state.heat = max(state.heat, doubles[i])
    return 0


@native
def _unready(link: Any, calibration: Any) -> int:
    """The trouble code that prevents forces on a device that answers, or 0."""
    if calibration == _CALIBRATED:
        return 0 if _is_enabled(link.hdIsEnabled, (FORCE_OUTPUT,)) != 0 else FORCE_OFF
    if calibration in (_NEEDS_HAND, _NEEDS_UPDATE):
        return NOT_RESET if link.style == 0 else NOT_IN_INKWELL
    return NO_CALIBRATION


@native
def _write_frame(link: Any, state: Any) -> None:
    """Send the force, in the library's axes."""
    f, doubles = state.f_D_N, link.doubles
    square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
    share = 0.0
    if state.ready == 1 and link.purpose != END and square < math.inf:
        share = 1.0 if square <= link.force_N * link.force_N else link.force_N / math.sqrt(square)
    doubles[0], doubles[1], doubles[2] = 0.0, 0.0, 0.0
    if share > 0.0:
        doubles[0], doubles[1], doubles[2] = share * f[0], share * f[2], -share * f[1]
    _with_values(link.hdSetDoublev, (FORCE, link.doubles_at))


@native
def _serve(link: Any, state: Any) -> int:
    """Process one frame: calibrate, read, tick, write. Returns whether the scheduler is to call again."""
    purpose = link.purpose
    _with_device(link.hdMakeCurrentDevice, (link.device,))
    calibration: Any = np.int64(_check_calibration(link.hdCheckCalibration, ()))
    if calibration == _NEEDS_UPDATE and link.style != 0:
        _with_device(link.hdUpdateCalibration, (link.style,))
    _with_device(link.hdBeginFrame, (link.device,))
    trouble = _read_frame(link, state)
    link.bad = link.bad + 1 if trouble == NOT_FINITE else 0
    if trouble == 0:
        trouble = _unready(link, calibration)
    state.trouble, state.ready = trouble, 1 if trouble == 0 else 0
    if purpose == SERVE:
        _tick(link.tick, (link.context,))
    _write_frame(link, state)
    _with_device(link.hdEndFrame, (link.device,))
    link.frames += 1
    if purpose == END:
        link.ended = 1
    return CONTINUE if purpose == SERVE else DONE


def _served(places: Any) -> Any:
    return np.uint32(_serve(carray(places[0], 1, LINK)[0], carray(places[1], 1, DEVICE_STATE)[0]))


@cache
def callback() -> Any:
    """The scheduler's callback: a C function `unsigned int callback(void *places[2])` with link and state."""
    pointer: Any = types.CPointer
    return CFunction(types.uint32(pointer(types.voidptr)), _served, uses_carray=True)
