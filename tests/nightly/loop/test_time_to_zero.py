"""After any fault an emulated 2DIY that `hapscene play` drives has no torque left in time, by its own clock."""

import os
from pathlib import Path

import pytest

from hapscene.compiled.native import INTERPRETED

if not hasattr(os, "openpty") or not Path("/proc/self/stat").exists():
    pytest.skip("the board is on a pseudo-terminal, and processes are found in /proc", allow_module_level=True)
if INTERPRETED:
    pytest.skip("an interpreted tick takes longer than a period", allow_module_level=True)

from tests.nightly.loop.time_to_zero import EVENTS, busy_processes, measure

WITHIN_MS = 30.0
"""Largest time to zero torque at a load of two busy processes per core [ms]."""

DELIVERED_MS = 120.0
"""The same for signals that the servo's main thread must receive, which waits for the processor on a busy machine [ms]:
until then the servo ticks."""


@pytest.mark.parametrize("event", EVENTS)
def test_no_torque_is_left_in_time(event: str, tmp_path: Path) -> None:
    delivered = event in ("servo: SIGSTOP", "servo: SIGSEGV")
    with busy_processes(2 * (os.cpu_count() or 1)):
        assert measure(event, tmp_path) < (DELIVERED_MS if delivered else WITHIN_MS)
