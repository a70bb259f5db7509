"""A simulated network link with delay, jitter and loss, from a seeded random number generator."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.dsp.noise import seeded_state, uniform
from hapscene.errors import HapsceneError
from hapscene.records import Records, records
from hapscene.teleoperation.datagram import MESSAGE

__all__ = ["JITTER_MOST", "SLOT_COUNT", "Impairment", "Link", "collect", "new_link", "post"]

SLOT_COUNT: Final = 1024
"""Capacity for messages in transit [count]: a second at 1 kHz. More are lost, as in a full router."""

DELAY_MAX_S: Final = 0.5
"""Longest delay and longest jitter of a link [s]; limited by the capacity."""

JITTER_MOST: Final = 4.0
"""Upper end of the jitter distribution [times its mean]; 2 % of an exponential distribution lie beyond."""

LINE: Final = np.dtype(
    [
        ("delay_ticks", "f8"),
        ("jitter_ticks", "f8"),
        ("loss", "f8"),
        ("rng", "u8", (4,)),
        ("head", "i8"),  # number of the oldest message that may still be in transit
        ("tail", "i8"),  # number of the next message; message n is in slot n % SLOT_COUNT
        ("lost", "i8"),
    ],
    align=True,
)


@dataclass(frozen=True)
class Impairment:
    """Delay, jitter and loss of a link in one direction.

    Attributes:
        delay_s: delay of every message, 0 to 0.5.
        jitter_s: mean of an additional delay, drawn for each message from an exponential distribution that ends at four
            times its mean. Messages overtake each other if it is longer than a tick.
        loss: share of messages that are lost, 0 to 1.

    Raises:
        HapsceneError: a number out of range.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        most = {"delay_s": DELAY_MAX_S, "jitter_s": DELAY_MAX_S / JITTER_MOST, "loss": 1.0}
        for name, limit in most.items():
            if not 0.0 <= getattr(self, name) <= limit:
                raise HapsceneError(f"impairment: {name} must be from 0 to {limit:g}, is {getattr(self, name):g}")


class Link(NamedTuple):
    """A link in one direction, and the messages in transit."""

    line: Records  # (1,) LINE
    messages: Records  # (SLOT_COUNT,) MESSAGE
    arrival_tick: NDArray[np.float64]  # (SLOT_COUNT,); infinite once the message has arrived


def new_link(impairment: Impairment, tick_s: float, seed: int, name: str) -> Link:
    """Return an empty link. Links of the same seed and name lose and delay the same messages."""
    line = records(1, LINE)
    line.delay_ticks = impairment.delay_s / tick_s
    line.jitter_ticks = impairment.jitter_s / tick_s
    line.loss = impairment.loss
    line.rng[0] = seeded_state(seed, f"link.{name}")
    return Link(line, records(SLOT_COUNT, MESSAGE), np.full(SLOT_COUNT, math.inf))


@native
def post(link: Link, tick: int, message: Records) -> None:
    """Send a message (1,) over a link, in tick `tick` of the sender."""
    line = link.line[0]
    delay = line.delay_ticks
    if line.jitter_ticks > 0.0:
        delay += line.jitter_ticks * min(-math.log(1.0 - uniform(line.rng)), JITTER_MOST)
    if (line.loss > 0.0 and uniform(line.rng) < line.loss) or line.tail - line.head == SLOT_COUNT:
        line.lost += 1
        return
    slot = line.tail % SLOT_COUNT
    line.tail += 1
    link.messages[slot] = message[0]
    link.arrival_tick[slot] = tick + delay


@native
def collect(link: Link, tick: int, message: Records) -> bool:
    """Move the next message that has arrived by tick `tick`, in order of arrival, to `message` (1,).

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
    message[0] = link.messages[slot]
    link.arrival_tick[slot] = math.inf
    while line.head < line.tail and link.arrival_tick[line.head % SLOT_COUNT] == math.inf:
        line.head += 1
    return True
