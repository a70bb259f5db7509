"""The clock of compiled code, of the system and virtual."""

from hapscene.clock import LOOK_NS, VIRTUAL, new_clock, now_here_ns, now_ns, sleep_ns


def test_a_virtual_clock_advances_by_looking_and_sleeping() -> None:
    clock = new_clock(5_000_000)
    assert [now_ns(clock), now_ns(clock)] == [5_000_000 + LOOK_NS, 5_000_000 + 2 * LOOK_NS]
    sleep_ns(clock, 700)
    assert clock[VIRTUAL] == 5_000_000 + 2 * LOOK_NS + 700


def test_the_clock_of_the_system_is_that_of_python() -> None:
    clock, start_ns = new_clock(), now_here_ns()
    sleep_ns(clock, 50_000_000)  # Windows may end it a tick of 16 ms sooner
    now, end_ns = now_ns(clock), now_here_ns()
    assert start_ns + 30_000_000 <= now <= end_ns and clock[VIRTUAL] == 0
