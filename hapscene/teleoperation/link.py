"""A bad line, simulated: delay, jitter, loss and reordering, from a seeded generator, compiled.

The closed loop in one process sends its messages through it; over UDP it stands before the socket, so that two
processes on one machine can be tried as if an ocean lay between them.
"""

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.dsp.noise import seeded_state, uniform
from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.datagram import MESSAGE

__all__ = ["JITTER_MOST", "SLOT_COUNT", "Impairment", "Link", "collect", "new_link", "post"]

SLOT_COUNT: Final = 1024
"""Messages that can be under way at once [count]: a second at 1 kHz. More are lost, as in a full router."""

DELAY_MAX_S: Final = 0.5
"""Longest delay, and longest jitter, that a line may have [s]. With more the slots would run out."""

JITTER_MOST: Final = 4.0
"""Where the tail of the jitter ends [times its mean]: beyond lie 2 % of an exponential distribution."""

HELD_BACK_S: Final = 0.005
"""How long a message that is to be overtaken waits [s]: at 1 kHz five others pass it."""

LINE: Final = np.dtype(
    [
        ("delay_ticks", "f8"),
        ("jitter_ticks", "f8"),
        ("held_ticks", "f8"),
        ("loss", "f8"),
        ("reorder", "f8"),
        ("rng", "u8", (4,)),
        ("head", "i8"),  # oldest message that may still be under way
        ("tail", "i8"),  # next free number; number n lies in slot n % SLOT_COUNT
        ("lost", "i8"),
    ],
    align=True,
)


@dataclass(frozen=True)
class Impairment:
    """How bad a line is, one way.

    Attributes:
        delay_s: what every message waits, 0 to 0.5.
        jitter_s: mean of a further wait, drawn for each message from an exponential distribution that ends at four
            times its mean. Messages overtake each other where it is longer than a tick.
        loss: share of messages that never arrive, 0 to 1.
        reorder: share that is held back for 5 ms, so that the next ones arrive before it, 0 to 1.

    Raises:
        HapsceneError: a number out of range.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    reorder: float = 0.0

    def __post_init__(self) -> None:
        most = {"delay_s": DELAY_MAX_S, "jitter_s": DELAY_MAX_S / JITTER_MOST, "loss": 1.0, "reorder": 1.0}
        for name, limit in most.items():
            if not 0.0 <= getattr(self, name) <= limit:
                raise HapsceneError(f"a line's {name} must lie between 0 and {limit:g}, is {getattr(self, name):g}")


class Link(NamedTuple):
    """A line, one way."""

    line: Any  # (1,) LINE
    messages: Any  # (SLOT_COUNT,) MESSAGE
    arrival_tick: NDArray[np.float64]  # (SLOT_COUNT,); infinite once it has arrived


def new_link(impairment: Impairment, tick_s: float, seed: int, name: str) -> Link:
    """An empty line; the same seed and name lose and delay the same messages."""
    line = records(1, LINE)
    line.delay_ticks = impairment.delay_s / tick_s
    line.jitter_ticks = impairment.jitter_s / tick_s
    line.held_ticks = HELD_BACK_S / tick_s
    line.loss, line.reorder = impairment.loss, impairment.reorder
    line.rng[0] = seeded_state(seed, f"link.{name}")
    return Link(line, records(SLOT_COUNT, MESSAGE), np.full(SLOT_COUNT, math.inf))


@native
def post(link: Any, tick: int, message: Any) -> None:
    """Give the line a message (1,) in tick `tick` of the sender."""
    line = link.line[0]
    delay = line.delay_ticks
    if line.jitter_ticks > 0.0:
        delay += line.jitter_ticks * min(-math.log(1.0 - uniform(line.rng)), JITTER_MOST)
    if line.reorder > 0.0 and uniform(line.rng) < line.reorder:
        delay += line.held_ticks
    if (line.loss > 0.0 and uniform(line.rng) < line.loss) or line.tail - line.head == SLOT_COUNT:
        line.lost += 1
        return
    slot = line.tail % SLOT_COUNT
    line.tail += 1
    link.messages[slot] = message[0]
    link.arrival_tick[slot] = tick + delay


@native
def collect(link: Any, tick: int, messages: Any, place: int) -> bool:
    """Take the next message that has arrived by tick `tick`, in order of arrival, into `messages[place]`.

    Returns whether there was one.
    """
    line = link.line[0]
    first, slot = math.inf, -1
    for number in range(line.head, line.tail):
        candidate = number % SLOT_COUNT
        if link.arrival_tick[candidate] < first:
            first, slot = link.arrival_tick[candidate], candidate
    if first > tick:
        return False
    messages[place] = link.messages[slot]
    link.arrival_tick[slot] = math.inf
    while line.head < line.tail and link.arrival_tick[line.head % SLOT_COUNT] == math.inf:
        line.head += 1
    return True
