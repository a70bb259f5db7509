"""After any fault an emulated device that `hapscene play` drives has no force left in time, by its own clock."""

import os
from pathlib import Path

import pytest

from hapscene.compiled.native import INTERPRETED

if not hasattr(os, "openpty") or not Path("/proc/self/stat").exists():
    pytest.skip("the board is on a pseudo-terminal, and processes are found in /proc", allow_module_level=True)
if INTERPRETED:
    pytest.skip("an interpreted tick takes longer than a period", allow_module_level=True)

from tests.nightly.loop.time_to_zero import DEVICES, busy_processes, events_of, measure

WITHIN_MS = 30.0
"""Largest time to zero torque at a load of two busy processes per core [ms]."""

DELIVERED_MS = 120.0
"""The same for signals that the servo's main thread must receive, which waits for the processor on a busy machine [ms]:
until then the servo ticks."""


REOPENED_MS = 400.0
"""The same where the device must be opened again, which takes until the process that held it has ended [ms]."""


HANDLE_MS = 80.0
"""The same for a handle, which plays its buffer and fades out [ms]."""


@pytest.mark.parametrize(("driver", "event"), [(driver, event) for driver in DEVICES for event in events_of(driver)])
def test_no_force_is_left_in_time(driver: str, event: str, tmp_path: Path) -> None:
    delivered = event in ("servo: SIGSTOP", "servo: SIGSEGV")
    reopened = driver == "openhaptics" and (event.startswith(("servo", "process")) or "hangs" in event)
    usual_ms = HANDLE_MS if driver == "serial" else WITHIN_MS
    within_ms = REOPENED_MS if reopened else DELIVERED_MS if delivered else usual_ms
    with busy_processes(2 * (os.cpu_count() or 1)):
        assert measure(driver, event, tmp_path) < within_ms
