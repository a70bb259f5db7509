"""Check that a driver keeps the contract of `hapscene.device.driver`, on a connected device or an emulator.

The force is at most 0.5 N. Checks that inspect the sent force, or inject faults, need an emulator: a connected device
skips them.
"""

import importlib
import inspect
import math
import statistics
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.driver import DEVICE_STATE, Connection, Driver, Found, OptionValue
from hapscene.device.emulator import FAULTS, Emulator
from hapscene.errors import DeviceError
from hapscene.records import Record
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["check_driver"]

FORCE_N: Final = 0.3
"""Force that the checks request [N]."""

FORCE_MAX_N: Final = 0.5
"""Largest force that an emulator may receive [N]."""

READY_S: Final = 60.0
"""Longest time until a device is calibrated or homed [s]."""

TICKS: Final = 500
"""Number of ticks for which the device is read."""

READ_S: Final = 0.5 * TICK_S
"""Longest median duration of `read` [s]. A read that waits delays the haptic loop."""

FAULT_TICKS: Final = 800
"""Number of ticks for which a fault lasts: longer than `ResponseTimeout` accepts."""

SETTLE_TICKS: Final = 50
"""Number of ticks in which sent messages reach the emulator, and its answers the driver."""

VALID_FAULTS: Final = ("random", "jump")
"""Faults with answers that may be valid by chance, or that only the servo's speed limit detects."""


class Failed(Exception):
    """A check failed: what was found, and what was expected."""


class Skipped(Exception):
    """A check cannot be made: why."""


def check_driver(
    driver: Driver,
    options: Mapping[str, OptionValue],
    report: Callable[[str], None],
    emulator: Emulator | None = None,
    clock: Clock = CLOCK,
) -> bool:
    """Check a driver. Returns whether no check failed.

    Args:
        driver: the driver.
        options: options of the driver; strings are converted.
        report: receives one line a check.
        emulator: the emulator that `options` lead to; None for a connected device.
        clock: clock of the measured times.

    Raises:
        DeviceError: unknown or invalid option.
    """
    session, good = Session(driver, driver.read_options(options), emulator, clock), True
    try:
        for name, check in _checks(emulator):
            try:
                line = f"ok       {name}: {check(session)}"
            except Skipped as reason:
                line = f"skipped  {name}: {reason}"
            except Exception as error:  # also any error of the driver
                found = str(error) if isinstance(error, Failed) else f"raised {type(error).__name__}: {error}"
                line, good = f"failed   {name}: {found}", False
            report(f"{line}\n")
    finally:
        with suppress(Exception):  # a close that raises has failed its check
            session.close()
    return good


class Session:
    """A driver with its open connection, for the checks."""

    def __init__(
        self, driver: Driver, options: Mapping[str, OptionValue], emulator: Emulator | None, clock: Clock
    ) -> None:
        self.driver, self.options, self.emulated, self.clock = driver, options, emulator, clock
        self.durations_s: list[float] = []  # of each `read` in the last `turn`
        self._device: Connection | None = None

    @property
    def device(self) -> Connection:
        """The open connection."""
        if self._device is None:
            raise Skipped("the device is not open")
        return self._device

    @property
    def emulator(self) -> Emulator:
        """The emulator of the device."""
        if self.emulated is None:
            raise Skipped("needs an emulator (--emulator)")
        return self.emulated

    def open(self) -> None:
        """Open the device, after closing an open one."""
        self.close()
        assert self.driver.open is not None
        self._device = self.driver.open(**self.options)

    def close(self) -> None:
        """Close the device."""
        if self._device is not None:
            self._device.close()

    def turn(self, count: int, force_N: float = 0.0, ready: bool = True) -> None:
        """Read and write the device for `count` ticks, and measure the durations of `read`.

        Args:
            count: number of ticks.
            force_N: requested force along x.
            ready: False to request the force while the state says that the device is not ready.

        Raises:
            Failed: the state is invalid.
        """
        self.durations_s, state = [], self.device.state[0]
        for _ in range(count):
            start_s = self.clock.now_s()
            self.device.read()
            self.durations_s.append(self.clock.now_s() - start_s)
            _check_state(state, self.driver)
            state.ready = state.ready if ready else 0
            state.f_D_N = force_N, 0.0, 0.0
            self.device.write()
            self.clock.sleep_s(max(0.0, start_s + TICK_S - self.clock.now_s()))

    def await_ready(self) -> None:
        """Read the device until it is ready."""
        end_s = self.clock.now_s() + READY_S
        while self.device.state.ready[0] == 0:
            if self.clock.now_s() > end_s:
                reason = self.device.reason(int(self.device.state.trouble[0])) or "no reason given"
                raise Failed(f"not ready after {READY_S:g} s ({reason}); it needs: {self.driver.needs or 'not stated'}")
            self.turn(10)

    def await_force(self) -> Emulator:
        """The emulator of a ready device with force output, after its last force."""
        if not self.driver.force:
            raise Skipped("the device has no force output")
        emulator = self.emulator
        self.await_ready()
        self.turn(SETTLE_TICKS)
        emulator.largest_N = 0.0
        return emulator


