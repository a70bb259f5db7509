"""Force Dimension devices (omega, delta, sigma, lambda) and the Falcon, through the vendor's library (DHD).

The library's axes are x towards the user, y to the right, z up, in m. The device's watchdog ends the force after
`WATCHDOG_S` without a command. Its velocity threshold is left as configured.
"""

import math
import sys
from collections.abc import Sequence
from ctypes import POINTER, byref, c_byte, c_char_p, c_double, c_int, c_ubyte, c_uint
from typing import Any, Final

from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.device.model import Device, Limits
from hapscene.device.vendor_library import load_library
from hapscene.errors import DeviceError

LIBRARIES: Final = ("dhd", "drd", "libdhd.so", "libdrd.so", "dhd64.dll", "drd64.dll")
WATCHDOG_S: Final = 0.020
"""Time without a new force after which the device stops the force [s]: 1 to 255 steps of 125 µs."""

LIMITS: Final = Limits(8.0, 8000.0, stiffness_N_m=3000.0, damping_Ns_m=20.0)

_STEP_S: Final = 125e-6
_FAR_M: Final = 10.0  # beyond the reach of all devices
_BAD_COUNT: Final = 20  # consecutive failures before an error
_ENABLE_READS: Final = 500  # reads between two attempts to enable the force
_OLD, _SATURATED = 1, 2  # results of successful calls
_POWER, _CONNECTED, _RESET, _FORCE, _BRAKE, _ERROR, _CAUSE = 0, 1, 3, 5, 6, 9, 14  # indices in the status

# trouble codes: of the device; causes of a disabled force, from 20; errors of the library, from 100
_MOTORS_SATURATED, _NO_POWER, _NOT_CONNECTED, _NOT_CALIBRATED, _FAULT, _BRAKED, _NOT_FINITE = range(1, 8)
_OFF, _CALL = 20, 100
_TROUBLES: Final = {
    _MOTORS_SATURATED: "the motors are saturated: the force is less than commanded",
    _NO_POWER: "the device has no power: switch it on",
    _NOT_CONNECTED: "the device is not connected: check the cable",
    _NOT_CALIBRATED: "the device is not calibrated: move it as described in its manual (Falcon: out and in)",
    _FAULT: "the device reports a fault: switch it off and on",
    _BRAKED: "the device brakes, for example after a fast movement: press its force button",
    _NOT_FINITE: "the device sends invalid positions: switch it off and on",
    _OFF + 0: "the force is being enabled",
    _OFF + 1: "the force was disabled by its button: press it again",
    _OFF + 2: "the force was disabled after a fast movement: press the force button",
    _OFF + 3: "the force was disabled by the watchdog; it is being enabled",
    _OFF + 4: "the force was disabled by a program; it is being enabled",
    _OFF + 5: "the force was disabled by a USB error: check the cable, and press the force button",
    _OFF + 6: "the force is disabled until the handle is held",
}
_COMES_BACK: Final = (0, 3, 4)  # causes after which the driver enables the force again

_NUMBER = POINTER(c_double)
_FUNCTIONS: Final[dict[str, tuple[Any, ...]]] = {
    "dhdGetDeviceCount": (c_int,),
    "dhdOpenID": (c_int, c_byte),
    "dhdClose": (c_int, c_byte),
    "dhdStop": (c_int, c_byte),
    "dhdEnableExpertMode": (c_int,),
    "dhdGetStatus": (c_int, POINTER(c_int), c_byte),
    "dhdGetPosition": (c_int, _NUMBER, _NUMBER, _NUMBER, c_byte),
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


def _remedy() -> str:
    text = "install the Force Dimension SDK, or name its library: --option library=PATH"
    if sys.platform.startswith("linux"):
        text += "; its USB device needs write permission (a udev rule)"
    return text


class ForceDimensionConnection(Connection):
    """An open device. The arguments are `DRIVER.options`.

    Raises:
        DeviceError: the library is not found, or the device cannot be used.
    """

    def __init__(self, library: str | None, device: int, gravity: bool) -> None:
        super().__init__()
        self._dhd = load_library("forcedimension", library, LIBRARIES, _FUNCTIONS, _remedy())
        self._id = int(self._dhd.dhdOpenID(device))
        self._open = self._id >= 0
        if not self._open:
            raise DeviceError(f"forcedimension: device={device}: {self._error()}; {_remedy()}")
        self._xyz, self._status = (c_double(), c_double(), c_double()), (c_int * 32)()
        self._bad_reads = self._bad_writes = self._reads = self._enable_at = 0
        self._saturated = False
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
        return _error_text(self._dhd, code)

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
            self._fail(_CALL + int(dhd.dhdErrorGetLast()))
            return
        x, y, z = (number.value for number in self._xyz)
        if not (abs(x) < _FAR_M and abs(y) < _FAR_M and abs(z) < _FAR_M):
            self._fail(_NOT_FINITE)
            return
        self._bad_reads = 0
        state.p_DT_m[:] = y, -x, z
        state.buttons = dhd.dhdGetButtonMask(self._id) & 0xFFFF
        if result != _OLD:
            state.count += 1
        trouble = self._trouble()
        state.ready = int(trouble == 0)
        state.trouble = _MOTORS_SATURATED if trouble == 0 and self._saturated else trouble

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
            (_NO_POWER, status[_POWER] == 0),
            (_NOT_CONNECTED, status[_CONNECTED] == 0),
            (_FAULT, status[_ERROR] != 0),
            (_NOT_CALIBRATED, status[_RESET] != 0),
        ):
            if met:
                return trouble
        if status[_FORCE] != 0:
            return _BRAKED if status[_BRAKE] != 0 else 0
        cause = status[_CAUSE]
        if cause in _COMES_BACK and self._reads >= self._enable_at:
            self._enable_at = self._reads + _ENABLE_READS
            self._dhd.dhdSetForce(0.0, 0.0, 0.0, self._id)
            self._dhd.dhdEnableForce(1, self._id)
        return _OFF + cause if _OFF + cause in _TROUBLES else _FAULT

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
        if trouble >= _CALL:
            return _error_text(self._dhd, trouble - _CALL)
        return _TROUBLES.get(trouble, "") if trouble else ""


def _error_text(dhd: Any, code: int) -> str:
    """Text of an error of the library."""
    text = (dhd.dhdErrorGetStr(code) or b"unknown").decode(errors="replace")
    return f"error {code} of the library: {text}"


def find(library: str | None = None, **options: Any) -> Sequence[Found]:
    """The connected devices, or the reason why the library does not list them."""
    try:
        dhd = load_library("forcedimension", library, LIBRARIES, _FUNCTIONS, _remedy())
    except DeviceError as error:
        return [Found("", trouble=str(error).removeprefix("forcedimension: "), remedy=_remedy())]
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
        "Orientation, torques and gripper are not used.",
    ),
)
