"""The interface of device drivers.

A driver is one file with a `Driver` object, registered in the entry-point group `hapscene.devices`. It converts between
the device's axes and units and those of hapscene: SI units, in the device frame D, which is right-handed with x to the
right, y away from the hand, z up, and its origin in the middle of the workspace.

There are two kinds of connections. A `Connection` runs in the servo's loop: `read`, tick, `write`. A `VendorConnection`
receives the compiled tick by `schedule`, and the vendor's thread calls it between reading and writing.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

import numpy as np

from hapscene.device.model import Device
from hapscene.errors import DeviceError, no_such
from hapscene.geometry import Vector
from hapscene.records import Records, records

if TYPE_CHECKING:
    from hapscene.compiled.bound_call import BoundCall

__all__ = [
    "BUTTON_ROOM",
    "DEVICE_STATE",
    "DRIVER_FIELDS",
    "Connection",
    "Driver",
    "Found",
    "Option",
    "VendorConnection",
    "clip_force",
    "new_state",
]

BUTTON_ROOM: Final = 64
"""Changes of the buttons that the servo keeps for the application [count]."""

DEVICE_STATE: Final = np.dtype(
    [
        # set by the driver
        ("p_DT_m", "f8", (3,)),  # position of the tool
        ("R_DT", "f8", (3, 3)),  # orientation, z along the handle towards the hand; identity if unknown
        ("buttons", "i8"),  # one bit for each button
        ("ready", "i8"),  # 1: calibrated, homed and powered. Otherwise no force is sent
        ("count", "i8"),  # number of states that the device has sent
        ("trouble", "i8"),  # the driver's code of a problem (`Connection.reason`); 0: no problem
        ("heat", "f8"),  # motor temperature, 1: too warm; NaN if unknown
        ("v_DT_m_s", "f8", (3,)),  # velocity that the device itself measures; NaN if it measures none
        ("gripper_rad", "f8"),  # opening of the gripper; NaN without one
        # set by the servo
        ("f_D_N", "f8", (3,)),  # force on the hand
        ("button_count", "i8"),  # number of changes of `buttons`; before the log, so that a copy of both is consistent
        ("button_log", "i8", (BUTTON_ROOM, 3)),  # tick, time [ns] and `buttons` of the last changes, a ring buffer
    ],
    align=True,
)
"""State exchanged between a driver and the servo. A driver sets the fields that its device has."""


DRIVER_FIELDS: Final = tuple(DEVICE_STATE.names or ())[: list(DEVICE_STATE.names or ()).index("button_count")]
"""Fields of `DEVICE_STATE` before the log of the buttons, which only the servo writes."""


def clip_force(force_N: Iterable[float], most_N: float) -> Vector:
    """Limit the magnitude of a force (3,), keeping its direction. Returns 0 for a force that is not finite."""
    a, b, c = force_N
    x, y, z = float(a), float(b), float(c)
    size = math.sqrt(x * x + y * y + z * z)
    if not math.isfinite(size):
        return 0.0, 0.0, 0.0
    share = min(1.0, most_N / size) if size > 0.0 else 1.0
    return share * x, share * y, share * z


def new_state() -> Records:
    """(1,) DEVICE_STATE of a device from which nothing was received."""
    state = records(1, DEVICE_STATE)
    state.R_DT, state.heat, state.v_DT_m_s, state.gripper_rad = np.eye(3), math.nan, math.nan, math.nan
    return state


OptionValue: TypeAlias = str | float | int | bool | None
"""Value of a driver option."""


@dataclass(frozen=True)
class Option:
    """An option of a driver: `--option name=value`. The type is that of the default, or str if the default is None.

    Attributes:
        name: name of the argument of `Driver.open`.
        default: default value.
        meaning: description, a noun phrase with the unit.
        choices: valid values; empty for any value.
    """

    name: str
    default: OptionValue
    meaning: str
    choices: tuple[str, ...] = ()

    def read(self, text: str) -> OptionValue:
        """Convert a string to the value.

        Raises:
            DeviceError: wrong type, or not one of the choices.
        """
        if self.choices and text not in self.choices:
            raise DeviceError(f"option {self.name}={text}: expected one of {', '.join(self.choices)}")
        kind = {bool: "yes or no", int: "an integer", float: "a number"}.get(type(self.default), "a text")
        wrong = DeviceError(f"option {self.name}={text}: expected {kind}: {self.meaning}")
        if isinstance(self.default, bool):
            if text.lower() not in ("yes", "no", "true", "false", "1", "0"):
                raise wrong
            return text.lower() in ("yes", "true", "1")
        if isinstance(self.default, int | float):
            try:
                return type(self.default)(text)
            except ValueError:
                raise wrong from None
        return text


@dataclass(frozen=True)
class Found:
    """A connected device, or the reason why no device can be used.

    Attributes:
        where: port, serial number or address of the device.
        options: options that open this device, in addition to those of the user.
        trouble: reason why it cannot be used; empty if it can.
        remedy: what the user can do about `trouble`.
    """

    where: str
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    trouble: str = ""
    remedy: str = ""


class Connection:
    """Base class of an open device that the servo's loop reads and writes.

    Use it as a context manager: the force is 0 at its end. `read` updates `state`, and `write` sends its force. The
    servo replaces `state` by one in shared memory before the first call.
    """

    def __init__(self) -> None:
        self.state: Records = new_state()

    def read(self) -> None:
        """Update `state[0]` by the samples that have arrived. A read that waits delays the haptic tick.

        Not called before the servo starts, and while it is paused (`ResponseTimeout.was_paused`).

        Raises:
            DeviceError: the device was disconnected, or has sent invalid data for too long.
        """
        raise NotImplementedError

    def write(self) -> None:
        """Send the force of `state[0]`, which is finite and within the limits of the driver.

        Raises:
            DeviceError: the device was disconnected.
        """
        raise NotImplementedError

    def compiled(self) -> "tuple[BoundCall, BoundCall] | None":
        """`read` and `write` as C functions without Python, which wait for at most a fraction of a tick.

        They set `state.ready` to 0 at a problem, and `check` raises it. None if Python reads and writes the device.
        """
        return None

    def check(self) -> None:
        """Check that the device is still connected. Called ten times a second, in parallel with compiled reads.

        Raises:
            DeviceError: the device was disconnected.
        """

    def home(self) -> None:
        """Take the present position as the home position, which `Driver.home` describes. The force is 0.

        Raises:
            DeviceError: the device calibrates itself, or was disconnected.
        """
        raise DeviceError("this device calibrates itself")

    def close(self) -> None:
        """Set the force to 0 and release the device. Raises nothing, even if it is disconnected; may be called
        twice."""
        raise NotImplementedError

    def reason(self, trouble: int) -> str:
        """Meaning and remedy of a code in `state.trouble`."""
        return f"the device reports the problem code {trouble}" if trouble else ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class VendorConnection(Connection):
    """Base class of a device whose vendor's library calls the tick in its own thread.

    `read` and `write` are for use outside the servo, and are not called while the tick is scheduled.
    """

    def schedule(self, tick: int, context: int) -> None:
        """Start the tick in the vendor's thread: each period updates `state`, calls the tick and sends the force.

        Args:
            tick: address of a C function `void tick(void *context)`. It takes 2 to 10 µs and does not use Python.
            context: argument of that function.

        Raises:
            DeviceError: error of the vendor's library.
        """
        raise NotImplementedError

    def unschedule(self) -> None:
        """Stop the tick and set the force to 0. Returns when no call is running; may be called twice.

        Raises:
            DeviceError: the force could not be set to 0. The servo's process then ends, and the watchdog sets it to 0.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Driver:
    """A driver: functions that find and open devices, and properties of the devices.

    Attributes:
        name: name of the entry point.
        summary: supported devices, in one sentence.
        open: opens a device with the options as keyword arguments; returns a `Connection`. None for drivers that only
            play vibrations (`open_handle`).
        find: lists the connected devices, with the same options. Opens a device only for a moment, and raises nothing.
        model: mass, friction, encoder step and limits, from which the stable walls are computed. `limits.force_N` is
            the force limit.
        continuous_N: force that the motors sustain indefinitely.
        heat_s: thermal time constant of the motors [s].
        low_D_m, high_D_m: (3,) corners of the workspace. Outside of it the force is 0.
        speed_m_s: largest plausible speed of the tool. Above it the force is 0 until the tool rests.
        force, orientation: whether the device has a force output, and measures its orientation.
        button_count: number of buttons.
        rate_Hz: highest rate of the device's own loop; 0 if it has none.
        needs: requirements: a library, a port, a permission.
        home: what the user does before `Connection.home`, in the imperative; empty if the device calibrates itself.
        imports: modules that `open` and `release` import when they are called. The watchdog imports them at its start.
        options: options of the driver.
        watchdog_s: time without a command after which the device itself stops the force. If infinite, a process of the
            servo opens the device and sets the force to 0 (`hapscene.loop.watchdog`).
        release: sets the force of a device to 0 after its driver process has died, with the same options; None if
            closing suffices.
        prepare_release: opens the device a second time, with the same options, and returns a function that sets the
            force to 0 without delay. None if the device cannot be opened twice.
        open_handle: opens an output of the acceleration channel, with the options as keyword arguments; None without a
            handle.
        simulated: True if the driver uses no hardware.
        assumptions: facts that were not confirmed on hardware, one sentence each.
    """

    name: str
    summary: str
    open: Callable[..., Connection] | None = None
    find: Callable[..., Sequence[Found]] = lambda **options: ()
    model: Device | None = None
    continuous_N: float = math.inf
    heat_s: float = 10.0
    low_D_m: tuple[float, float, float] = (-math.inf, -math.inf, -math.inf)
    high_D_m: tuple[float, float, float] = (math.inf, math.inf, math.inf)
    speed_m_s: float = 2.0
    force: bool = True
    orientation: bool = False
    button_count: int = 0
    rate_Hz: float = 0.0
    needs: str = ""
    home: str = ""
    imports: tuple[str, ...] = ()
    options: tuple[Option, ...] = ()
    watchdog_s: float = math.inf
    release: Callable[..., None] | None = None
    prepare_release: Callable[..., Callable[[], object]] | None = None
    open_handle: Callable[..., Any] | None = None
    simulated: bool = False
    assumptions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.open is not None and self.force and not self.simulated and self.model is None:
            raise DeviceError(f"driver {self.name!r}: model is missing; a device with force output needs its limits")

    def __repr__(self) -> str:
        return f"<Driver {self.name!r}: {self.summary}>"

    def read_options(self, given: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
        """All options by name: the given ones, with strings converted, and the defaults of the others.

        Raises:
            DeviceError: unknown option, or invalid value.
        """
        known = {option.name: option for option in self.options}
        for name in given:
            if name not in known:
                raise DeviceError(f"device {self.name!r}: {no_such('option', name, known)}")
        read = {name: known[name].read(value) if isinstance(value, str) else value for name, value in given.items()}
        return {name: option.default for name, option in known.items()} | read
