"""The servo's watchdog: a process that sees to it that no force is left when the servo dies or stands still.

A servo that ends by itself closes its devices, and says so. One that is killed, or does not tick for a while, cannot:
then the watchdog ends it for good, opens each device that keeps its last force, and writes zero (`Driver.release`).
"""

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
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["BUSY_S", "LOOK_S", "RELEASE_S", "STILL_S", "WAITING_S", "release", "until_needed", "watch"]

STILL_S: Final = 0.05
"""How long a servo that was stopped by a signal may be without a tick [s]."""

BUSY_S: Final = 0.2
"""And one that is not [s]: on two loaded cores without real-time priority 0.1 s was seen."""

WAITING_S: Final = 1.0
"""And one that waits for its device [s]: after half of it, drivers say themselves that it is silent."""

LOOK_S: Final = 0.005
"""How often the watchdog looks [s]."""

RELEASE_S: Final = 2.0
"""How long it tries to open a device that a dying process may still have [s]."""


def watch(
    life: Connection,
    ready: Connection,
    name: str,
    shape: tuple[int, int, int, int],
    pid: int,
    choices: Sequence[DeviceChoice],
) -> None:
    """The process's main function.

    Args:
        life: its other end is the servo's alone: it ends with it, and brings a word before where all is closed.
        ready: told when the watch has begun.
        name, shape: of the channel: its length, block, bodies and tools.
        pid: of the servo's process.
        choices: the devices.
    """
    for signum in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signum, signal.SIG_IGN)  # it ends after the servo
    drivers = [(DRIVERS.load(choice.name), choice) for choice in choices]  # imported before they are needed
    length, block, bodies, tools = shape
    channel = open_channel(length, block, name, bodies=bodies, tools=tools)
    ready.send(None)
    closed = until_needed(life, channel, pid)
    channel.close(unlink=False)
    if closed:
        return
    with suppress(OSError):
        os.kill(pid, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    for driver, choice in drivers:
        if driver.release is not None:
            release(driver, choice)


def _is_stopped(pid: int) -> bool:
    """Whether a process was stopped by a signal, as far as the system tells: on Linux."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
    except (OSError, IndexError):
        return False


def until_needed(life: Connection, channel: Channel, pid: int, clock: Clock = CLOCK) -> bool:
    """Wait while the servo lives; return whether it has closed all devices itself."""
    row, done, still_s, before_s = channel.channel[0], -1, 0.0, clock.now_s()
    while True:
        if life.poll(LOOK_S):
            with suppress(EOFError, OSError):
                life.recv()
                return True
            return False
        now_s = clock.now_s()
        moved = row.done != done or row.pause == 1
        # a watchdog that itself had no time has seen nothing
        still_s = 0.0 if moved else still_s + min(now_s - before_s, 2.0 * LOOK_S)
        done, before_s = int(row.done), now_s
        patience_s = WAITING_S if row.waiting else BUSY_S
        if still_s > patience_s or (still_s > STILL_S and _is_stopped(pid)):
            return False


def release(driver: Driver, choice: DeviceChoice, clock: Clock = CLOCK) -> None:
    """Write zero; again, while the dying process still has the device."""
    end_s = clock.now_s() + RELEASE_S
    while True:
        try:
            driver.release(**driver.read_options(choice.options))  # type: ignore[misc]
            return
        except Exception:  # of a driver; the next device is released all the same
            if clock.now_s() > end_s:
                return
            clock.sleep_s(0.002)