def _check_state(state: Record, driver: Driver) -> None:
    if not np.isfinite(state.p_DT_m).all():
        raise Failed(f"position {state.p_DT_m.tolist()}, expected finite numbers")
    R = np.asarray(state.R_DT)
    if not (np.isfinite(R).all() and np.allclose(R @ R.T, np.eye(3), atol=1e-3) and np.linalg.det(R) > 0.0):
        raise Failed(f"orientation {R.tolist()}, expected a rotation matrix (the identity if unknown)")
    if int(state.buttons) >> driver.button_count:
        raise Failed(f"buttons are {int(state.buttons):b}, expected bits of the driver's {driver.button_count} buttons")


def _checks(emulator: Emulator | None) -> list[tuple[str, Callable[[Session], str]]]:
    """Names and functions of the checks, in order. A function returns what was measured."""
    faults = [(f"fault: {fault}", partial(_check_fault, fault=fault)) for fault in FAULTS]
    return [
        ("limits", _check_limits),
        ("options", _check_options),
        ("imports", _check_imports),
        ("find", _check_find),
        ("open", _check_open),
        ("samples", _check_samples),
        ("force", _check_force),
        ("invalid force", _check_invalid_force),
        ("no force while not ready", _check_not_ready),
        *(faults if emulator is not None else [("faults", _check_fault)]),
        ("close", _check_close),
        ("release", _check_release),
    ]


def _check_limits(session: Session) -> str:
    driver = session.driver
    if not (np.asarray(driver.low_D_m) < np.asarray(driver.high_D_m)).all():
        raise Failed(f"workspace {driver.low_D_m} … {driver.high_D_m}, expected low_D_m < high_D_m")
    if driver.model is None:
        raise Skipped("the driver has no model; a device with force output needs one")
    force_N = driver.model.limits.force_N
    if driver.force and not (0.0 < force_N < math.inf):
        raise Failed(f"model.limits.force_N is {force_N:g}, expected a finite force above 0")
    return f"force at most {force_N:g} N"


def _check_options(session: Session) -> str:
    try:
        session.driver.read_options({"no_such_option": "1"})
    except DeviceError:
        pass
    else:
        raise Failed("the option no_such_option is accepted, expected a DeviceError")
    driver = session.driver
    for function in (driver.open, driver.find, driver.release, driver.prepare_release):
        if function is not None:
            try:
                inspect.signature(function).bind(**session.options)
            except TypeError as error:
                raise Failed(f"{function.__qualname__}: {error}; expected all options as keyword arguments") from None
    return ", ".join(session.options) or "the driver has no options"


def _check_imports(session: Session) -> str:
    for module in session.driver.imports:
        importlib.import_module(module)
    return ", ".join(session.driver.imports) or "no modules stated"


def _check_find(session: Session) -> str:
    found = session.driver.find(**session.options)
    if not all(isinstance(one, Found) for one in found):
        raise Failed(f"returned {found!r}, expected a sequence of hapscene.device.Found")
    return ", ".join(one.where for one in found) or "no device found"


def _check_open(session: Session) -> str:
    session.open()
    if session.device.state.dtype != DEVICE_STATE:
        raise Failed("state is of another type, expected the one of Connection.__init__: call super().__init__()")
    session.turn(1)  # the first calls may compile
    if session.driver.home:
        session.turn(SETTLE_TICKS)
        session.device.home()
    session.await_ready()
    return "ready"


