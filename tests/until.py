"""Waiting for what others do in their own time."""

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 180.0
"""How long anything may take on a machine that does much else besides [s]."""


def until(true: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """Wait until something comes true; what it then is."""
    end_s = time.monotonic() + patience_s
    while not (found := true()):
        assert time.monotonic() < end_s, "it never came true"
        time.sleep(0.005)
    return found
