"""The time that a device has not answered, for compiled drivers; `ResponseTimeout` is for Python. Not a driver."""

from typing import Any, Final

from hapscene.compiled.native import native
from hapscene.device.response_timeout import PAUSE_S, POLL_MAX_S

__all__ = ["SILENCE", "note_poll"]

SILENCE: Final = [
    ("polled_ns", "i8"),  # time of the last poll
    ("silent_ns", "i8"),  # time without a valid answer, pauses not counted
    ("paused", "i8"),  # 1: there was no valid answer since a pause
]
"""Fields in the state of a compiled driver, which sets the last two to 0 after a valid answer."""


@native
def note_poll(state: Any, now: int) -> bool:
    """Count the silence before a poll, at a time `now` [ns]; return whether the device was not polled for `PAUSE_S`.

    `state` has the fields `SILENCE`.
    """
    since = now - state.polled_ns
    state.silent_ns += min(since, int(POLL_MAX_S * 1e9))
    state.polled_ns = now
    if since > PAUSE_S * 1e9:
        state.paused = 1
        return True
    return False
