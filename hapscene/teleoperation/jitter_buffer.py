"""The jitter buffer: a queue that puts messages in order and gives all of them the same delay.

A message is due `lag_ticks` after the tick in which it was sent; the lag starts as the delay of the first message. When
no message has arrived in time, the lag grows by a tick; when all messages arrive early for a while, it shrinks. Jitter
thus becomes a nearly constant delay, which wave variables tolerate, and no longer than the link needs at present. A
missing message is bridged by the next one, since waves are sent as totals.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.geometry import Vector
from hapscene.records import Record, Records, records

__all__ = ["MESSAGE", "SAMPLE_COUNT", "advance_queue", "new_queue", "next_wave", "play_samples", "store"]

SAMPLE_COUNT: Final = 10
"""Acceleration samples in a message [count]: a tick of 1 ms at 10 kHz."""

MESSAGE: Final = np.dtype(
    [
        ("tick", "i8"),  # tick of the sender, from 0; also the sequence number, since each tick sends one message
        ("p_WT_m", "f8", (3,)),  # position of the sender's tool
        ("v_WT_m_s", "f8", (3,)),  # its velocity, low-passed
        ("wave_sqrtJs", "f8", (3,)),  # integral over time of the waves sent so far [√(J·s)]
        ("wave_J", "f8"),  # energy of the waves sent so far
        ("a_m_s2", "f8", (SAMPLE_COUNT,)),  # accelerometer samples of this tick, along the handle
    ],
    align=True,
)
"""Message that leader and follower send each other in every tick. Waves are sent as totals since the start, so that a
lost message has no effect once the next one arrives (Niemeyer & Slotine 1998, "Towards force-reflecting teleoperation
over the Internet")."""

QUEUE_TICKS: Final = 512
"""Capacity of the queue [ticks]."""

A_EXTRA_MAX: Final = 60
"""Longest additional delay of acceleration samples relative to waves [ticks]: a latency of 40 ms changes how a texture
is perceived, 60 ms are noticed (Okamoto et al. 2009)."""

WINDOW: Final = 250
"""Messages over which the lag is adapted [count]: a quarter of a second. A shorter window underestimates the jitter."""

QUEUE: Final = np.dtype(
    [
        ("started", "i8"),
        ("lag_ticks", "i8"),
        ("due_tick", "i8"),  # tick of the message that is due
        ("is_new", "i8"),  # 1 if it was not due in the last tick
        ("counted", "i8"),  # messages in the present window
        ("early_ticks", "i8"),  # least time between arrival and due tick in the window; negative if too late
        ("a_extra_ticks", "i8"),  # additional delay of the samples, so that even the latest arrive in time
        ("a_due_tick", "i8"),
        ("a_is_new", "i8"),
        ("newest", "i8"),  # tick of the newest message
        ("tick", "i8", (QUEUE_TICKS,)),  # tick of the message in each slot
        ("wave_sqrtJs", "f8", (QUEUE_TICKS, 3)),
        ("wave_J", "f8", (QUEUE_TICKS,)),
        ("a_m_s2", "f8", (QUEUE_TICKS, SAMPLE_COUNT)),
    ],
    align=True,
)


def new_queue() -> Records:
    """Return an empty queue (1,) QUEUE."""
    queue: Records = records(1, QUEUE)
    queue.tick[:] = -1
    return queue


@native
def store(queue: Record, now: int, message: Record) -> None:
    """Store a message that arrived in the receiver's tick `now`, and adapt the lag."""
    if queue.started == 0 or abs(now - queue.lag_ticks - message.tick) >= QUEUE_TICKS // 2:
        queue.started, queue.newest = 1, message.tick
        queue.lag_ticks = now - message.tick
        queue.due_tick = message.tick - 1
        queue.a_due_tick, queue.a_extra_ticks = queue.due_tick, 0
        queue.counted, queue.early_ticks = 0, QUEUE_TICKS
    queue.newest = max(message.tick, queue.newest)
    early = queue.lag_ticks + message.tick - now
    queue.early_ticks = min(early, queue.early_ticks)
    queue.a_extra_ticks = max(min(-early, A_EXTRA_MAX), queue.a_extra_ticks)
    queue.counted += 1
    if queue.counted == WINDOW:
        back = max(queue.early_ticks + 1, 0) // 2  # half of the unused time: the lag shrinks without overshoot
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
def advance_queue(queue: Record, now: int) -> None:
    """Set which message is due in tick `now`. To be called once per tick, before `next_wave` and `play_samples`."""
    if queue.started == 0:
        return
    if now - queue.lag_ticks > queue.newest:
        queue.lag_ticks += 1
    queue.is_new = now - queue.lag_ticks > queue.due_tick
    queue.due_tick = max(now - queue.lag_ticks, queue.due_tick)
    a_due_tick = queue.due_tick - queue.a_extra_ticks
    queue.a_is_new = a_due_tick > queue.a_due_tick
    queue.a_due_tick = max(a_due_tick, queue.a_due_tick)


@native
def next_wave(queue: Record) -> tuple[int, Vector, float]:
    """Return the message that is due, or the next one after it that has arrived.

    Returns:
        number of ticks until it is past, at least 1, or 0 if there is no message; its totals [√(J·s)] and [J].
    """
    if queue.is_new == 1:
        for tick in range(queue.due_tick, queue.newest + 1):
            slot = tick % QUEUE_TICKS
            if queue.tick[slot] == tick:
                wave = queue.wave_sqrtJs[slot]
                return tick - queue.due_tick + 1, (wave[0], wave[1], wave[2]), queue.wave_J[slot]
    return 0, (0.0, 0.0, 0.0), 0.0


@native
def play_samples(queue: Record, a_m_s2: NDArray[np.float64]) -> None:
    """Copy the due acceleration samples to `a_m_s2` (SAMPLE_COUNT,), or zeros if they have not arrived."""
    slot = queue.a_due_tick % QUEUE_TICKS
    found = queue.a_is_new == 1 and queue.tick[slot] == queue.a_due_tick
    for i in range(SAMPLE_COUNT):
        a_m_s2[i] = queue.a_m_s2[slot, i] if found else 0.0
