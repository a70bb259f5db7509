"""Devices of Force Dimension (omega, delta, sigma, lambda), and the Falcon there, through the vendor's library (DHD).

The library's axes are x towards the user, y to the right, z up, in m. The device's own watchdog ends the force when the
servo says nothing for `WATCHDOG_S`, its own velocity threshold stays as it was made.
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
"""After how long without a new force the device lets go [s]; it counts in steps of 125 µs, to 255."""

LIMITS: Final = Limits(8.0, 8000.0, stiffness_N_m=3000.0, damping_Ns_m=20.0)

_STEP_S: Final = 125e-6
_FAR_M: Final = 10.0  # no arm reaches there
_BAD_COUNT: Final = 20  # so many failures in turn are more than a moment
_ENABLE_READS: Final = 500  # how many reads after each other the force is asked for again
_OLD, _SATURATED = 1, 2  # what calls return that worked
_POWER, _CONNECTED, _RESET, _FORCE, _BRAKE, _ERROR, _CAUSE = 0, 1, 3, 5, 6, 9, 14  # of the status

# troubles: the device's, the causes of force being off (from 20), the library's errors (from 100)
_MOTORS_SATURATED, _NO_POWER, _NOT_CONNECTED, _NOT_CALIBRATED, _FAULT, _BRAKED, _NOT_FINITE = range(1, 8)
_OFF, _CALL = 20, 100
_TROUBLES: Final = {
    _MOTORS_SATURATED: "the motors give no more: the force is less than was asked for",
    _NO_POWER: "the device has no power; switch it on",
    _NOT_CONNECTED: "the device is not connected; see to its cable",
    _NOT_CALIBRATED: "the device is not calibrated; move it as its manual says (the Falcon: out and in)",
    _FAULT: "the device reports a fault; switch it off and on",
    _BRAKED: "the device brakes, as after too fast a movement; press its force button",
    _NOT_FINITE: "the device gives positions that cannot be; switch it off and on",
    _OFF + 0: "its force is being switched on",
    _OFF + 1: "its force was switched off by its button; press that",
    _OFF + 2: "its force was switched off, since it moved too fast; press its force button",
    _OFF + 3: "its force was switched off, since the servo was silent; it is being switched on",
    _OFF + 4: "its force was switched off by a program; it is being switched on",
    _OFF + 5: "its force was switched off, since USB failed; see to its cable, press its force button",
    _OFF + 6: "its force is off until its handle is held",
}
_COMES_BACK: Final = (0, 3, 4)  # causes after which the force may be switched on again

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
    text = "install Force Dimension's SDK, or say where its library is: library=PATH"
    if sys.platform.startswith("linux"):
        text += "; its USB device must be writable for you (a rule of udev's)"
    return text


class ForceDimensionConnection(Connection):
    """A device that is open. See `DRIVER.options`.

    Raises:
        DeviceError: the library is missing, or the device cannot be used.
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
            self._dhd.dhdSetWatchdog(round(WATCHDOG_S / _STEP_S), self._id)  # not every device has one: see `release`
        except BaseException:
            self.close()
            raise

    def _error(self) -> str:
        code = int(self._dhd.dhdErrorGetLast())
        return _error_text(self._dhd, code)

    def _try(self, doing: str, told: int) -> None:
        if told < 0:
            raise DeviceError(f"forcedimension: {doing}: {self._error()}")

    def read(self) -> None:
        state, dhd = self.state[0], self._dhd
        for number in self._xyz:
            number.value = math.nan
        told = dhd.dhdGetPosition(*map(byref, self._xyz), self._id)
        known = dhd.dhdGetStatus(self._status, self._id)
        self._reads += 1
        if told < 0 or known < 0:
            self._fail(_CALL + int(dhd.dhdErrorGetLast()))
            return
        x, y, z = (number.value for number in self._xyz)
        if not (abs(x) < _FAR_M and abs(y) < _FAR_M and abs(z) < _FAR_M):
            self._fail(_NOT_FINITE)
            return
        self._bad_reads = 0
        state.p_DT_m[:] = y, -x, z
        state.buttons = dhd.dhdGetButtonMask(self._id) & 0xFFFF
        if told != _OLD:
            state.count += 1
        trouble = self._trouble()
        state.ready = int(trouble == 0)
        state.trouble = _MOTORS_SATURATED if trouble == 0 and self._saturated else trouble

    def _fail(self, trouble: int) -> None:
        """Nothing could be read."""
        self.state.ready, self.state.trouble = 0, trouble
        self._bad_reads += 1
        if self._bad_reads >= _BAD_COUNT:
            raise DeviceError(f"forcedimension: {self.reason(trouble)}")

    def _trouble(self) -> int:
        """What stands in the way of forces; where nothing else does, they are switched on."""
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
        told = self._dhd.dhdSetForce(*force, self._id)
        self._saturated = told == _SATURATED
        self._bad_writes = self._bad_writes + 1 if told < 0 else 0
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
    """What the library says of an error of its own."""
    text = (dhd.dhdErrorGetStr(code) or b"unknown").decode(errors="replace")
    return f"error {code} of the library: {text}"


def find(library: str | None = None, **options: Any) -> Sequence[Found]:
    """The devices that the library counts, or why it cannot."""
    try:
        dhd = load_library("forcedimension", library, LIBRARIES, _FUNCTIONS, _remedy())
    except DeviceError as error:
        return [Found("", trouble=str(error), remedy=_remedy())]
    return [Found(f"device {index}", {"device": index}) for index in range(max(0, int(dhd.dhdGetDeviceCount())))]


def release(**options: Any) -> None:
    """Open it anew, so that its last force is zero: for devices without a watchdog."""
    ForceDimensionConnection(**options).close()


DRIVER = Driver(
    name="forcedimension",
    summary="omega, delta, sigma, lambda of Force Dimension, and the Falcon through their library.",
    open=ForceDimensionConnection,
    find=find,
    model=Device("forcedimension", None, LIMITS),
    continuous_N=4.0,
    low_D_m=(-0.25, -0.25, -0.25),
    high_D_m=(0.25, 0.25, 0.25),
    button_count=16,
    rate_Hz=4000.0,
    needs="the vendor's library (libdhd or libdrd: the Force Dimension SDK) and permission for its USB device",
    options=(
        Option("library", None, "path of the vendor's library; without, the system is asked for dhd and drd"),
        Option("device", 0, "which of those that are plugged in, from 0"),
        Option("gravity", True, "whether the device carries its own weight"),
    ),
    watchdog_s=WATCHDOG_S,
    release=release,
    assumptions=(
        "The library's axes are x towards the user, y to the right, z up, as CHAI3D takes them.",
        "8 N, 3000 N/m and 20 N·s/m are what CHAI3D names for the Falcon, the weakest; others could give more.",
        "What the motors bear for long is not known: half of the largest force is taken.",
        "The mechanism's own stops bound the workspace.",
        "The watchdog starts anew with each force that is set; a device without one is opened anew and given zero.",
        "Reset in the status is the mode of a device that is not calibrated.",
        "Force that its watchdog or a program switched off may be switched on again; after its button, its velocity "
        "threshold or a failure of USB a person does it.",
        "Orientation, torques and gripper are not used.",
    ),
)
