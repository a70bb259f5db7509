"""The watchdog of a servo: a process that removes the force when the servo's process dies or stops ticking.

A servo that ends normally closes its devices and reports it. A servo that is killed, or does not tick for too long,
cannot: the watchdog then kills it, opens each device that holds its last force, and writes zero (`Driver.release`).
A servo that does not tick because the machine is overloaded goes on afterwards, with a force that ramps up from zero,
if its devices allow it: they stop by themselves, or the watchdog can write zero while the servo has them open.

It leads a separate POSIX session, so that a signal to the process group of the application does not reach it. It
requests a higher real-time priority than the servo and imports the drivers at its start, so that it reacts quickly on a
busy machine, also if the servo does not yield the processor.
"""

import gc
import importlib
import os
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from hapscene.device.driver import Driver
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.loop.driver import ENDED
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.loop.timing import PRIORITY, request_realtime_priority
from hapscene.wall_clock import CLOCK, Clock

__all__ = [
    "BUSY_S",
    "LOOK_S",
    "RELEASE_S",
    "STILL_S",
    "WAITING_S",
    "release",
    "release_all",
    "state_of",
    "until_needed",
    "watch",
]

STILL_S: Final = 0.003
"""Time without a tick after which a servo that was stopped by a signal (SIGSTOP) is killed [s]."""

BUSY_S: Final = 0.2
"""Time without a tick after which the force of any other servo is removed [s]: 0.1 s occurs on two loaded cores without
real-time priority. The servo is killed for it, unless its devices allow it to go on."""

WAITING_S: Final = 1.0
"""Time without a tick after which a servo is killed that waits for its device, or whose force has been removed [s].
Drivers report a silent device after half this time."""

ENDING: Final = 0x4 | 0x200 | 0x400
"""Flags of a Linux process that ends: PF_EXITING, PF_DUMPCORE, PF_SIGNALED (include/linux/sched.h)."""

FATAL: Final = 0x40560
"""SIGABRT, SIGBUS, SIGKILL, SIGSEGV and SIGSTOP in the pending signals of a Linux process."""

LOOK_S: Final = 0.002
"""How often the watchdog looks [s]."""

RELEASE_S: Final = 10.0
"""Longest time for which the watchdog tries to reach a device [s], such as one whose service does not answer."""

RETRY_S: Final = 0.002
"""Time between two such attempts [s]."""


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
    prepared, can_go_on = [], True
    for driver, choice in drivers:
        for module in driver.imports:
            with suppress(ImportError):  # the servo reports what is missing
                importlib.import_module(module)
        ends = not driver.force or (driver.release is None and driver.watchdog_s < BUSY_S)
        if driver.prepare_release is not None:
            with suppress(Exception):  # `release` is tried in any case
                prepared.append(driver.prepare_release(**driver.read_options(choice.options)))
                ends = True
        can_go_on = can_go_on and ends

    def send_zeros() -> None:
        for send_zero in prepared:
            with suppress(Exception):
                send_zero()

    gc.freeze()
    gc.disable()  # a collection takes milliseconds
    request_realtime_priority(PRIORITY + 1)
    _hasten(os.getpid())  # threads of libraries: the servo detects the end of this process when all of them have ended
    length, block, bodies, tools = shape
    channel = open_channel(length, block, name, bodies=bodies, tools=tools)
    ready.send(None)
    closed = until_needed(life, channel, pid, send_zeros if can_go_on else None)
    channel.close(unlink=False)
    if closed:
        return
    send_zeros()  # at once: to kill a large process and to open a port takes tens of milliseconds
    with suppress(OSError):
        os.kill(pid, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    _hasten(pid)
    release_all(drivers, partial(_closed, life))


def _hasten(pid: int) -> None:
    """Give all threads of a process the priority of this one: when it is killed, it frees its memory before its
    devices."""
    with suppress(OSError, AttributeError):  # it has ended, or not Linux
        for thread in Path(f"/proc/{pid}/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.sched_getscheduler(0), os.sched_getparam(0))


def _closed(life: Connection) -> bool:
    """Return whether the other end of a connection is closed, which receives no message."""
    try:
        return life.poll()
    except OSError:  # Windows
        return True


def state_of(pid: int) -> str:
    """State of a process: "stopped" by a signal, "ending", or "running", also where the system does not report it.

    A large process takes tens of milliseconds to end, and closes its files last: its flags show the end before. On a
    busy machine its main thread also takes long to receive a signal, which is pending until then.
    """
    place = Path(f"/proc/{pid}")
    try:
        state, *numbers = (place / "stat").read_text().rpartition(")")[2].split()
        words = (place / "status").read_text().split()
        pending = [int(words[words.index(name) + 1], 16) for name in ("SigPnd:", "ShdPnd:")]
    except FileNotFoundError:
        return "ending" if Path("/proc/self/stat").exists() else "running"
    except (OSError, ValueError, IndexError):
        return "running"
    if state in "ZXx" or int(numbers[5]) & ENDING or any(bits & FATAL for bits in pending):
        return "ending"
    return "stopped" if state in "Tt" else "running"


def until_needed(
    life: Connection,
    channel: Channel,
    pid: int,
    send_zeros: Callable[[], object] | None = None,
    clock: Clock = CLOCK,
) -> bool:
    """Wait until the servo ends or stops ticking; return whether it closed all devices itself.

    `send_zeros` removes the force of a servo that may go on; it is called after `BUSY_S` without a tick.
    """
    row, done, still_s, before_s, sent = channel.channel[0], -1, 0.0, clock.now_s(), False
    while True:
        try:
            if life.poll(LOOK_S):
                life.recv()
                return True
        except (EOFError, OSError):
            return False
        now_s = clock.now_s()
        ticked = row.done != done
        moved = ticked or row.waiting == ENDED
        # count only time in which this process ran, so that its own delays do not count
        still_s = 0.0 if moved else still_s + min(now_s - before_s, 4.0 * LOOK_S)
        done, before_s = int(row.done), now_s
        sent = sent and not moved
        if send_zeros is not None and still_s > BUSY_S and not sent:
            send_zeros()
            sent = True
        patience_s = WAITING_S if row.waiting or send_zeros is not None else BUSY_S
        state = "running" if ticked else state_of(pid)  # to read it takes 0.06 ms
        if still_s > patience_s or state == "ending" or (still_s > STILL_S and state == "stopped"):
            return False


def release_all(drivers: Sequence[tuple[Driver, DeviceChoice]], closed: Callable[[], bool]) -> None:
    """Set the force of all devices to zero, in parallel, because a device that does not answer must not delay others.

    `closed` as in `release`.
    """
    threads = [threading.Thread(target=release, args=(*each, closed)) for each in drivers if each[0].release]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def release(driver: Driver, choice: DeviceChoice, closed: Callable[[], bool], clock: Clock = CLOCK) -> None:
    """Set the force of a device to zero; retry while the ending process still holds it.

    Where two processes can open a device, a thread of the ending one may still write a force. `closed` returns whether
    all threads have ended; the force is then set to zero once more.
    """
    end_s, sent = clock.now_s() + RELEASE_S, False
    while clock.now_s() < end_s:
        last = closed()
        if last or not sent:
            with suppress(Exception):  # an error of a driver
                driver.release(**driver.read_options(choice.options))  # type: ignore[misc]
                if last:
                    return
                sent = True
        clock.sleep_s(RETRY_S)
