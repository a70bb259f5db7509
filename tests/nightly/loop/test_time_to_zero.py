"""After any fault an emulated device that `hapscene play` drives has no force left in time, by its own clock."""

import os
from pathlib import Path

import pytest

from hapscene.compiled.native import INTERPRETED

if not hasattr(os, "openpty") or not Path("/proc/self/stat").exists():
    pytest.skip("the board is on a pseudo-terminal, and processes are found in /proc", allow_module_level=True)
if INTERPRETED:
    pytest.skip("an interpreted tick takes longer than a period", allow_module_level=True)

from hapscene.loop.timing import PRIORITY, request_realtime_priority
from tests.nightly.loop.time_to_zero import DEVICES, busy_processes, events_of, measure

WITHIN_MS = 30.0
"""Largest time to zero torque at a load of two busy processes per core [ms]."""

REOPENED_MS = 400.0
"""The same where the device must be opened again, and its library's thread hangs [ms]."""


HANDLE_MS = 60.0
"""The same for a handle, which plays its buffer and fades out [ms]."""


GUARDED_MS = 200.0
"""The same for the end of the watchdog, which leaves a servo that works [ms]."""


@pytest.mark.parametrize(("driver", "event"), [(driver, event) for driver in DEVICES for event in events_of(driver)])
def test_no_force_is_left_in_time(driver: str, event: str, tmp_path: Path) -> None:
    usual_ms = HANDLE_MS if driver in ("serial", "usb") else WITHIN_MS
    within_ms = REOPENED_MS if "hangs" in event else GUARDED_MS if event.startswith("watchdog") else usual_ms
    with busy_processes(2 * (os.cpu_count() or 1)):
        assert measure(driver, event, tmp_path) < within_ms


@pytest.mark.parametrize(("driver", "event"), [("falcon", "servo: SIGKILL"), ("inverse3", "servo: SIGSTOP")])
def test_watchdog_outranks_servos_that_take_all_processors(driver: str, event: str, tmp_path: Path) -> None:
    """With the priority of a servo it would run when they end, after 0.9 s. So would an emulator without priority."""
    if not request_realtime_priority(PRIORITY + 3):
        pytest.skip("real-time priority is not permitted")
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    assert measure(driver, event, tmp_path, saturated=True) < WITHIN_MS
