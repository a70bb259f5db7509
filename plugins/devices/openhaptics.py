"""Phantom Omni and Touch, through the vendor's library (OpenHaptics, HDAPI), which the user installs.

The vendor's scheduler has its own thread. Once a period it calls compiled code (`openhaptics_frame`):

    calibrate   if the device requests it
    read        position, transform, buttons, motor temperature, errors of the library
    tick        that of the servo
    write       the force; zero if any of the above failed

The library's axes are x to the right, y up, z towards the user, in mm. Transforms are column-major.
"""

from contextlib import suppress
from ctypes import c_int
from typing import Final

import numpy as np

from hapscene.compiled.native import INTERPRETED
from hapscene.device.driver import Driver, Option, VendorConnection
from hapscene.device.model import DEVICES
from hapscene.device.vendor_library import address_of
from hapscene.errors import DeviceError
from hapscene.records import records
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.openhaptics_frame import (
    AUTO,
    BAD_FRAMES,
    CALLED,
    END,
    FORCE_CLAMPING,
    FORCE_OUTPUT,
    INKWELL,
    LINK,
    MOST_FORCE,
    ONCE,
    RESET,
    SERVE,
    STYLE,
    TEMPERATURE,
    TROUBLES,
    WORKSPACE,
    callback,
)
from hapscene_plugins.devices.openhaptics_library import (
    PRIORITY,
    PRIORITY_MAX,
    STOPPED,
    WAIT_S,
    check,
    error_text,
    find,
    initiate,
    load,
    numbers_of,
    pop_errors,
    release,
    wait_until,
)

_OPEN: Final[list[int]] = []
"""Open devices of this process: they share the library's scheduler."""


