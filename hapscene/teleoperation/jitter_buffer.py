"""The jitter buffer: a short queue that puts messages in order and delays them evenly.

A message is played `lag_ticks` after the tick it was sent in: at first as long as it took. When none has come in time,
the lag grows by a tick; when all come early for a while, it shrinks again. So jitter becomes a delay that hardly
changes, which waves do not mind, no longer than the line at present needs. A message that is missing when its turn
comes is bridged by the next one, for waves come as totals.
"""

from typing import Any, Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.geometry import Vector
from hapscene.records import records
from hapscene.teleoperation.datagram import SAMPLE_COUNT

__all__ = ["QUEUE", "call", "new_queue", "next_wave", "play_samples", "store"]

QUEUE_TICKS: Final = 512
"""Ticks that the queue can hold [count]."""

A_EXTRA_MAX: Final = 60
"""Most that samples wait beyond the waves [ticks]: 40 ms of latency change how a texture feels, 60 ms are noticed
(Okamoto et al. 2009)."""

WINDOW: Final = 250
"""Messages over which the lag is adapted [count]: a quarter of a second. Shorter forgets how late the line can be."""

QUEUE: Final = np.dtype(
    [
        ("started", "i8"),
        ("lag_ticks", "i8"),
        ("turn", "i8"),  # tick of the message whose turn it is
        ("fresh", "i8"),  # 1 where it was not in the last tick
        ("counted", "i8"),  # messages in this window
        ("stored", "i8"),
        ("waited_ticks", "i8"),  # all of them together
        ("early_ticks", "i8"),  # least time that one of them came before its turn, negative: after it
        ("a_extra_ticks", "i8"),  # how much later than waves the samples are played, so that the latest come in time
        ("a_turn", "i8"),
        ("a_fresh", "i8"),
        ("newest", "i8"),  # tick of the newest message
        ("played", "i8"),
        ("missed", "i8"),  # turns at which the message had not come
        ("tick", "i8", (QUEUE_TICKS,)),  # that of the message in each slot
        ("wave_sqrtJs", "f8", (QUEUE_TICKS, 3)),
        ("wave_J", "f8", (QUEUE_TICKS,)),
        ("a_m_s2", "f8", (QUEUE_TICKS, SAMPLE_COUNT)),
    ],
    align=True,
)


def new_queue() -> Any:
    """An empty queue, (1,) QUEUE."""
    queue = records(1, QUEUE)
    queue.tick[:] = -1
    return queue


@native
def store(queue: Any, now: int, message: Any) -> None:
    """Keep a message that arrived in the receiver's tick `now`. One that came after its turn is only counted."""
    if queue.started == 0 or abs(now - queue.lag_ticks - message.tick) >= QUEUE_TICKS // 2:
        queue.started, queue.newest = 1, message.tick
        queue.lag_ticks = now - message.tick
        queue.turn = message.tick - 1
        queue.a_turn, queue.a_extra_ticks = queue.turn, 0
        queue.counted, queue.early_ticks = 0, QUEUE_TICKS
    queue.newest = max(message.tick, queue.newest)
    early = queue.lag_ticks + message.tick - now
    queue.early_ticks = min(early, queue.early_ticks)
    queue.a_extra_ticks = max(min(-early, A_EXTRA_MAX), queue.a_extra_ticks)
    queue.counted += 1
    queue.stored += 1
    queue.waited_ticks += max(early, 0)
    if queue.counted == WINDOW:
        back = max(queue.early_ticks + 1, 0) // 2
        queue.lag_ticks -= back
        queue.a_extra_ticks = max(min(back - queue.early_ticks, A_EXTRA_MAX), 0)
        queue.counted, queue.early_ticks = 0, QUEUE_TICKS
    slot = message.tick % QUEUE_TICKS
    queue.tick[slot] = message.tick
    for i in range(3):
        queue.wave_sqrtJs[slot, i] = message.wave_sqrtJs[i]
    queue.wave_J[slot] = message.wave_J
    for i in range(SAMPLE_COUNT):
        queue.a_m_s2[slot, i] = message.a_m_s2[i]


@native
def call(queue: Any, now: int) -> None:
    """Say whose turn it is in tick `now`: once a tick, before `next_wave` and `play`."""
    if queue.started == 0:
        return
    if now - queue.lag_ticks > queue.newest:
        queue.lag_ticks += 1
    queue.fresh = now - queue.lag_ticks > queue.turn
    queue.turn = max(now - queue.lag_ticks, queue.turn)
    a_turn = queue.turn - queue.a_extra_ticks
    queue.a_fresh = a_turn > queue.a_turn
    queue.a_turn = max(a_turn, queue.a_turn)


@native
def next_wave(queue: Any) -> tuple[int, Vector, float]:
    """The message whose turn it is, or else the next one there is.

    Returns:
        in how many ticks its turn is over, at least 1, or 0 where there is none; its totals [√(J·s)], [J].
    """
    if queue.started == 1 and queue.fresh == 1:
        for tick in range(queue.turn, queue.newest + 1):
            slot = tick % QUEUE_TICKS
            if queue.tick[slot] == tick:
                wave = queue.wave_sqrtJs[slot]
                return tick - queue.turn + 1, (wave[0], wave[1], wave[2]), queue.wave_J[slot]
    return 0, (0.0, 0.0, 0.0), 0.0


@native
def play_samples(queue: Any, a_m_s2: Any) -> None:
    """The acceleration samples whose turn it is into `a_m_s2` (SAMPLE_COUNT,); silence where they have not come."""
    slot = queue.a_turn % QUEUE_TICKS
    found = queue.started == 1 and queue.a_fresh == 1 and queue.tick[slot] == queue.a_turn
    for i in range(SAMPLE_COUNT):
        a_m_s2[i] = queue.a_m_s2[slot, i] if found else 0.0
    if found:
        queue.played += 1
    elif queue.started == 1:
        queue.missed += 1
