"""The empty loop as a real process."""

import time

from hapscene_benchmarks.idle import IdleLoop
from tests.until import until


def test_it_waits_and_does_nothing_else_until_it_rests() -> None:
    with IdleLoop() as idle:
        assert idle.timing().delay.sum() == 0
        idle.start()
        began_s = time.monotonic()
        until(lambda: idle.timing().delay.sum() >= 200)
        assert time.monotonic() - began_s > 0.19  # 200 periods of 1 ms: a busy machine may make it late, never early
        idle.rest()
        found = idle.timing()
        assert found.busy.sum() == 0
        idle.start()
        until(lambda: idle.timing().since(found).delay.sum() >= 50)
        idle.rest()
        again = idle.timing()
        idle.rest()
        assert idle.timing().delay.sum() == again.delay.sum()
    assert not idle._process.is_alive()
