"""After any fault an emulated device that `hapscene play` drives has no force left in time, by its own clock."""

import os
import time
from pathlib import Path

import pytest

from hapscene.compiled.native import INTERPRETED

if not hasattr(os, "openpty") or not Path("/proc/self/stat").exists():
    pytest.skip("the board is on a pseudo-terminal, and processes are found in /proc", allow_module_level=True)
if INTERPRETED:
    pytest.skip("an interpreted tick takes longer than a period", allow_module_level=True)

from hapscene.device.safety import STALL_S
from hapscene.loop.timing import PRIORITY, request_realtime_priority
from hapscene.loop.watchdog import BUSY_S
from tests.nightly.loop.time_to_zero import (
    DEVICES,
    Play,
    busy_processes,
    events_of,
    is_pressed,
    measure,
    saturated_processors,
    time_to_zero_ms,
)
from tests.until import until

WITHIN_MS = 30.0
"""Largest time to zero torque at a load of two busy processes per core [ms]."""

REOPENED_MS = 400.0
"""The same where the device must be opened again, and its library's thread hangs [ms]."""


@pytest.mark.parametrize(("driver", "event"), [(driver, event) for driver in DEVICES for event in events_of(driver)])
def test_no_force_is_left_in_time(driver: str, event: str, tmp_path: Path) -> None:
    within_ms = REOPENED_MS if "hangs" in event else WITHIN_MS
    with busy_processes(2 * (os.cpu_count() or 1)):
        assert measure(driver, event, tmp_path) < within_ms


def require_priority() -> None:
    """Skip the test where real-time priority is not permitted."""
    if not request_realtime_priority(PRIORITY + 3):
        pytest.skip("real-time priority is not permitted")
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.mark.parametrize(("driver", "event"), [("falcon", "servo: SIGKILL"), ("inverse3", "servo: SIGSTOP")])
def test_watchdog_outranks_servos_that_take_all_processors(driver: str, event: str, tmp_path: Path) -> None:
    """With the priority of a servo it would run when they end, after 0.9 s. So would an emulator without priority."""
    require_priority()
    assert measure(driver, event, tmp_path, saturated=True) < WITHIN_MS


def test_starved_servo_has_no_force_and_goes_on(tmp_path: Path) -> None:
    """A thread with the priority of the servo takes its processor for 0.9 s. The system needs another one to transfer
    the bytes of the board."""
    require_priority()
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("needs two processors")
    play = Play("haply2diy", tmp_path)
    try:
        core = min(os.sched_getaffinity(0))
        for thread in Path(f"/proc/{play.servo_pid}/task").iterdir():
            os.sched_setaffinity(int(thread.name), [core])
        with saturated_processors([core]):
            at_ns = time.monotonic_ns()
            time.sleep(0.6)
        assert 1e3 * STALL_S < time_to_zero_ms(play.device, at_ns) < 1e3 * BUSY_S + 100.0
        until(lambda: not is_pressed(play.device))
        until(lambda: is_pressed(play.device))
        assert play.process.poll() is None
    finally:
        play.end()