def _check_samples(session: Session) -> str:
    count, start_s = int(session.device.state.count[0]), session.clock.now_s()
    session.turn(TICKS)
    count, elapsed_s = int(session.device.state.count[0]) - count, session.clock.now_s() - start_s
    if count == 0:
        raise Failed(f"state.count is the same after {TICKS} ticks, expected one more for each new sample")
    return f"{count} in {TICKS} ticks, {count / elapsed_s:.0f} a second; read: {_duration(session.durations_s)}"


def _duration(durations_s: list[float]) -> str:
    """Median and longest duration of `read`. Only the median is checked: the system may suspend the program."""
    median_s = statistics.median(durations_s)
    measured = f"median {1e3 * median_s:.3f} ms, longest {1e3 * max(durations_s):.3f} ms"
    if median_s > READ_S:
        raise Failed(f"{measured}; expected a median of at most {1e3 * READ_S:g} ms: do not wait for the device")
    return measured


def _check_force(session: Session) -> str:
    emulator = session.await_force()
    session.turn(SETTLE_TICKS, FORCE_N)
    x, y, z = emulator.last_N
    found = f"({FORCE_N:g}, 0, 0) N requested, ({x:.3g}, {y:.3g}, {z:.3g}) N received"
    if math.dist((x, y, z), (FORCE_N, 0.0, 0.0)) > 0.2 * FORCE_N or emulator.largest_N > FORCE_MAX_N:
        raise Failed(f"{found}; expected the same force: check units and axes")
    return found


def _check_invalid_force(session: Session) -> str:
    emulator = session.await_force()
    for force_N in (math.nan, math.inf):
        session.turn(SETTLE_TICKS, force_N)
        if emulator.largest_N != 0.0:
            raise Failed(f"a force of {force_N} was sent as {emulator.last_N}, expected 0 or no message")
    return "NaN and infinity are not sent"


def _check_not_ready(session: Session) -> str:
    emulator = session.await_force()
    session.turn(SETTLE_TICKS, FORCE_N, ready=False)
    if emulator.largest_N != 0.0:
        raise Failed(f"{emulator.largest_N:.3g} N sent while state.ready is 0, expected 0")
    return "0 N sent"


def _check_fault(session: Session, fault: str = "") -> str:
    emulator = session.emulator
    session.await_ready()
    emulator.fault, error = fault, ""
    try:
        session.turn(SETTLE_TICKS)
        count = int(session.device.state.count[0])
        try:
            session.turn(FAULT_TICKS)
        except DeviceError as disconnected:
            error = str(disconnected)
        grown = int(session.device.state.count[0]) - count
    finally:
        emulator.fault = ""
    if grown > 0 and fault not in VALID_FAULTS:
        raise Failed(f"state.count grew by {grown} while no valid answer arrived, expected no change")
    found = f"read: {_duration(session.durations_s)}"
    if error:
        found = f"{found}; then DeviceError: {error}"
        _check_open(session)
    session.await_ready()
    session.turn(2 * SETTLE_TICKS)
    count = int(session.device.state.count[0])
    session.turn(2 * SETTLE_TICKS)
    if int(session.device.state.count[0]) == count:
        raise Failed("no new sample after the device works again, expected its samples")
    return found


def _check_close(session: Session) -> str:
    if session.emulated is not None and session.driver.force:
        session.await_ready()
        session.turn(SETTLE_TICKS, FORCE_N)
    session.device.close()
    session.device.close()
    if session.emulated is not None:
        _await_zero(session, "after close")
    return "may be called twice, and leaves no force" if session.emulated is not None else "may be called twice"


def _check_release(session: Session) -> str:
    driver = session.driver
    if driver.release is None:
        stops = f"the device stops after {driver.watchdog_s:g} s" if driver.watchdog_s < 10.0 else "closing suffices"
        raise Skipped(f"the driver has no release: {stops}")
    emulator = session.emulator
    emulator.last_N = (FORCE_N, 0.0, 0.0)  # as after the death of the driver's process
    driver.release(**session.options)
    _await_zero(session, "after release")
    return "sends 0 N"


def _await_zero(session: Session, when: str) -> None:
    for _ in range(SETTLE_TICKS):
        if not any(session.emulator.last_N):
            return
        session.clock.sleep_s(TICK_S)
    raise Failed(f"{session.emulator.last_N} N {when}, expected 0")
