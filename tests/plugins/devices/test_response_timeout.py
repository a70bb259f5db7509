"""The response timeout of drivers, on a virtual clock."""

import pytest

from hapscene.device.driver import Connection
from hapscene.errors import DeviceError
from hapscene_plugins.devices.response_timeout import GONE_S, STALE_S, ResponseTimeout
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


def test_a_pause_makes_the_last_answer_stale_but_is_no_timeout() -> None:
    timeout = ResponseTimeout(clock := VirtualClock())
    assert not timeout.is_stale()
    clock.sleep_s(1.1 * STALE_S)
    assert timeout.is_stale()
    clock.sleep_s(3600.0)
    poll(timeout, clock, 0.001)  # the first poll after a pause counts for a moment only
    timeout.received()
    assert not timeout.is_stale()
