"""Polling, for nightly tests that wait for a real process."""

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 180.0
"""Longest time to wait on a busy machine [s]."""


def until(true: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """Wait until a condition is true; returns its value."""
    end_s = time.monotonic() + patience_s
    while not (found := true()):
        assert time.monotonic() < end_s, "timed out"
        time.sleep(0.005)
    return found
