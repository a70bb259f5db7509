"""The watchdog of a servo: a process that removes the force when the servo's process dies or stops ticking.

A servo that ends normally closes its devices and reports it. A servo that is killed, or does not tick for too long,
cannot: the watchdog then kills it, opens each device that holds its last force, and writes zero (`Driver.release`).

It leads a separate POSIX session, so that a signal to the process group of the application does not reach it. It
requests real-time priority and imports the drivers at its start, so that it reacts quickly on a busy machine.
"""

import gc
import importlib
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from hapscene.device.driver import Driver
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.loop.timing import request_realtime_priority
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["BUSY_S", "LOOK_S", "RELEASE_S", "STILL_S", "WAITING_S", "release", "until_needed", "watch"]

STILL_S: Final = 0.004
"""Time without a tick after which a servo that was stopped by a signal (SIGSTOP) is killed [s]."""

BUSY_S: Final = 0.2
"""Time without a tick after which any other servo is killed [s]: 0.1 s occurs on two loaded cores without real-time
priority."""

WAITING_S: Final = 1.0
"""Time without a tick after which a servo that waits for its device is killed [s]. Drivers report a silent device after
half this time."""

ENDING: Final = 0x4 | 0x200 | 0x400
"""Flags of a Linux process that ends: PF_EXITING, PF_DUMPCORE, PF_SIGNALED (include/linux/sched.h)."""

LOOK_S: Final = 0.004
"""How often the watchdog looks [s]."""

RELEASE_S: Final = 2.0
"""Longest time for which the watchdog tries to open a device that an ending process may still hold [s]."""


def watch(
    life: Connection,
    ready: Connection,
    name: str,
    shape: tuple[int, int, int, int],
    pid: int,
    choices: Sequence[DeviceChoice],
) -> None:
    """Main function of the process.

    Args:
        life: connection of which the servo alone holds the other end. It closes with the servo, and receives a message
            before if all devices are closed.
        ready: receives a message when the watch has begun.
        name, shape: name of the shared memory, and its ring length, block, number of bodies and number of tools.
        pid: process id of the servo.
        choices: the devices.
    """
    for signum in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signum, signal.SIG_IGN)  # it ends after the servo
    if hasattr(os, "setsid"):
        os.setsid()
    drivers = [(DRIVERS.load(choice.name), choice) for choice in choices]
    prepared = []
    for driver, choice in drivers:
        for module in driver.imports:
            with suppress(ImportError):  # the servo reports what is missing
                importlib.import_module(module)
        if driver.prepare_release is not None:
            with suppress(Exception):  # `release` is tried in any case
                prepared.append(driver.prepare_release(**driver.read_options(choice.options)))
    gc.freeze()
    gc.disable()  # a collection takes milliseconds
    request_realtime_priority()
    length, block, bodies, tools = shape
    channel = open_channel(length, block, name, bodies=bodies, tools=tools)
    ready.send(None)
    closed = until_needed(life, channel, pid)
    if closed:
        channel.close(unlink=False)
        return
    for send_zero in prepared:  # at once: to kill a large process and to open a port takes tens of milliseconds
        with suppress(Exception):
            send_zero()
    with suppress(OSError):
        os.kill(pid, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    for driver, choice in drivers:
        if driver.release is not None:
            release(driver, choice)
    channel.close(unlink=False)


def _state_of(pid: int) -> str:
    """State of a process: "stopped" by a signal, "ending", or "running", also where the system does not report it.

    A large process takes tens of milliseconds to end, and closes its files last: its flags show the end at once.
    """
    try:
        state, *numbers = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        flags = int(numbers[5])
    except FileNotFoundError:
        return "ending" if Path("/proc/self/stat").exists() else "running"
    except (OSError, ValueError, IndexError):
        return "running"
    if state in "ZXx" or flags & ENDING:
        return "ending"
    return "stopped" if state in "Tt" else "running"


def until_needed(life: Connection, channel: Channel, pid: int, clock: Clock = CLOCK) -> bool:
    """Wait until the servo ends or stops ticking; return whether it closed all devices itself."""
    row, done, still_s, before_s = channel.channel[0], -1, 0.0, clock.now_s()
    while True:
        if life.poll(LOOK_S):
            with suppress(EOFError, OSError):
                life.recv()
                return True
            return False
        now_s = clock.now_s()
        moved = row.done != done or row.pause == 1
        # count only time in which this process ran, so that its own delays do not count
        still_s = 0.0 if moved else still_s + min(now_s - before_s, 2.0 * LOOK_S)
        done, before_s = int(row.done), now_s
        patience_s = WAITING_S if row.waiting else BUSY_S
        state = _state_of(pid)
        if still_s > patience_s or state == "ending" or (still_s > STILL_S and state == "stopped"):
            return False


def release(driver: Driver, choice: DeviceChoice, clock: Clock = CLOCK) -> None:
    """Set the force of a device to zero; retry while the ended process still holds the device."""
    end_s = clock.now_s() + RELEASE_S
    while True:
        try:
            driver.release(**driver.read_options(choice.options))  # type: ignore[misc]
            return
        except Exception:  # an error of a driver; the next device is released in any case
            if clock.now_s() > end_s:
                return
            clock.sleep_s(0.002)
