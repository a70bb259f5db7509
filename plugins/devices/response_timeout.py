"""Timeout for devices that stop answering. Not a driver."""

from typing import Final

from hapscene.device.driver import Connection
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock

GONE_S: Final = 0.5
"""Time without a valid answer after which a device counts as disconnected [s]. The servo stops its force after 10
ms."""

STALE_S: Final = 0.1
"""Time after which the last answer is too old to check the plausibility of the next one [s]."""


class ResponseTimeout:
    """The time that a device has not answered. It grows only while the device is polled, not during a pause."""

    def __init__(self, clock: Clock = CLOCK) -> None:
        self._clock = clock
        self._silent_s = 0.0
        self._polled_s = self._received_s = self._clock.now_s()

    def received(self) -> None:
        """Note that the device sent a valid answer."""
        self._silent_s, self._received_s = 0.0, self._clock.now_s()

    def check(self, connection: Connection, name: str, remedy: str) -> None:
        """Call this after each poll without a valid answer.

        Raises:
            DeviceError: no valid answer for `GONE_S`. No force is accepted from then on.
        """
        now_s = self._clock.now_s()
        self._silent_s += min(now_s - self._polled_s, 0.02)
        self._polled_s = now_s
        if self._silent_s > GONE_S:
            connection.state.ready = 0
            raise DeviceError(f"{name}: no valid data for {GONE_S:g} s; {remedy}")

    def is_stale(self) -> bool:
        """Whether the last valid answer is older than `STALE_S`, whether polled or not."""
        return self._clock.now_s() - self._received_s > STALE_S