class OpenHapticsConnection(VendorConnection):
    """An open Omni or Touch. The arguments are `DRIVER.options`.

    Raises:
        DeviceError: the library is not found, or no device can be used.
    """

    def __init__(
        self, library: str | None, name: str | None, rate: int, priority: int, reset: bool, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        self._clock = clock
        if INTERPRETED:
            raise DeviceError("openhaptics: needs compiled code; unset NUMBA_DISABLE_JIT")
        if not 0 <= priority <= PRIORITY_MAX:
            raise DeviceError(f"openhaptics: option priority={priority}: expected an integer from 0 to {PRIORITY_MAX}")
        self._hd = load(library)
        self._handle: int | None = None
        self._priority = priority
        self._link = records(1, LINK)
        self._places = np.zeros(2, np.uint64)
        self._frame_s, self._frames = 0.0, 0
        self._address = int(callback().address)
        if _OPEN:  # devices are added while the scheduler is stopped
            self._hd.hdStopScheduler()
        self._device: int | None = None
        try:
            self._device = initiate(self._hd, name)
        except DeviceError:
            if _OPEN:
                self._hd.hdStartScheduler()
            raise
        _OPEN.append(self._device)
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
        link["device"] = self._device
        style = (c_int * 1)(0)
        hd.hdGetIntegerv(STYLE, style)
        check(hd, "calibration style")
        link.style = AUTO if style[0] & AUTO else style[0] & INKWELL
        box = numbers_of(hd, WORKSPACE, 6)
        if np.all(np.isfinite(box)):
            link.middle_mm = (box[:3] + box[3:]) / 2.0
        known = DEVICES["omni"].limits.force_N
        reported = float(numbers_of(hd, MOST_FORCE, 1)[0])
        link.force_N = min(known, reported) if reported > 0.0 else known
        link.has_temperature = int(np.all(np.isfinite(numbers_of(hd, int(TEMPERATURE), 3))))
        if reset:
            hd.hdUpdateCalibration(RESET)
            check(hd, "calibration of the encoders")
        for capability in (int(FORCE_OUTPUT), FORCE_CLAMPING):
            hd.hdEnable(capability)
            check(hd, f"enabling 0x{capability:04X}")
        hd.hdSetSchedulerRate(rate)
        check(hd, f"option rate={rate}")
        hd.hdStartScheduler()
        check(hd, "start of the scheduler")

    def read(self) -> None:
        """Read the state and send the force, in one frame of the scheduler."""
        self._link.purpose = ONCE
        self._schedule_callback()
        self._raise_fault()

    write = read

    def _schedule_callback(self) -> int:
        """Schedule the callback and wait for its first call. Returns the scheduler's handle."""
        if self._device is None:
            raise DeviceError("openhaptics: the device is closed")
        before = int(self._link.frames[0])
        handle = int(self._hd.hdScheduleAsynchronous(self._address, self._context(), self._priority))
        if not wait_until(lambda: int(self._link.frames[0]) > before, self._clock):
            errors = pop_errors(self._hd)
            self._hd.hdUnschedule(handle)
            raise DeviceError(f"openhaptics: {error_text(errors[-1]) if errors else STOPPED}")
        return handle

    def _raise_fault(self) -> None:
        trouble = int(self.state.trouble[0])
        if trouble >> 8 == 3 or self._link.bad[0] >= BAD_FRAMES:
            raise DeviceError(f"openhaptics: {self.reason(trouble)}")

    def check(self) -> None:
        self._raise_fault()
        frames, now_s = int(self._link.frames[0]), self._clock.now_s()
        if frames != self._frames:
            self._frames, self._frame_s = frames, now_s
        elif now_s - self._frame_s > WAIT_S:
            raise DeviceError(f"openhaptics: {STOPPED}")

    def _context(self) -> int:
        """Argument of the callback. The servo may have moved the state to other memory since the last call."""
        self._places[:] = self._link.ctypes.data, self.state.ctypes.data
        return int(self._places.ctypes.data)

    def schedule(self, tick: int, context: int) -> None:
        self.unschedule()
        link = self._link
        link.tick, link.context, link.purpose = tick, context, SERVE
        self._frames, self._frame_s = -1, 0.0
        self._handle = self._schedule_callback()

    def unschedule(self) -> None:
        if self._handle is not None:
            self._end()

    def _end(self) -> None:
        """Run a last frame without force, and unschedule the callback."""
        link = self._link
        link.ended[0], link.purpose[0] = 0, END
        if self._handle is None:
            self._handle = self._hd.hdScheduleAsynchronous(self._address, self._context(), self._priority)
        ended = wait_until(lambda: int(link.ended[0]) == 1, self._clock)
        self._hd.hdUnschedule(self._handle)
        self._handle = None
        pop_errors(self._hd)
        self.state.f_D_N = 0.0
        if not ended:
            raise DeviceError(f"openhaptics: {STOPPED}")

    def close(self) -> None:
        if self._device is None:
            return
        with suppress(DeviceError):
            self._end()
        self._hd.hdStopScheduler()
        self._hd.hdDisableDevice(self._device)
        _OPEN.remove(self._device)
        if _OPEN:
            self._hd.hdStartScheduler()
        pop_errors(self._hd)
        self._device = None

    def reason(self, trouble: int) -> str:
        return TROUBLES.get(trouble) or (error_text(trouble) if trouble else "")


DRIVER = Driver(
    name="openhaptics",
    summary="Phantom Omni, Touch, and other devices of OpenHaptics.",
    open=OpenHapticsConnection,
    find=find,
    model=DEVICES["omni"],
    continuous_N=0.88,
    low_D_m=(-0.21, -0.13, -0.11),
    high_D_m=(0.21, 0.085, 0.205),
    orientation=True,
    button_count=2,
    rate_Hz=1000.0,
    needs="OpenHaptics (libHD.so, HD.dll), the device's drivers, and GTDD_HOME on Linux",
    options=(
        Option("library", None, "path of the vendor's library; by default HD on the system's path"),
        Option("name", None, "name of the device in the vendor's setup; by default the usual names are tried"),
        Option("rate", 1000, "rate of the vendor's scheduler [Hz]; each period is one haptic tick of 1 ms"),
        Option("priority", PRIORITY, f"priority of the tick in the vendor's scheduler, 0 to {PRIORITY_MAX}"),
        Option("reset", False, "whether the arm is in its reset position now, for the calibration"),
    ),
    release=release,
    assumptions=(
        "The device holds its last force when its process dies, until it is opened again and set to zero force.",
        "Omni and Touch have a continuous force of 0.88 N and a peak force of 3.3 N. The library's limit applies where "
        "it is lower.",
        "Walls up to 700 N/m, as in CHAI3D for the Omni; for the Touch CHAI3D has 400 N/m.",
        "The workspace is the full reach that the library reports for an Omni, around the middle of the usable one.",
        "The z axis of the library's transform is along the stylus, towards the hand.",
        "Several devices share one scheduler, which is stopped while a device is opened or closed.",
        "The motor temperature is 0 to 1, where 1 means warm motors.",
        "Any error of the library ends the force. A force that the library disabled remains disabled until the device "
        "is opened again.",
        "The return of a 12-byte structure on Windows and AArch64 follows the platforms' documents; only Linux on "
        "x86-64 was tested.",
    ),
)
