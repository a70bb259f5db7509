"""The contract of drivers: what one says of its device, and what it does once a tick.

A driver is one file with a `Driver`, named in the entry-point group `hapscene.devices`. It converts axes and units, and
is the only place that does: what it gives and takes is in SI units and in D, the device's frame: right-handed, x to the
right, y away from the hand, z up, its origin in the middle of the workspace.

It is driven in one of two ways. Ours: `read`, tick, `write`, in the servo's loop. Or the vendor's: `schedule` hands it
the compiled tick, which the vendor's own thread calls between reading and writing (`VendorConnection`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Self

import numpy as np

from hapscene.device.model import Device
from hapscene.errors import DeviceError, no_such
from hapscene.geometry import Vector
from hapscene.records import records

__all__ = ["DEVICE_STATE", "Connection", "Driver", "Found", "Option", "VendorConnection", "clip_force", "new_state"]

DEVICE_STATE: Final = np.dtype(
    [
        # by the driver
        ("p_DT_m", "f8", (3,)),  # tool
        ("R_DT", "f8", (3, 3)),  # its orientation: z along the handle, towards the hand; identity where unknown
        ("buttons", "i8"),  # a bit each
        ("ready", "i8"),  # 1: calibrated, homed, powered: forces are taken. Else none is given
        ("count", "i8"),  # states read so far, one more with each that the device sent
        ("trouble", "i8"),  # what is wrong, by the driver's own numbers (`Connection.reason`); 0: nothing
        ("heat", "f8"),  # warmth of the motors, 1: too warm; NaN where the device does not tell
        # by the servo
        ("f_D_N", "f8", (3,)),  # force on the hand
    ],
    align=True,
)
"""What passes between a driver and the servo."""


def clip_force(force_N: Any, most_N: float) -> Vector:
    """A force (3,) cut to a magnitude, its direction kept; (0, 0, 0) where it is not finite."""
    x, y, z = (float(part) for part in force_N)
    size = math.sqrt(x * x + y * y + z * z)
    if not math.isfinite(size):
        return 0.0, 0.0, 0.0
    share = min(1.0, most_N / size) if size > 0.0 else 1.0
    return share * x, share * y, share * z


def new_state() -> Any:
    """(1,) DEVICE_STATE of a device that has not said anything."""
    state = records(1, DEVICE_STATE)
    state.R_DT, state.heat = np.eye(3), math.nan
    return state


@dataclass(frozen=True)
class Option:
    """What a user may tell a driver: `--option name=value`. Its type is that of the default, a text where that is None.

    Attributes:
        name: of the argument that `Driver.open` takes.
        default: what is taken without.
        meaning: in one sentence, with the unit.
        choices: what may be told; all where empty.
    """

    name: str
    default: str | float | int | bool | None
    meaning: str
    choices: tuple[str, ...] = ()

    def read(self, text: str) -> Any:
        """The value that a text says.

        Raises:
            DeviceError: not of the option's type, or not of its choices.
        """
        wrong = DeviceError(f"option {self.name}={text}: {self.meaning}")
        if self.choices and text not in self.choices:
            raise DeviceError(f"option {self.name}={text}: it is one of {', '.join(self.choices)}")
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
    """A device that is plugged in, or what stands in its way.

    Attributes:
        where: its port, serial number, or address; what `options` open it by.
        options: what to open it with, beside what the user tells.
        trouble: why it cannot be used; empty where it can.
        remedy: what would help.
    """

    where: str
    options: Mapping[str, Any] = field(default_factory=dict)
    trouble: str = ""
    remedy: str = ""


class Connection:
    """A device that is open, driven by read, tick, write. Drivers derive from it.

    Use it as a context: at its end no force is left. `state` is read into, and written from; the servo puts one in its
    place, in memory that the application sees, before it reads or schedules.
    """

    def __init__(self) -> None:
        self.state: Any = new_state()

    def read(self) -> None:
        """Bring `state[0]` up to date; waits no longer than a tick.

        Raises:
            DeviceError: the device is gone, or says what it cannot mean for longer than a moment.
        """
        raise NotImplementedError

    def write(self) -> None:
        """Send the force of `state[0]`; it is finite, and within the limits that the driver named.

        Raises:
            DeviceError: the device is gone.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Leave no force, let go of the device; raises nothing, also where it is gone. Twice does no harm."""
        raise NotImplementedError

    def reason(self, trouble: int) -> str:
        """What a number in `state.trouble` means, and what helps."""
        return f"the device reports trouble {trouble}" if trouble else ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class VendorConnection(Connection):
    """A device whose vendor's library has a thread of its own, which calls the tick.

    `read` and `write` are for trials outside the servo; while it is scheduled they are not called.
    """

    def schedule(self, tick: int, context: int) -> None:
        """Have the vendor's thread from now on, once a period and in compiled code: fill `state`, call the tick, send
        the force.

        Args:
            tick: address of a C function `void tick(void *context)`, which needs no Python; it takes 2 to 10 µs.
            context: what it is called with.

        Raises:
            DeviceError: the library refuses.
        """
        raise NotImplementedError

    def check(self) -> None:
        """See whether the device is still there; called ten times a second, beside the vendor's thread.

        Raises:
            DeviceError: it is gone.
        """

    def unschedule(self) -> None:
        """Have it called no more, no force left; returns when no call is under way. Twice does no harm."""
        raise NotImplementedError


@dataclass(frozen=True)
class Driver:
    """A device that can be plugged in, and what is known of it. A name of the entry-point group `hapscene.devices`.

    Attributes:
        name: of the entry point.
        summary: one sentence: which devices these are.
        open: opens one, with the options by name; gives a `Connection`. None for what only plays (`open_handle`).
        find: what is plugged in, with the same options; opens nothing for longer than a moment, raises nothing.
        model: mass, friction, encoder step and limits: what walls it holds is computed from them. Its `limits.force_N`
            is the largest force that is ever sent.
        continuous_N: force that it bears for ever.
        heat_s: time constant of its warming [s].
        low_D_m, high_D_m: (3,) corners of the workspace; outside of it no force is given.
        speed_m_s: a tool that is faster is not moved by a hand: no force is given until it rests.
        force, orientation: whether it has them.
        button_count: how many buttons it has.
        rate_Hz: of its own loop, at most; 0 for as fast as it is asked.
        needs: what must be there: a library, a port, a permission.
        imports: modules that `open` and `release` import when they are called. The watchdog imports them at its start.
        options: what a user may tell.
        watchdog_s: after how long without a word the device itself lets go; infinite for never: then the servo's guard
            opens it and writes zero.
        release: writes zero to a device whose driver has died, with the same options; None where closing suffices.
        open_handle: opens what plays the acceleration channel, with the options by name; None where there is none.
        simulated: no hardware at all.
        assumptions: what of all this nobody has confirmed on hardware, a sentence each.
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
    imports: tuple[str, ...] = ()
    options: tuple[Option, ...] = ()
    watchdog_s: float = math.inf
    release: Callable[..., None] | None = None
    open_handle: Callable[..., Any] | None = None
    simulated: bool = False
    assumptions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.open is not None and self.force and not self.simulated and self.model is None:
            raise DeviceError(f"driver {self.name!r}: a device that gives force has a model, whose limits keep it")

    def __repr__(self) -> str:
        return f"<Driver {self.name!r}: {self.summary}>"

    def read_options(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """All options by name: those told, texts read as their types, and the defaults of the others.

        Raises:
            DeviceError: an option that the driver does not have, or an invalid value.
        """
        known = {option.name: option for option in self.options}
        for name in told:
            if name not in known:
                raise DeviceError(f"device {self.name!r}: {no_such('option', name, known)}")
        read = {name: known[name].read(value) if isinstance(value, str) else value for name, value in told.items()}
        return {name: option.default for name, option in known.items()} | read
