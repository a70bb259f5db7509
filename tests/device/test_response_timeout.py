"""The response timeout of drivers, on a virtual clock."""

import pytest

from hapscene.device.driver import Connection
from hapscene.device.response_timeout import GONE_S, PAUSE_S, ResponseTimeout
from hapscene.errors import DeviceError
from tests.virtual_clock import VirtualClock


def poll(timeout: ResponseTimeout, clock: VirtualClock, seconds: float) -> Connection:
    connection = Connection()
    connection.state.ready = 1
    for _ in range(round(1000 * seconds)):
        clock.sleep_s(0.001)
        timeout.check(connection, "device", "check the cable")
    return connection


def test_a_device_without_answers_is_an_error_after_the_timeout() -> None:
    timeout = ResponseTimeout(clock := VirtualClock())
    assert poll(timeout, clock, 0.99 * GONE_S).state.ready[0] == 1
    with pytest.raises(DeviceError, match="device"):
        poll(timeout, clock, 0.02 * GONE_S)
    timeout.received()
    poll(timeout, clock, 0.99 * GONE_S)


def test_a_pause_lasts_until_an_answer_and_is_no_timeout() -> None:
    timeout = ResponseTimeout(clock := VirtualClock())
    poll(timeout, clock, 2.0 * PAUSE_S)
    assert not timeout.was_paused()  # the device is silent
    clock.sleep_s(3600.0)
    assert timeout.was_paused()
    poll(timeout, clock, 0.001)  # the first poll after a pause counts for a moment only
    assert timeout.was_paused()
    timeout.received()
    assert not timeout.was_paused()
