"""Force Dimension devices (omega, delta, sigma, lambda) and the Falcon, through the vendor's library (DHD).

The library's axes are x towards the user, y to the right, z up, in m. The device's watchdog ends the force after
`WATCHDOG_S` without a command. Its velocity threshold is left as configured.
"""

import math
from collections.abc import Sequence
from ctypes import byref, c_double, c_int
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.device.model import Device, Limits
from hapscene.errors import DeviceError
from hapscene_plugins.devices.forcedimension_library import (
    BRAKED,
    CALL,
    FAULT,
    MOTORS_SATURATED,
    NO_POWER,
    NOT_CALIBRATED,
    NOT_CONNECTED,
    NOT_FINITE,
    NUMBER,
    OFF,
    TROUBLES,
    error_text,
    load,
    remedy,
)

WATCHDOG_S: Final = 0.020
"""Time without a new force after which the device stops the force [s]: 1 to 255 steps of 125 µs."""

LIMITS: Final = Limits(8.0, 8000.0, stiffness_N_m=3000.0, damping_Ns_m=20.0)

_STEP_S: Final = 125e-6
_FAR_M: Final = 10.0  # beyond the reach of all devices
_BAD_COUNT: Final = 20  # consecutive failures before an error
_ENABLE_READS: Final = 500  # reads between two attempts to enable the force
_OLD, _SATURATED = 1, 2  # results of successful calls
_POWER, _CONNECTED, _RESET, _FORCE, _BRAKE, _ERROR, _CAUSE = 0, 1, 3, 5, 6, 9, 14  # indices in the status

