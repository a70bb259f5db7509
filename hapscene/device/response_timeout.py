"""Timeout for drivers of devices that stop answering."""

from typing import Final

from hapscene.device.driver import Connection
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["GONE_S", "PAUSE_S", "POLL_MAX_S", "ResponseTimeout", "no_answer"]

GONE_S: Final = 0.5
"""Time without a valid answer after which a device counts as disconnected [s]. The servo stops its force after 10
ms."""

PAUSE_S: Final = 0.1
"""Time without a poll from which on the last answer is too old to check the plausibility of the next one [s]."""

POLL_MAX_S: Final = 0.02
"""Longest time between two polls that counts as silence [s]."""


def no_answer(name: str, remedy: str) -> DeviceError:
    """The error of a device that has not answered for `GONE_S`."""
    return DeviceError(f"{name}: no valid data for {GONE_S:g} s; {remedy}")


class ResponseTimeout:
    """The time that a device has not answered. It grows only while the device is polled, not during a pause."""

    def __init__(self, clock: Clock = CLOCK) -> None:
        self._clock = clock
        self._silent_s, self._paused = 0.0, False
        self._polled_s = self._clock.now_s()

    def received(self) -> None:
        """Note that the device sent a valid answer."""
        self._silent_s, self._paused, self._polled_s = 0.0, False, self._clock.now_s()

    def check(self, connection: Connection, name: str, remedy: str) -> None:
        """Call this after each poll without a valid answer.

        Raises:
            DeviceError: no valid answer for `GONE_S`. No force is accepted from then on.
        """
        self._paused, now_s = self.was_paused(), self._clock.now_s()
        self._silent_s += min(now_s - self._polled_s, POLL_MAX_S)
        self._polled_s = now_s
        if self._silent_s > GONE_S:
            connection.state.ready = 0
            raise no_answer(name, remedy)

    def was_paused(self) -> bool:
        """Whether the device was not polled for `PAUSE_S` since its last valid answer.

        After a pause the device may be anywhere, and answers in the buffer are old. A device that was polled and did
        not answer was not paused: compare its next position with the last one, since it may be garbage.
        """
        return self._paused or self._clock.now_s() - self._polled_s > PAUSE_S
