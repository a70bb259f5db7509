"""The simulated line against what it was told to do."""

import math

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.datagram import MESSAGE
from hapscene.teleoperation.link import JITTER_MOST, SLOT_COUNT, Impairment, Link, collect, new_link, post

TICK_S = 1e-3


def carry(link: Link, count: int, wait: int = 700) -> list[tuple[int, int]]:
    """Post a message a tick; what arrives: (tick of arrival, tick of the message)."""
    out, told, arrived = records(1, MESSAGE), records(1, MESSAGE), []
    for now in range(count + wait):
        while collect(link, now, out, 0):
            arrived.append((now, int(out[0].tick)))
        if now < count:
            told[0].tick = now
            post(link, now, told)
    return arrived


@pytest.mark.parametrize("delay_ms", [0, 5, 100])
def test_a_line_that_only_delays_keeps_order_and_time(delay_ms: int) -> None:
    count = SLOT_COUNT // 2 + 100
    arrived = carry(new_link(Impairment(delay_ms * 1e-3), TICK_S, 0, "a"), count)
    assert arrived == [(k + max(delay_ms, 1), k) for k in range(count)]


def test_loss_and_jitter_have_the_statistics_asked_for() -> None:
    link = new_link(Impairment(0.02, 0.01, 0.1, 0.0), TICK_S, 3, "a")
    arrived = np.array(carry(link, 8_000))
    lost = 1.0 - len(arrived) / 8_000
    assert lost == pytest.approx(0.1, abs=4.0 * math.sqrt(0.1 * 0.9 / 8_000))
    late = arrived[:, 0] - arrived[:, 1]
    assert late.min() == 21 and late.max() == 20 + 10 * JITTER_MOST
    # an exponential that ends at four means, rounded up to ticks: 10 (1 − e⁻⁴), and half a tick
    assert late.mean() == pytest.approx(20 + 10 * (1 - math.exp(-JITTER_MOST)) + 0.5, abs=0.4)
    assert len(set(arrived[:, 1].tolist())) == len(arrived)


def test_what_is_held_back_is_overtaken_by_five() -> None:
    link = new_link(Impairment(0.01, 0.0, 0.0, 0.05), TICK_S, 1, "a")
    late = {sent: now - sent for now, sent in carry(link, 5000)}
    assert set(late.values()) == {10, 15}
    share = sum(wait == 15 for wait in late.values()) / 5000
    assert share == pytest.approx(0.05, abs=4.0 * math.sqrt(0.05 * 0.95 / 5000))


def test_the_same_seed_loses_the_same_messages() -> None:
    bad = Impairment(0.01, 0.005, 0.2, 0.1)
    assert carry(new_link(bad, TICK_S, 5, "a"), 500) == carry(new_link(bad, TICK_S, 5, "a"), 500)
    assert carry(new_link(bad, TICK_S, 5, "a"), 500) != carry(new_link(bad, TICK_S, 6, "a"), 500)


def test_a_line_that_is_full_loses_and_goes_on() -> None:
    link = new_link(Impairment(0.5), TICK_S, 0, "a")
    told = records(1, MESSAGE)
    for _ in range(SLOT_COUNT + 10):
        post(link, 0, told)
    assert link.line[0].lost == 10
    assert collect(link, 500, records(1, MESSAGE), 0)


@pytest.mark.parametrize("bad", [{"loss": 1.5}, {"jitter_s": math.nan}])
def test_a_line_out_of_range_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(HapsceneError, match="must lie between 0 and"):
        Impairment(**bad)