_COMES_BACK: Final = (0, 3, 4)  # causes after which the driver enables the force again
_TURN: Final = np.array(((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))  # from the library's axes to D


class ForceDimensionConnection(Connection):
    """An open device. The arguments are `DRIVER.options`.

    Raises:
        DeviceError: the library is not found, or the device cannot be used.
    """

    def __init__(self, library: str | None, device: int, gravity: bool) -> None:
        super().__init__()
        self._dhd = load(library)
        self._id = int(self._dhd.dhdOpenID(device))
        self._open = self._id >= 0
        if not self._open:
            raise DeviceError(f"forcedimension: device={device}: {self._error()}; {remedy()}")
        self._xyz, self._status = (c_double(), c_double(), c_double()), (c_int * 32)()
        self._bad_reads = self._bad_writes = self._reads = self._enable_at = 0
        self._saturated = False
        self._frame, self._angle = np.eye(3), c_double()
        self._wrist, self._gripper = self._dhd.dhdHasWrist(self._id) > 0, self._dhd.dhdHasGripper(self._id) > 0
        try:
            self._dhd.dhdEnableExpertMode()
            self._try("zero force", self._dhd.dhdSetForce(0.0, 0.0, 0.0, self._id))
            self._try("gravity", self._dhd.dhdSetGravityCompensation(int(gravity), self._id))
            self._try("largest force", self._dhd.dhdSetMaxForce(LIMITS.force_N, self._id))
            self._try("time guard", self._dhd.dhdSetTimeGuard(0, self._id))
            self._dhd.dhdSetWatchdog(round(WATCHDOG_S / _STEP_S), self._id)  # optional: see `release`
        except BaseException:
            self.close()
            raise

    def _error(self) -> str:
        code = int(self._dhd.dhdErrorGetLast())
        return str(error_text(self._dhd, code))

    def _try(self, operation: str, result: int) -> None:
        if result < 0:
            raise DeviceError(f"forcedimension: {operation}: {self._error()}")

    def read(self) -> None:
        state, dhd = self.state[0], self._dhd
        for number in self._xyz:
            number.value = math.nan
        result = dhd.dhdGetPosition(*map(byref, self._xyz), self._id)
        known = dhd.dhdGetStatus(self._status, self._id)
        self._reads += 1
        if result < 0 or known < 0:
            self._fail(CALL + int(dhd.dhdErrorGetLast()))
            return
        x, y, z = (number.value for number in self._xyz)
        if not (abs(x) < _FAR_M and abs(y) < _FAR_M and abs(z) < _FAR_M):
            self._fail(NOT_FINITE)
            return
        self._bad_reads = 0
        state.p_DT_m[:] = y, -x, z
        state.buttons = dhd.dhdGetButtonMask(self._id) & 0xFFFF
        self._read_optional(state)
        if result != _OLD:
            state.count += 1
        trouble = self._trouble()
        state.ready = int(trouble == 0)
        state.trouble = MOTORS_SATURATED if trouble == 0 and self._saturated else trouble

    def _read_optional(self, state: Any) -> None:
        """Update velocity, orientation and gripper, as far as the device has them."""
        known = self._dhd.dhdGetLinearVelocity(*map(byref, self._xyz), self._id) >= 0
        x, y, z = (number.value if known else math.nan for number in self._xyz)
        state.v_DT_m_s[:] = y, -x, z
        R = self._frame
        known = self._wrist and self._dhd.dhdGetOrientationFrame(R.ctypes.data_as(NUMBER), self._id) >= 0
        if known and np.abs(R).max() < 1.01:  # also False for NaN
            state.R_DT[:] = _TURN @ R[:, (1, 2, 0)]
        if self._gripper and self._dhd.dhdGetGripperAngleRad(byref(self._angle), self._id) >= 0:
            state.gripper_rad = self._angle.value

    def _fail(self, trouble: int) -> None:
        """Note a failed read."""
        self.state.ready, self.state.trouble = 0, trouble
        self._bad_reads += 1
        if self._bad_reads >= _BAD_COUNT:
            raise DeviceError(f"forcedimension: {self.reason(trouble)}")

    def _trouble(self) -> int:
        """The trouble code that prevents a force, or 0. Enables the force if it may be enabled."""
        status = self._status
        for trouble, met in (
            (NO_POWER, status[_POWER] == 0),
            (NOT_CONNECTED, status[_CONNECTED] == 0),
            (FAULT, status[_ERROR] != 0),
            (NOT_CALIBRATED, status[_RESET] != 0),
        ):
            if met:
                return int(trouble)
        if status[_FORCE] != 0:
            return int(BRAKED) if status[_BRAKE] != 0 else 0
        cause = status[_CAUSE]
        if cause in _COMES_BACK and self._reads >= self._enable_at:
            self._enable_at = self._reads + _ENABLE_READS
            self._dhd.dhdSetForce(0.0, 0.0, 0.0, self._id)
            self._dhd.dhdEnableForce(1, self._id)
        return int(OFF + cause if OFF + cause in TROUBLES else FAULT)

    def write(self) -> None:
        state = self.state[0]
        x, y, z = state.f_D_N.tolist()
        size = math.hypot(x, y, z)
        share = 0.0 if state.ready == 0 or not size < math.inf else min(1.0, LIMITS.force_N / max(size, 1e-9))
        force = (-share * y, share * x, share * z) if share > 0.0 else (0.0, 0.0, 0.0)
        result = self._dhd.dhdSetForce(*force, self._id)
        self._saturated = result == _SATURATED
        self._bad_writes = self._bad_writes + 1 if result < 0 else 0
        if self._bad_writes >= _BAD_COUNT:
            raise DeviceError(f"forcedimension: force: {self._error()}")

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        self._dhd.dhdSetForce(0.0, 0.0, 0.0, self._id)
        self._dhd.dhdStop(self._id)
        self._dhd.dhdClose(self._id)

    def reason(self, trouble: int) -> str:
        if trouble >= CALL:
            return str(error_text(self._dhd, trouble - CALL))
        return TROUBLES.get(trouble, "") if trouble else ""


def find(library: str | None = None, **options: Any) -> Sequence[Found]:
    """The connected devices, or the reason why the library does not list them."""
    try:
        dhd = load(library)
    except DeviceError as error:
        return [Found("", trouble=str(error).removeprefix("forcedimension: "), remedy=remedy())]
    return [Found(f"device {index}", {"device": index}) for index in range(max(0, int(dhd.dhdGetDeviceCount())))]


def release(**options: Any) -> None:
    """Open the device again and set zero force, for devices without a watchdog."""
    ForceDimensionConnection(**options).close()


DRIVER = Driver(
    name="forcedimension",
    summary="Force Dimension omega, delta, sigma, lambda, and the Falcon, through the DHD library.",
    open=ForceDimensionConnection,
    find=find,
    model=Device("forcedimension", None, LIMITS),
    continuous_N=4.0,
    low_D_m=(-0.25, -0.25, -0.25),
    high_D_m=(0.25, 0.25, 0.25),
    orientation=True,
    button_count=16,
    rate_Hz=4000.0,
    needs="the Force Dimension SDK (libdhd or libdrd), and permission for the USB device",
    options=(
        Option("library", None, "path of the vendor's library; by default dhd or drd on the system's path"),
        Option("device", 0, "index of the connected device, from 0"),
        Option("gravity", True, "gravity compensation of the device"),
    ),
    watchdog_s=WATCHDOG_S,
    release=release,
    assumptions=(
        "The library's axes are x towards the user, y to the right, z up, as CHAI3D takes them.",
        "8 N, 3000 N/m and 20 N·s/m are the values of CHAI3D for the Falcon, the weakest device.",
        "The continuous force is half of the peak force; no values are published.",
        "The mechanical stops bound the workspace.",
        "Each force command restarts the watchdog. A device without a watchdog is opened again and set to zero force.",
        "Reset in the status means that the device is not calibrated.",
        "The driver may enable the force again after a watchdog timeout or a program. After the button, the velocity "
        "threshold or a USB error a person must do it.",
        "The x axis of the library's orientation frame is along the handle, towards the user.",
    ),
)
