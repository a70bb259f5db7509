"""The simulated link: delay, jitter and loss have the requested statistics."""

import math

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.jitter_buffer import MESSAGE
from hapscene.teleoperation.operation import JITTER_MOST, SLOT_COUNT, Impairment, Link, collect, new_link, post

TICK_S = 1e-3


def carry(link: Link, count: int, wait: int = 700) -> list[tuple[int, int]]:
    """Post a message per tick; return (tick of arrival, tick of the message) of each that arrives."""
    message, sent, arrived = records(1, MESSAGE), records(1, MESSAGE), []
    for now in range(count + wait):
        while collect(link, now, message):
            arrived.append((now, int(message[0].tick)))
        if now < count:
            sent[0].tick = now
            post(link, now, sent)
    return arrived


@pytest.mark.parametrize("delay_ms", [0, 5, 100])
def test_constant_delay_keeps_order(delay_ms: int) -> None:
    count = SLOT_COUNT // 2 + 100
    arrived = carry(new_link(Impairment(delay_ms * 1e-3), TICK_S, 0, "a"), count)
    assert arrived == [(k + max(delay_ms, 1), k) for k in range(count)]


def test_loss_and_jitter_statistics() -> None:
    arrived = np.array(carry(new_link(Impairment(0.02, 0.01, 0.1), TICK_S, 3, "a"), 8_000))
    assert 1.0 - len(arrived) / 8_000 == pytest.approx(0.1, abs=4.0 * math.sqrt(0.1 * 0.9 / 8_000))
    delay = arrived[:, 0] - arrived[:, 1]
    assert delay.min() == 21 and delay.max() == 20 + 10 * JITTER_MOST
    # an exponential distribution truncated at four means, rounded up to ticks: 10 (1 − e⁻⁴), and half a tick
    assert delay.mean() == pytest.approx(20 + 10 * (1 - math.exp(-JITTER_MOST)) + 0.5, abs=0.4)
    assert len(set(arrived[:, 1].tolist())) == len(arrived)


def test_seed_determines_the_losses() -> None:
    bad = Impairment(0.01, 0.005, 0.2)
    runs = [carry(new_link(bad, TICK_S, seed, "a"), 500) for seed in (5, 5, 6)]
    assert runs[0] == runs[1] != runs[2] and carry(new_link(bad, TICK_S, 5, "b"), 500) != runs[0]
    assert carry(new_link(Impairment(0.5, 0.125, 1.0), TICK_S, 0, "a"), 500) == []  # the worst: all are lost


def test_full_link_drops_messages() -> None:
    link = new_link(Impairment(0.5), TICK_S, 0, "a")
    for _ in range(SLOT_COUNT + 10):
        post(link, 0, records(1, MESSAGE))
    assert link.line[0].tail == SLOT_COUNT
    assert collect(link, 500, records(1, MESSAGE))


@pytest.mark.parametrize("bad", [{"loss": 1.5}, {"jitter_s": math.nan}, {"jitter_s": 0.13}, {"delay_s": 0.51}])
def test_impairment_out_of_range(bad: dict[str, float]) -> None:
    with pytest.raises(HapsceneError, match=next(iter(bad))):
        Impairment(**bad)
