"""When a device counts as gone: by how long it is asked in vain, on a clock that the test moves on."""

from hapscene_plugins.devices.silence import FORGOTTEN_S, GONE_S, Silence
from tests.virtual_clock import VirtualClock


def asked_in_vain(silence: Silence, clock: VirtualClock, seconds: float, every_s: float = 0.001) -> bool:
    over = False
    for _ in range(round(seconds / every_s)):
        clock.sleep_s(every_s)
        over = silence.is_over()
    return over


def test_it_is_gone_after_so_long_of_questions_in_vain() -> None:
    silence = Silence(clock := VirtualClock())
    assert not asked_in_vain(silence, clock, 0.99 * GONE_S)
    assert asked_in_vain(silence, clock, 0.02 * GONE_S)
    silence.end()
    assert not asked_in_vain(silence, clock, 0.99 * GONE_S)


def test_while_nobody_asks_it_is_not_silent_but_its_last_word_is_forgotten() -> None:
    silence = Silence(clock := VirtualClock())
    assert not silence.is_forgotten()
    clock.sleep_s(1.1 * FORGOTTEN_S)
    assert silence.is_forgotten()
    clock.sleep_s(3600.0)
    assert not silence.is_over()  # the first question after a pause counts for a moment
    silence.end()
    assert not silence.is_forgotten()
