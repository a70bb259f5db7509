"""The empty loop as a real process."""

import time

from hapscene_benchmarks.idle import IdleLoop
from tests.until import until


def test_it_waits_and_does_nothing_else_until_it_rests() -> None:
    with IdleLoop() as idle:
        assert idle.lateness().late.sum() == 0
        idle.start()
        began_s = time.monotonic()
        until(lambda: idle.lateness().late.sum() >= 200)
        assert time.monotonic() - began_s > 0.19  # 200 periods of 1 ms: a busy machine may make it late, never early
        idle.rest()
        found = idle.lateness()
        assert found.busy.sum() == 0
        idle.start()
        until(lambda: idle.lateness().since(found).late.sum() >= 50)
        idle.rest()
        again = idle.lateness()
        idle.rest()
        assert idle.lateness().late.sum() == again.late.sum()
    assert not idle._process.is_alive()
