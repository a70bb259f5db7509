"""How long a device has said nothing of sense. No driver itself."""

from typing import Final

from hapscene.wall_clock import CLOCK, Clock

GONE_S: Final = 0.5
"""Longest silence before a device counts as gone [s]; after 10 ms already the servo gives it no force."""

FORGOTTEN_S: Final = 0.1
"""After how long without a word what it said last is no measure of what it says next [s]."""


class Silence:
    """Grows with each time that a device is asked in vain; while nobody asks, as in a pause, it does not."""

    def __init__(self, clock: Clock = CLOCK) -> None:
        self._clock = clock
        self._silent_s = 0.0
        self._asked_s = self._heard_s = self._clock.now_s()

    def end(self) -> None:
        """It has said something of sense."""
        self._silent_s, self._heard_s = 0.0, self._clock.now_s()

    def is_over(self) -> bool:
        """To be called each time that it was asked: whether it is gone."""
        now_s = self._clock.now_s()
        self._silent_s += min(now_s - self._asked_s, 0.02)
        self._asked_s = now_s
        return self._silent_s > GONE_S

    def is_forgotten(self) -> bool:
        """Whether the last word is long ago, asked or not."""
        return self._clock.now_s() - self._heard_s > FORGOTTEN_S
